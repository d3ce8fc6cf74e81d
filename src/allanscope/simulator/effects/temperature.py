"""Temperature sensitivity: the axis follows the temperature of the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y = slope x + curvature x^2 with x = T - 25 degC, T being true and not its noisy reading.

    With a lag x follows T as lag dx/dt = T - 25 degC - x, in balance when the effect begins.
    """
    import numpy as np
    from scipy.signal import lfilter

    slope, curvature, lag = (parameters[name] for name in ("slope", "curvature", "lag"))
    keep = float(np.exp(-1 / (lag * setting.rate_hz))) if lag > 0 else 0.0
    state: list[float] = []

    def apply(values: NDArray[Any], scene: Scene) -> None:
        warmth = scene.temperature_c
        if keep and len(warmth):
            before = state.pop() if state else keep * float(warmth[0])
            warmth, after = lfilter([1 - keep], [1.0, -keep], warmth, zi=[before])
            state.append(float(after[0]))
        values += warmth * (slope + curvature * warmth)

    return apply


KIND = EffectKind(
    name="temperature",
    summary="dependence on the temperature of the sensor",
    stage="signal",
    parameters={
        "slope": Parameter("axis/degC", "change per degree, at 25 degC"),
        "curvature": Parameter("axis/degC^2", "change per square of degrees from 25", default=0.0),
        "lag": Parameter("s", "time constant with which it follows", default=0.0, least=0.0),
    },
    set_up=_set_up,
)
