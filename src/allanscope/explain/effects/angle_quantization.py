"""The Q of the textbook: noise that was differenced, rising towards Nyquist. A coefficient.

It competes with the effects, because left out it would be sold as one of them; on a rate output a
fitted Q usually is vibration or a filter in disguise, which is why it must win the competition.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.unexplained import lasting
from allanscope.explain.view import View
from allanscope.noise.components import AngleQuantization as Differenced
from allanscope.noise.selection import Q_PENALTY


@dataclass(frozen=True)
class AngleQuantization(EffectKind):
    """Differenced white noise."""

    kind = "Q"
    meaning = "noise that was differenced (Q)"
    is_process = True
    is_coefficient = True
    is_single = True
    excluded_by = frozenset({"band_limit", "repeated_samples"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "band_limit": "a filter takes away at the top, Q adds"
    }

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Fit its size."""
        yield Candidate(
            cls(),
            view.loglik_with(Differenced(1.0)) - view.spectrum.loglik,
            Q_PENALTY + float(np.log(ALPHA)),
            parts=(Differenced(1.0),),
        )

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return whether it removes its part of the residual."""
        return lasting(view, candidate)
