"""A line: vibration, mains pick-up, an alias, a daily cycle."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y(t) = amplitude sin(2 pi frequency t + phase), the phase drawn at random.

    AVAR(tau) = amplitude^2 sin^4(pi f tau) / (m^2 sin^2(pi f t0)), averaged over the phase.
    A frequency above half the sample rate is folded back, as in a sensor without a filter.
    A line that is locked is made by the sensor's own clock: it goes with the number of the sample.
    """
    amplitude, omega = parameters["amplitude"], 2.0 * pi * parameters["frequency"]
    phase = setting.rng.uniform(0.0, 2.0 * pi)

    def apply(values: NDArray[Any], scene: Scene) -> None:
        time_s = scene.time_s
        if parameters["locked"]:
            time_s = (scene.first + np.arange(len(values))) / setting.rate_hz
        values += amplitude * np.sin(omega * time_s + phase)

    return apply


KIND = EffectKind(
    name="sinusoid",
    summary="a line at one frequency",
    stage="signal",
    parameters={
        "frequency": Parameter("Hz", "of the line", above=0.0),
        "amplitude": Parameter("axis", "peak", above=0.0),
        "locked": Parameter("1", "1: of the sensor's own clock", 0.0, least=0.0, most=1.0),
    },
    set_up=_set_up,
)
