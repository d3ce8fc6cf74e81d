"""The error of the sensor's own oscillator: the true sample rate is not the nominal one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Alter no sample: the simulator itself reads true rate = nominal rate (1 + relative).

    In the course of the record that is multiplied by 1 + drift t + per_degc (T - 25 degC).
    """

    def apply(values: NDArray[Any], scene: Scene) -> None:
        pass

    return apply


KIND = EffectKind(
    name="clock_error",
    summary="true against nominal sample rate",
    stage="clock",
    parameters={
        "relative": Parameter("1", "true / nominal - 1 at the start", above=-0.5, most=0.5),
        "drift": Parameter("ppm/h", "change of the rate in an hour", 0.0, least=-1e5, most=1e5),
        "per_degc": Parameter("ppm/degC", "change of the rate", 0.0, least=-1e3, most=1e3),
    },
    set_up=_set_up,
)
