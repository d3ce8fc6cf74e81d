"""The closed loop: what the textbook noise does not explain, found, named and put into the model.

::

    Record ──▶ series ──▶ View of one axis ──▶ search ────────────▶ merge ──▶ Explanation
               uniform     data, model,        ┌─ propose  effects/*           errors before, after
               grid        residual            ├─ judge    gates               models, coefficients
                                               ├─ move     moves/*
                                               └─ repeat until nothing passes

Every kind of effect is one file in `effects`: it looks at the residual in the domain where it
shows (the Allan curve is the figure, not the detector), proposes candidates, and the noise is
refitted with each of them, because what is missing hides itself in B and K. Nothing is accepted
whose gain is below the penalty of the search, nor what fails on data it was not fitted to, and what
no name fits is called unexplained.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.explain.effect import (
        AxisExplanation,
        Effect,
        Parameter,
        ResidualError,
        Shares,
        failed,
        failure_text,
    )
    from allanscope.explain.effects import EffectKind
    from allanscope.explain.known_effects import fit_beside
    from allanscope.explain.live import Finding, LiveLoop
    from allanscope.explain.loop import Explanation, explain
    from allanscope.explain.search import Budget

__all__ = [
    "AxisExplanation",
    "Budget",
    "Effect",
    "EffectKind",
    "Explanation",
    "Finding",
    "LiveLoop",
    "Parameter",
    "ResidualError",
    "Shares",
    "explain",
    "failed",
    "failure_text",
    "fit_beside",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "AxisExplanation": "effect",
        "Budget": "search",
        "Effect": "effect",
        "EffectKind": "effects",
        "Explanation": "loop",
        "Finding": "live",
        "LiveLoop": "live",
        "Parameter": "effect",
        "ResidualError": "effect",
        "Shares": "effect",
        "explain": "loop",
        "failed": "effect",
        "failure_text": "effect",
        "fit_beside": "known_effects",
    },
)
