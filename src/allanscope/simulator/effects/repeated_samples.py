"""Repeated samples: a reader that is faster than the sensor, or a register that freezes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Let each row be, with probability `fraction`, what was put out as the row before it.

    On white noise this makes the autocorrelation fraction^k and raises N^2 at long tau by
    (1 + fraction) / (1 - fraction).
    """
    fraction, rng = parameters["fraction"], setting.rng
    last: NDArray[Any] | None = None

    def apply(values: NDArray[Any], scene: Scene) -> None:
        nonlocal last
        repeats = rng.random(len(values)) < fraction
        if last is None:
            last = values[0].copy()
        origin = np.maximum.accumulate(np.where(repeats, -1, np.arange(len(values))))
        values[:] = np.where((origin < 0)[:, None], last, values[origin])
        last = values[-1].copy()

    return apply


KIND = EffectKind(
    name="repeated_samples",
    summary="rows that repeat the row before",
    stage="rows",
    parameters={"fraction": Parameter("1", "of all rows", above=0.0, most=0.99)},
    set_up=_set_up,
)
