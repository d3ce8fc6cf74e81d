"""The ramp R of the textbook: a coefficient, not an effect, but it competes with the slow effects.

Left out of the competition, a ramp would be sold as the tail of a warm-up or as part of K.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import SizedSignal
from allanscope.explain.regression import ramp_ordinates
from allanscope.explain.view import View

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ramp(SizedSignal):
    """A straight drift."""

    R: Estimate

    kind = "ramp"
    meaning = "the level drifts in a straight line (R)"
    sized_by = "R"
    is_drift = True
    is_piecewise = True
    is_coefficient = True
    is_single = True
    is_rival = False
    confused_with: ClassVar[Mapping[str, str]] = {
        "warm_up": "bends",
        "temperature": "follows the measured temperature",
    }

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Fit one slope."""
        return [cls(Estimate(1.0, unit=f"{view.unit}/s")).ranked(view, 0.0)]

    def refine(self, view: View) -> Candidate:
        """Estimate the slope again."""
        return self.measured(view, 0.0)

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate the slope again: it does not end."""
        del candidate
        return self.refine(view)

    def hold_out(self, view: View, candidate: Candidate) -> None:
        """Judge a coefficient of the textbook by its penalty alone."""
        del view, candidate

    def form(self, view: View) -> Array:
        """Return the time from the middle of the record."""
        t = np.arange(view.grid.n) / view.grid.rate_hz
        return np.asarray(t - t.mean())

    def columns(self, view: View) -> Array:
        """Return the ordinates of the time."""
        return ramp_ordinates(view.grid, view.grid.low)[np.newaxis]
