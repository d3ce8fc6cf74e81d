"""A coarse step: the sender rounds to more than one count."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Round to step round(y / step), before the sensor's own converter rounds to its LSB.

    While the noise is above half a step this adds white noise of step^2 / 12 per sample; below, the
    output sticks to one value and the Allan curve means nothing.
    """
    step = parameters["step"]

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values[:] = step * np.rint(values / step)

    return apply


KIND = EffectKind(
    name="quantization",
    summary="quantization coarser than the noise",
    stage="rounding",
    parameters={"step": Parameter("axis", "distance between neighbouring values", above=0.0)},
    set_up=_set_up,
)
