"""Effects of the converter and of what reads it: rounding, clipping, repeats, the clock.

- A coarse step: the sender rounds to more than one count.
- A dead zone: what lies near one value is replaced by it.
- Saturation: a range that ends before the signal does, inside that of the converter.
- Repeated samples: a reader that is faster than the sensor, or a register that freezes.
- The error of the sensor's own oscillator: the true sample rate is not the nominal one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, Conditions, EffectContext, Parameter, effect

__all__ = ["clock_error", "dead_zone", "quantization", "repeated_samples", "saturation"]


@effect(
    "quantization",
    "quantization coarser than the noise",
    "rounding",
    step=Parameter("axis", "distance between neighbouring values", above=0.0),
)
def quantization(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Round to step round(y / step), before the sensor's own converter rounds to its LSB.

    While the noise is above half a step this adds white noise of step^2 / 12 per sample; below, the
    output sticks to one value and the Allan curve means nothing.
    """
    step = parameters["step"]

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values[:] = step * np.rint(values / step)

    return apply


@effect(
    "dead_zone",
    "samples near one value are replaced by it",
    "rounding",
    level=Parameter("axis", "the value", 0.0),
    width=Parameter("axis", "of the range that is replaced", above=0.0),
)
def dead_zone(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Set y = level where it is less than half the width away from it."""
    level, half = parameters["level"], parameters["width"] / 2

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values[np.abs(values - level) < half] = level

    return apply


@effect(
    "saturation",
    "a limit at which samples are clipped",
    "rounding",
    level=Parameter("axis", "the limit"),
    side=Parameter("1", "1 cuts what is above, -1 what is below", 1.0, least=-1.0, most=1.0),
)
def saturation(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Cut off y = min(y, level), or with side = -1 y = max(y, level)."""
    level = parameters["level"]
    cut = np.minimum if parameters["side"] > 0 else np.maximum

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        cut(values, level, out=values)

    return apply


@effect(
    "repeated_samples",
    "rows that repeat the row before",
    "rows",
    fraction=Parameter("1", "of all rows", above=0.0, most=0.99),
)
def repeated_samples(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Let each row be, with probability `fraction`, what was put out as the row before it.

    On white noise this makes the autocorrelation fraction^k and raises N^2 at long tau by
    (1 + fraction) / (1 - fraction).
    """
    fraction, rng = parameters["fraction"], context.rng
    last: NDArray[Any] | None = None

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        nonlocal last
        repeats = rng.random(len(values)) < fraction
        if last is None:
            last = values[0].copy()
        origin = np.maximum.accumulate(np.where(repeats, -1, np.arange(len(values))))
        values[:] = np.where((origin < 0)[:, None], last, values[origin])
        last = values[-1].copy()

    return apply


@effect(
    "clock_error",
    "true against nominal sample rate",
    "clock",
    relative=Parameter("1", "true / nominal - 1 at the start", above=-0.5, most=0.5),
    drift=Parameter("ppm/h", "change of the rate in an hour", 0.0, least=-1e5, most=1e5),
    per_degc=Parameter("ppm/degC", "change of the rate", 0.0, least=-1e3, most=1e3),
)
def clock_error(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Alter no sample: the simulator itself reads true rate = nominal rate (1 + relative).

    In the course of the record that is multiplied by 1 + drift t + per_degc (T - 25 degC).
    """

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        pass

    return apply
