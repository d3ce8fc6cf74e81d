"""A dead zone: what lies near one value is replaced by it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Set y = level where it is less than half the width away from it."""
    level, half = parameters["level"], parameters["width"] / 2

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values[np.abs(values - level) < half] = level

    return apply


KIND = EffectKind(
    name="dead_zone",
    summary="samples near one value are replaced by it",
    stage="rounding",
    parameters={
        "level": Parameter("axis", "the value", 0.0),
        "width": Parameter("axis", "of the range that is replaced", above=0.0),
    },
    set_up=_set_up,
)
