"""The ramp R of the textbook: a coefficient, not an effect, but it competes with the slow effects.

Left out of the competition, a ramp would be sold as the tail of a warm-up or as part of K.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.base import ALPHA, EffectKind, estimate, rescaled
from allanscope.explain.regression import joint_fit, marginal_covariance, ramp_ordinates
from allanscope.explain.view import View

Array = NDArray[np.float64]


class Ramp(EffectKind):
    """A straight drift."""

    kind = "ramp"
    meaning = "the level drifts in a straight line (R)"
    is_slow = True
    is_drift = True
    is_piecewise = True
    is_coefficient = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "warm_up": "bends",
        "temperature": "follows the measured temperature",
    }

    def propose(self, view: View) -> Iterable[Candidate]:
        """Fit one slope."""
        return [] if view.has(self.kind) or view.drifts else [self.refine(view, None)]

    def refine(self, view: View, candidate: Candidate | None) -> Candidate:
        """Estimate the slope."""
        del candidate
        t = np.arange(view.grid.n) / view.grid.rate_hz
        column = ramp_ordinates(view.grid, view.grid.low)[np.newaxis]
        fit = joint_fit(view, column)
        covariance = marginal_covariance(view, column, fit)
        slope, error = float(fit.amplitude[0]), float(np.sqrt(covariance[0, 0]))
        return Candidate(
            kind="ramp",
            parameters={"R": estimate(slope, error, f"{view.unit}/s")},
            gain=fit.gain,
            price=float(np.log(1 / ALPHA)),
            signal=slope * (t - t.mean()),
        )

    def columns(self, view: View, candidate: Candidate) -> Array:
        """Return the ordinates of the time."""
        del candidate
        return ramp_ordinates(view.grid, view.grid.low)[np.newaxis]

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the slope that a joint regression found."""
        del view
        return rescaled(candidate, "R", float(amplitude[0]), float(np.sqrt(covariance[0, 0])))

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate the slope again: it does not end."""
        return self.refine(view, candidate)
