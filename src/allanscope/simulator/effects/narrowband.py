"""Noise in a band: a resonance, a wandering line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add the solution of x'' + 2 pi bandwidth x' + (2 pi frequency)^2 x = white noise."""
    from allanscope.simulator.noise import Narrowband

    process = Narrowband(
        parameters["frequency"],
        parameters["bandwidth"],
        parameters["sigma"],
        setting.rate_hz,
        setting.rng,
    )

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values += process.take(len(values))

    return apply


KIND = EffectKind(
    name="narrowband",
    summary="noise in a band around one frequency",
    stage="signal",
    parameters={
        "frequency": Parameter("Hz", "of the resonance", above=0.0),
        "bandwidth": Parameter("Hz", "full width at half height", above=0.0),
        "sigma": Parameter("axis", "stationary standard deviation", above=0.0),
    },
    set_up=_set_up,
)
