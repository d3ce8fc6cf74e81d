r"""Dependence of the level on the measured temperature.

:math:`AVAR_y = k_T^2 AVAR_T + 2 k_T ACOV_{yT}`: in the curve it is a hump where the room varies,
swallowed by K. Spotted by GLS on the smoothed temperature (the converter's noise would attenuate
the slope), the noise refitted. It repeats with every excursion of the room, so quarters of the
record must agree.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effects.base import ALPHA, EffectKind, estimate, rescaled
from allanscope.explain.heldout import interleaved
from allanscope.explain.regression import joint_fit, marginal_covariance
from allanscope.explain.view import View

Array = NDArray[np.float64]


class Temperature(EffectKind):
    """The level follows the temperature."""

    kind = "temperature"
    meaning = "the level follows the measured temperature"
    is_slow = True
    is_drift = True
    is_thermal = True
    must_replicate = True
    needs = frozenset({"temperature"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "warm_up": "self-heating looks alike: the temperature must explain more than the clock",
        "ramp": "the temperature may drift in a straight line too",
    }

    def propose(self, view: View) -> Iterable[Candidate]:
        """Fit one slope."""
        return [] if view.has(self.kind) or view.drifts else [self.refine(view, None)]

    def refine(self, view: View, candidate: Candidate | None) -> Candidate:
        """Estimate the slope."""
        del candidate
        thermal = view.series.thermal
        assert thermal is not None
        column = _column(view)
        fit = joint_fit(view, column)
        covariance = marginal_covariance(view, column, fit)
        slope, error = float(fit.amplitude[0]), float(np.sqrt(covariance[0, 0]))
        return Candidate(
            kind="temperature",
            parameters={"slope": estimate(slope, error, f"{view.unit}/degC")},
            gain=fit.gain,
            price=float(np.log(1 / ALPHA)),
            signal=slope * thermal,
            words=f"the level follows the temperature with {slope:.3g} {view.unit}/degC",
            evidence={"temperature_span_c": float(np.ptp(thermal))},
        )

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Follow the temperature with the slope that is known."""
        thermal = view.series.thermal
        slope = candidate.number("slope")
        return candidate if thermal is None else replace(candidate, signal=slope * thermal)

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge the slope by interleaved blocks; quarters must agree."""
        del candidate
        column = _column(view)
        return interleaved(view, joint_fit(view, column), column, recurs=True)

    def columns(self, view: View, candidate: Candidate) -> Array:
        """Return the ordinates of the temperature."""
        del candidate
        return _column(view)

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the slope that a joint regression found."""
        del view
        slope = float(amplitude[0])
        again = rescaled(candidate, "slope", slope, float(np.sqrt(covariance[0, 0])))
        unit = again.parameters["slope"].unit
        return replace(again, words=f"the level follows the temperature with {slope:.3g} {unit}")


def _column(view: View) -> Array:
    ordinates = view.series.thermal_ordinates
    assert ordinates is not None
    return ordinates[np.newaxis, : view.grid.low]
