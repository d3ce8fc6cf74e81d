r"""Dependence of the level on the measured temperature.

:math:`AVAR_y = k_T^2 AVAR_T + 2 k_T ACOV_{yT}`: in the curve it is a hump where the room varies,
swallowed by K. Spotted by GLS on the smoothed temperature (the converter's noise would attenuate
the slope), the noise refitted. It repeats with every excursion of the room, so quarters of the
record must agree.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import SizedSignal
from allanscope.explain.view import View

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Temperature(SizedSignal):
    """The level follows the temperature."""

    slope: Estimate
    temperature_span_c: float

    kind = "temperature"
    meaning = "the level follows the measured temperature"
    sized_by = "slope"
    is_drift = True
    is_thermal = True
    is_single = True
    must_replicate = True
    needs = frozenset({"temperature"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "warm_up": "self-heating looks alike: the temperature must explain more than the clock",
        "ramp": "the temperature may drift in a straight line too",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return f"the level follows the temperature with {self.slope.value:.3g} {self.slope.unit}"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Fit one slope."""
        span = float(np.ptp(_thermal(view)))
        return [cls(Estimate(1.0, unit=f"{view.unit}/degC"), span).measured(view, 0.0)]

    def refine(self, view: View) -> Candidate:
        """Estimate the slope again."""
        return self.measured(view, 0.0)

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Follow the temperature with the slope that is known."""
        if view.series.thermal is None:
            return candidate
        return replace(candidate, signal=self.signal(view))

    def form(self, view: View) -> Array:
        """Return the temperature."""
        return _thermal(view)

    def columns(self, view: View) -> Array:
        """Return the ordinates of the temperature."""
        ordinates = view.series.thermal_ordinates
        assert ordinates is not None
        return ordinates[np.newaxis, : view.grid.low]


def _thermal(view: View) -> Array:
    thermal = view.series.thermal
    assert thermal is not None
    return thermal
