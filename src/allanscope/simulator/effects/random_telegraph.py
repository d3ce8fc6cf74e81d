"""Random telegraph noise: one defect that switches between two states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y(t) = +-amplitude, switching after exponentially distributed times of mean `dwell`.

    Seen at the samples it is a Markov chain that has switched since the sample before with
    probability (1 - exp(-2 t0 / dwell)) / 2. Its autocovariance amplitude^2 exp(-2 |t| / dwell) is
    that of Gauss-Markov noise of correlation time dwell / 2: no spectrum tells the two apart.
    """
    amplitude, rng = parameters["amplitude"], setting.rng
    switch = -0.5 * np.expm1(-2.0 / (setting.rate_hz * parameters["dwell"]))
    level = int(rng.integers(2))

    def apply(values: NDArray[Any], scene: Scene) -> None:
        nonlocal level
        states = (level + np.cumsum(rng.random(len(values)) < switch)) & 1
        level = int(states[-1])
        values += amplitude * (2.0 * states - 1.0)

    return apply


KIND = EffectKind(
    name="random_telegraph",
    summary="switching between two levels at random times",
    stage="signal",
    parameters={
        "amplitude": Parameter("axis", "half the distance between the levels", above=0.0),
        "dwell": Parameter("s", "mean time in one level", above=0.0),
    },
    set_up=_set_up,
)
