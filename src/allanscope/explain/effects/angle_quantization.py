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
from allanscope.explain.residual import removes
from allanscope.explain.stationarity import UNSTEADY, bartlett_z_of
from allanscope.explain.view import View
from allanscope.noise.components import AngleQuantization as Differenced
from allanscope.noise.selection import Q_PENALTY

_BURSTS, _OF_THE_GAIN = 20.0, 0.02
"""Sigma by which bursts come and go (footsteps about a desk 31 to 60, an engine that idles 7 to
12), and per nat of the gain that what is there all along may."""


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
        """Return it where it removes its part of the residual and is there all along.

        Bursts of vibration near Nyquist rise towards it too, and with Q the noise below them would
        be too low.
        """
        most = min(_BURSTS, max(2 * UNSTEADY, _OF_THE_GAIN * candidate.gain))
        is_steady = bartlett_z_of(view, candidate) <= most
        return candidate if is_steady and removes(view, candidate) else None
