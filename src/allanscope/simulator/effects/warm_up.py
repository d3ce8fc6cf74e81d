"""A warm-up: an offset that dies away after power-on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y(t) = amplitude exp(-(t - time) / time_constant)."""
    amplitude, time_constant = parameters["amplitude"], parameters["time_constant"]

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values += amplitude * np.exp((setting.onset_s - scene.time_s) / time_constant)

    return apply


KIND = EffectKind(
    name="warm_up",
    summary="an offset that decays exponentially",
    stage="signal",
    parameters={
        "time_constant": Parameter("s", "of the decay", above=0.0),
        "amplitude": Parameter("axis", "at its start, signed"),
    },
    set_up=_set_up,
)
