"""An axis whose analysis went wrong: what is reported of it, so that the others are not lost."""

from __future__ import annotations

import math
import traceback
from pathlib import Path

from allanscope.explain.effect import AxisExplanation, ResidualError

__all__ = ["failed", "failure_text"]

_LONGEST = 200


def failure_text(error: Exception) -> str:
    """Return an error in one bounded line.

    >>> failure_text(ZeroDivisionError("weights sum to zero"))
    'ZeroDivisionError: weights sum to zero'
    """
    words = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")
    words = words if len(words) <= _LONGEST else words[: _LONGEST - 1] + "…"
    return words + _place(error)


def _place(error: Exception) -> str:
    """Return where in this package it happened, for whoever gets the report."""
    here = Path(__file__).parent.parent.name
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if here in Path(frame.filename).parts]
    return f" ({Path(ours[-1].filename).name}:{ours[-1].lineno})" if ours else ""


def failed(error: Exception) -> AxisExplanation:
    """Return the explanation of an axis that could not be searched because of an error."""
    unknown = ResidualError(*[math.nan] * 5)
    text = failure_text(error)
    why = f"the search failed: {text}"
    return AxisExplanation(
        effects=(),
        before=unknown,
        after=unknown,
        coefficients_before={},
        coefficients_after={},
        held_out_nats=math.nan,
        held_out_nats_se=math.nan,
        explained=False,
        remarks=(why,),
        hindrance=why,
        failure=text,
    )
