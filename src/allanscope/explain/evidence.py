"""Words and numbers of an accepted effect: what convinced."""

from __future__ import annotations

from typing import Any

import numpy as np

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Effect, Parameter

__all__ = ["effect_of"]


def effect_of(candidate: Candidate, axis: str) -> Effect | None:
    """Return the effect for the report, None for what is a coefficient.

    ``p_value`` is that of the gain, chi-square with two degrees of freedom, times what was looked
    at; sizes of effects that were searched for are a little too large on average near the limit of
    detection, because only those that noise lifted over it are seen (``detection_selected``). What
    is read off the values, such as their step, has no gain.
    """
    kind = candidate.effect
    if kind.is_coefficient:
        return None
    log_p = candidate.log_alternatives - min(candidate.gain, 700.0)
    p_value = float(np.exp(np.clip(log_p, -700.0, 0.0)))
    evidence: dict[str, Any] = {
        "words": _words(candidate),
        "gain_nats": float(candidate.gain) if np.isfinite(candidate.gain) else None,
        "price_nats": float(candidate.penalty),
        "p_value": p_value,
        "detection_selected": bool(0 < candidate.excess < 10.0),
        **kind.evidence,
    }
    if candidate.seen_in:
        evidence["seen_in"] = candidate.seen_in
    held = candidate.held_out
    if held is not None:
        evidence |= {
            "held_out_nats": float(held.nats),
            "held_out_nats_se": float(held.error),
            "held_out_design": held.design,
        }
    replicated = held.replicated if held is not None else None
    evidence["replicated"] = "not replicated" if replicated is None else replicated
    return Effect(
        kind=candidate.kind,
        parameters={name: _plain(p) for name, p in kind.parameters.items()},
        equivalent=candidate.equivalent,
        axes=candidate.axes or (axis,),
        evidence=evidence,
        of_the_stream=kind.of_the_stream,
        located_by=kind.located_by,
        brief=kind.brief,
        curve=kind.curve,
        repeats_rows=kind.repeats_rows,
    )


def _plain(parameter: Parameter) -> Parameter:
    if isinstance(parameter.value, str):
        return parameter
    return Parameter(
        float(parameter.value),
        None if parameter.lower is None else float(parameter.lower),
        None if parameter.upper is None else float(parameter.upper),
        parameter.unit,
    )


def _words(candidate: Candidate) -> str:
    words = candidate.words
    if candidate.equivalent:
        words += "; this record cannot rule out " + " or ".join(
            kind.replace("_", " ") for kind in candidate.equivalent
        )
    if candidate.held_out is not None:
        words += (
            f"; {candidate.held_out.nats:.1f} +- {candidate.held_out.error:.1f} nats on data "
            "that was not used to fit"
        )
    return words
