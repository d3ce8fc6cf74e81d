"""A line that drifts: a fan, a pump, a building, whose frequency and amplitude change slowly."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]

_PERIOD_S, _SWELL_S = 610.0, 430.0
"""Of the frequency and of the amplitude; no multiple of each other."""
_SWELL = 0.3
_HOLDS = 0.988
"""Part of its range in which a sine is for 90 % of the time."""


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add a tone whose frequency swings as a sine, for 90 % of the time within the bandwidth.

    The amplitude swells and fades by 30 %, with the rms amplitude sigma over many periods.
    """
    frequency, sigma = parameters["frequency"], parameters["sigma"]
    reach = parameters["bandwidth"] / 2 / _HOLDS
    start, swing, swell = setting.rng.uniform(0.0, 2 * pi, 3)
    peak = sigma * sqrt(2 / (1 + _SWELL**2 / 2))

    def apply(values: NDArray[Any], scene: Scene) -> None:
        t = scene.time_s
        phase = 2 * pi * frequency * t + start
        phase -= reach * _PERIOD_S * np.cos(2 * pi * t / _PERIOD_S + swing)
        envelope = 1 + _SWELL * np.sin(2 * pi * t / _SWELL_S + swell)
        values += peak * envelope * np.sin(phase)

    return apply


KIND = EffectKind(
    name="drifting_line",
    summary="a line whose frequency and amplitude change slowly",
    stage="signal",
    parameters={
        "frequency": Parameter("Hz", "centre of the range", above=0.0),
        "bandwidth": Parameter("Hz", "range of the frequency in 90 % of the time", above=0.0),
        "sigma": Parameter("axis", "rms amplitude", above=0.0),
    },
    set_up=_set_up,
)
