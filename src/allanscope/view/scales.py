"""The scales of a chart: where a value lies between its edges, and which values get a tick."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Linear", "Log", "Scale", "Tick"]

Tick = tuple[float, str]
"""A position between 0 and 1, and its label; an empty label makes a minor tick."""

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Scale(Protocol):
    """Maps values to 0 (low edge) ... 1 (high edge) and back."""

    def place(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return where the values lie; outside 0 ... 1 when off the chart, NaN when impossible."""

    def read(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return the values that lie at these places."""

    def ticks(self) -> list[Tick]:
        """Return all ticks, ascending."""


@dataclass(frozen=True, slots=True)
class Log:
    """Whole decades from 10**low to 10**high.

    Examples
    --------
    >>> scale = Log(-2, 2)
    >>> scale.place([0.01, 1.0, 100.0]).tolist()
    [0.0, 0.5, 1.0]
    >>> Log.around([0.03, 40.0])
    Log(low=-2, high=2)
    """

    low: int
    high: int

    def __post_init__(self) -> None:
        if self.high <= self.low:
            raise ValueError(f"a scale needs low < high, got {self.low} and {self.high}")

    @classmethod
    def around(cls, values: ArrayLike, least: int = 1) -> Log:
        """Return the whole decades that hold all positive finite values; at least `least`."""
        known = np.asarray(values, np.float64)
        known = known[np.isfinite(known) & (known > 0.0)]
        if not len(known):
            return cls(0, least)
        # A value that is a decade's edge but for rounding does not open the next decade.
        low = math.floor(math.log10(known.min()) + 1e-9)
        high = math.ceil(math.log10(known.max()) - 1e-9)
        return cls(low, max(high, low + least))

    def union(self, other: Log) -> Log:
        """Return the decades of both: a chart only ever grows, so that it does not jump about."""
        return Log(min(self.low, other.low), max(self.high, other.high))

    def place(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return log10 of the values, 0 at the low edge and 1 at the high one."""
        values = np.asarray(values, np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            power = np.where(values > 0.0, np.log10(values), np.nan)
        return np.asarray((power - self.low) / (self.high - self.low))

    def read(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return the values at these places."""
        return np.asarray(10.0 ** (self.low + np.asarray(places) * (self.high - self.low)))

    def ticks(self) -> list[Tick]:
        """Return a labelled tick a decade, thinned beyond nine, and minor ones at 2 ... 9."""
        step = math.ceil((self.high - self.low) / 9)
        ticks: list[Tick] = []
        for power in range(self.low, self.high + 1):
            label = _power_of_ten(power) if (power - self.low) % step == 0 else ""
            ticks.append((self._share(power), label))
            if power < self.high and step == 1:
                ticks += [(self._share(power + math.log10(k)), "") for k in range(2, 10)]
        return ticks

    def _share(self, power: float) -> float:
        return (power - self.low) / (self.high - self.low)


@dataclass(frozen=True, slots=True)
class Linear:
    """From low to high with a labelled tick every `step`.

    Examples
    --------
    >>> [label for _, label in Linear(-20, 20, 10, "%").ticks()]
    ['-20 %', '-10 %', '0', '10 %', '20 %']
    """

    low: float
    high: float
    step: float
    unit: str = ""

    def place(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the share of the way from low to high."""
        return (np.asarray(values, np.float64) - self.low) / (self.high - self.low)

    def read(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return the values at these places."""
        return self.low + np.asarray(places, np.float64) * (self.high - self.low)

    def ticks(self) -> list[Tick]:
        """Return a tick every step."""
        number = math.floor((self.high - self.low) / self.step + 1e-9)
        values = [self.low + i * self.step for i in range(number + 1)]
        return [(float(self.place(value)), self._label(value)) for value in values]

    def _label(self, value: float) -> str:
        text = f"{round(value, 9):g}"
        return "0" if float(text) == 0.0 else f"{text} {self.unit}".rstrip()


def _power_of_ten(power: int) -> str:
    """Return 0.1, 1, 10, 100 as such, and 10 with an exponent beyond."""
    if -1 <= power <= 2:
        return f"{10.0**power:g}"
    return f"10{str(power).translate(_SUPERSCRIPT)}"
