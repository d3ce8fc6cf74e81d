"""Noise that is as loud as another axis is away from its rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y(t) = slope (x(t) - rest) w, x the source before any coupling, w unit white noise."""
    slope, rest, source = parameters["slope"], parameters["rest"], setting.source

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values += slope * (scene.axes[source] - rest) * setting.rng.standard_normal(len(values))

    return apply


KIND = EffectKind(
    name="amplitude_coupling",
    summary="noise whose amplitude follows another axis",
    stage="coupling",
    parameters={
        "slope": Parameter("axis/source", "standard deviation of a sample per unit of the source"),
        "rest": Parameter("source", "value of the source at which there is none", 0.0),
    },
    set_up=_set_up,
    takes_source=True,
)
