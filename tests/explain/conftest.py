"""A small record of known noise, to which a test adds what it asks about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from allanscope.history import Record

RATE = 52.0
SECONDS = 1200.0
N, K = 4e-3, 5e-5
LSB = 4.375e-3
SIGMA = N * RATE**0.5


@dataclass(frozen=True)
class Bench:
    """Noise of one or more axes, and the clock they share."""

    rng: np.random.Generator
    t: NDArray[np.float64]

    def noise(self) -> NDArray[np.float64]:
        """White noise and a random walk."""
        n = len(self.t)
        walk = np.cumsum(self.rng.normal(0, K / RATE**0.5, n))
        return self.rng.normal(0, SIGMA, n) + walk

    def gauss_markov(self, sigma: float, tc: float) -> NDArray[np.float64]:
        """Exponentially correlated noise."""
        phi = np.exp(-1 / (tc * RATE))
        e = self.rng.normal(0, sigma * np.sqrt(1 - phi**2), len(self.t))
        return np.asarray(lfilter([1], [1, -phi], e))

    def telegraph(self, amplitude: float, dwell: float) -> NDArray[np.float64]:
        """Two levels."""
        switch = self.rng.random(len(self.t)) < 1 / (dwell * RATE)
        return np.where(np.cumsum(switch) % 2, amplitude, -amplitude)

    def record(
        self,
        *columns: NDArray[np.float64],
        lsb: float = LSB,
        temperature: NDArray[np.float64] | None = None,
    ) -> Record:
        """Round to the step and wrap."""
        values = np.round(np.column_stack(columns) / lsb) * lsb
        n = len(values)
        return Record(
            rate_hz=RATE,
            stride=1,
            axes=("gx", "gy", "gz", "ax", "ay", "az")[: len(columns)],
            values=values,
            lsb=(lsb,) * len(columns),
            temperature_c=np.full(n, np.nan) if temperature is None else temperature,
            start_s=np.arange(n) / RATE,
            segments=np.array([[0, n]], np.int64),
        )


@pytest.fixture(scope="session")
def bench() -> Callable[[int], Bench]:
    """Return a maker of benches, one a seed."""

    def make(seed: int, seconds: float = SECONDS) -> Bench:
        return Bench(np.random.default_rng([seed, 4]), np.arange(int(seconds * RATE)) / RATE)

    return make
