"""A shock: something is knocked and rings for a moment."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]

_CYCLES = 6.0
"""Of the ringing within the duration, after which it has decayed to a percent."""
_DECAYS = 4.6


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add peak exp(-x) cos(2 pi f t) from the time of the shock on."""
    duration, peak, begin = parameters["duration"], parameters["peak"], setting.onset_s

    def apply(values: NDArray[Any], scene: Scene) -> None:
        t = np.maximum(scene.time_s - begin, 0.0) / duration
        values += peak * np.exp(-_DECAYS * t) * np.cos(2 * pi * _CYCLES * t)

    return apply


KIND = EffectKind(
    name="shock",
    summary="a knock that rings",
    stage="signal",
    parameters={
        "duration": Parameter("s", "until it has decayed to a few percent", above=0.0),
        "peak": Parameter("axis", "signed"),
    },
    set_up=_set_up,
)
