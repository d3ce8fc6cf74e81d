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
from allanscope.explain.effects.base import ALPHA, EffectKind
from allanscope.explain.heldout import halves
from allanscope.explain.spectral import Term, fit_spectrum
from allanscope.explain.view import View

Array = NDArray[np.float64]


def differenced(frequency: Array, rate: float, _nonlinear: tuple[float, ...]) -> Array:
    """Variance of an ordinate for a unit Q^2."""
    return np.asarray((2 * rate * np.sin(np.pi * frequency / rate)) ** 2)


class AngleQuantization(EffectKind):
    """Differenced white noise."""

    kind = "Q"
    meaning = "noise that was differenced (Q)"
    confused_with: ClassVar[Mapping[str, str]] = {
        "band_limit": "a filter takes away at the top, Q adds"
    }

    def propose(self, view: View) -> Iterable[Candidate]:
        """Fit its size."""
        if view.has(self.kind) or view.has("band_limit") or view.has("repeated_samples"):
            return
        term = Term(self.kind, "adds", (), differenced)
        fit = fit_spectrum(
            view.grid,
            view.power,
            base=view.base,
            terms=(*view.terms, term),
            floor=view.fitted_floor,
        )
        yield Candidate(
            kind=self.kind,
            parameters={},
            gain=fit.loglik - view.spectrum.loglik,
            price=float(np.log(2 / ALPHA)),
            terms=(term,),
        )

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge by the two halves."""
        return halves(view, view.terms + candidate.terms)
