"""Temperature sensitivity: the axis follows the temperature of the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y(t) = slope (T(t) - 25 degC), T the true temperature, not its noisy reading."""
    slope = parameters["slope"]

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values += slope * scene.temperature_c

    return apply


KIND = EffectKind(
    name="temperature",
    summary="dependence on the temperature of the sensor",
    stage="signal",
    parameters={"slope": Parameter("axis/degC", "change per degree")},
    set_up=_set_up,
)
