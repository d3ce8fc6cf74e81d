"""Saturation: a range that ends before the signal does, inside that of the converter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Cut off y = min(y, level), or with side = -1 y = max(y, level)."""
    level = parameters["level"]
    cut = np.minimum if parameters["side"] > 0 else np.maximum

    def apply(values: NDArray[Any], scene: Scene) -> None:
        cut(values, level, out=values)

    return apply


KIND = EffectKind(
    name="saturation",
    summary="a limit at which samples are clipped",
    stage="rounding",
    parameters={
        "level": Parameter("axis", "the limit"),
        "side": Parameter("1", "1 cuts what is above, -1 what is below", 1.0, least=-1.0, most=1.0),
    },
    set_up=_set_up,
)
