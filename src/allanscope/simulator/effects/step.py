"""A step: the level is another one from one moment on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y(t) = size for t >= time, which is the onset that every effect has."""
    size = parameters["size"]

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values += size

    return apply


KIND = EffectKind(
    name="step",
    summary="a change of the level at one time",
    stage="signal",
    parameters={"size": Parameter("axis", "signed")},
    set_up=_set_up,
)
