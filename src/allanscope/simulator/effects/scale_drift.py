"""A scale that drifts: the noise of a sensor grows or fades in a straight line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Multiply by s(t) = 1 + relative (t - onset) / T, T the time from the onset to the end."""
    length = max(setting.duration_s - setting.onset_s, 1.0 / setting.rate_hz)
    slope = parameters["relative"] / length

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values *= 1.0 + slope * (scene.time_s - setting.onset_s)

    return apply


KIND = EffectKind(
    name="scale_drift",
    summary="a linear drift of the scale factor, of white and slow noise alike",
    stage="noise",
    parameters={
        "relative": Parameter("1", "change of the scale at the end of the record", least=-1.0)
    },
    set_up=_set_up,
)
