"""The Q of the textbook: noise that was differenced, rising towards Nyquist. A coefficient.

It competes with the effects, because left out it would be sold as one of them; on a rate output a
fitted Q usually is vibration or a filter in disguise, which is why it must win the competition.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effects.base import EffectKind
from allanscope.explain.heldout import halves
from allanscope.explain.spectrum import fit_spectrum
from allanscope.explain.view import View
from allanscope.noise.components import AngleQuantization as Differenced
from allanscope.noise.selection import Q_PENALTY

Array = NDArray[np.float64]


class AngleQuantization(EffectKind):
    """Differenced white noise."""

    kind = "Q"
    meaning = "noise that was differenced (Q)"
    is_process = True
    is_coefficient = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "band_limit": "a filter takes away at the top, Q adds"
    }

    def propose(self, view: View) -> Iterable[Candidate]:
        """Fit its size."""
        if view.has(self.kind) or view.has("band_limit") or view.has("repeated_samples"):
            return
        model = view.model.plus(Differenced(1.0))
        fit = fit_spectrum(view.grid, view.power, model, excluded=view.excluded)
        yield Candidate(
            kind=self.kind,
            parameters={},
            gain=fit.loglik - view.spectrum.loglik,
            price=Q_PENALTY,
            parts=(Differenced(1.0),),
        )

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge by the two halves."""
        return halves(view, candidate)
