"""Noise of a free slope between those of white noise, flicker and random walk."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add white noise integrated exponent / 2 times: density^2 (f / 1 Hz)^-exponent."""
    from allanscope.simulator.noise import PowerLaw

    h = parameters["density"] ** 2
    process = PowerLaw(-parameters["exponent"], h, setting.rate_hz, setting.rng)

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values += process.take(len(values))

    return apply


KIND = EffectKind(
    name="power_law",
    summary="noise whose density falls as f to minus an exponent",
    stage="signal",
    parameters={
        "exponent": Parameter("", "between 0 (white) and 2 (random walk)", above=0.0, most=2.0),
        "density": Parameter("axis/sqrt(Hz)", "at 1 Hz, as N is", above=0.0),
    },
    set_up=_set_up,
)
