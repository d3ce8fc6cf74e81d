"""Cross-coupling: one axis shows a share of another."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y(t) = slope x(t), x being the source axis before any coupling, level and all.

    With an accelerometer as the source of a gyro axis this is g-sensitivity.
    """
    slope, source = parameters["slope"], setting.source

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values += slope * scene.axes[source]

    return apply


KIND = EffectKind(
    name="cross_coupling",
    summary="a share of another axis",
    stage="coupling",
    parameters={"slope": Parameter("axis/source", "change per unit of the source")},
    set_up=_set_up,
    takes_source=True,
)
