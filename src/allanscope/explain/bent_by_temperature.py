"""A level that follows the temperature, but not in a straight line.

A room that swings around the turning point of a parabola makes the level swing twice as fast, at
constant amplitude: a line, if one looks at the level alone. The vocabulary has a slope only, so
what the square of the temperature explains as well as a line or a process does is `unexplained`.
"""

from __future__ import annotations

import numpy as np

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.unexplained import DRIFT_PENALTY, slow_drift
from allanscope.explain.regression import joint_fit, ordinates_of
from allanscope.explain.view import View

__all__ = ["bent_by_temperature"]

_AS_WELL = 0.9
"""Share of the gain: the temperature is known less well than the level."""
_MOST_OF_IT = 0.99
"""Share of the power of the square that is called its range of frequencies."""


def bent_by_temperature(view: View, candidate: Candidate) -> Candidate | None:
    """Return what the square of the temperature explains of a candidate; None if it is less."""
    thermal = view.series.thermal
    if thermal is None or view.drifts:
        return None
    m = view.grid.low
    square = thermal**2 - np.mean(thermal**2)
    ordinates = ordinates_of(square)
    power = np.cumsum(ordinates**2)
    last = int(np.searchsorted(power, _MOST_OF_IT * power[-1]))
    if last >= m:
        return None
    assert view.series.thermal_ordinates is not None
    straight = view.series.thermal_ordinates[:m]
    bent = joint_fit(view, np.array([straight, ordinates[:m]]))
    gain = bent.gain - joint_fit(view, straight[np.newaxis]).gain
    if gain < max(_AS_WELL * candidate.gain, DRIFT_PENALTY):
        return None
    slope, curvature = bent.amplitude
    drift = slope * thermal + curvature * square
    high = (last + 1.5) * view.grid.rate_hz / (2 * view.grid.n)
    words = (
        f"the level follows the temperature in a curve, with {curvature:.3g} {view.unit}/degC^2: "
        "no slope describes it"
    )
    return slow_drift(view, drift, bent.gain, high, words)
