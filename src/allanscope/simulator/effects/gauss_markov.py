"""First-order Gauss-Markov noise on top of the noise floor: a fluctuation with one memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Add noise that is stationary with autocovariance sigma^2 exp(-|t| / correlation_time)."""
    from allanscope.simulator.noise import GaussMarkov

    process = GaussMarkov(
        parameters["sigma"], parameters["correlation_time"], setting.rate_hz, setting.rng
    )

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values += process.take(len(values))

    return apply


KIND = EffectKind(
    name="gauss_markov",
    summary="exponentially correlated noise with one time constant",
    stage="signal",
    parameters={
        "sigma": Parameter("axis", "stationary standard deviation", above=0.0),
        "correlation_time": Parameter("s", "to 1/e", above=0.0),
    },
    set_up=_set_up,
)
