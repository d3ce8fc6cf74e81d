"""An excursion: the level leaves and comes back, as it does when somebody touches the table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add y(t) = size for time <= t < time + duration."""
    size, back_s = parameters["size"], setting.onset_s + parameters["duration"]

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values[scene.time_s < back_s] += size

    return apply


KIND = EffectKind(
    name="excursion",
    summary="a level shift that returns",
    stage="signal",
    parameters={
        "duration": Parameter("s", "until the level comes back", above=0.0),
        "size": Parameter("axis", "signed"),
    },
    set_up=_set_up,
)
