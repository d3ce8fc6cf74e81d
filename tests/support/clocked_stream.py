"""Streams whose true rate is known, as a host sees them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.clock import Clock
from allanscope.samples import Ticks

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Stream:
    """Frames of samples and the host times at which they were read."""

    true_hz: float
    index: NDArray[np.int64]
    taken_s: Floats
    host_s: Floats

    def feed(
        self,
        clock: Clock,
        *,
        block_s: float = 1.0,
        device_s: Floats | None = None,
        host: bool = True,
    ) -> None:
        """Give it to a clock in blocks."""
        nothing = np.full(len(self.index), np.nan)
        host_s = self.host_s if host else nothing
        device_s = nothing if device_s is None else device_s
        length = max(1, round(block_s * len(self.index) / np.ptp(self.taken_s)))
        for start in range(0, len(self.index), length):
            rows = slice(start, start + length)
            first = int(self.index[start])
            offset = self.index[rows] - first
            clock.update(first, Ticks(offset, device_s[rows], host_s[rows], nothing[rows]))


def stream(
    seed: int,
    nominal_hz: float,
    duration_s: float,
    *,
    frame: int = 1,
    jitter_s: float = 1e-3,
    poll_s: float = 0.0,
    off: float | None = None,
    drift_per_s: float = 0.0,
) -> Stream:
    """Return a stream whose frames wait exponentially, and then for the next poll of the host.

    Parameters
    ----------
    off : float, optional
        Relative error of the oscillator; up to 7 % either way if not given.
    drift_per_s : float
        Relative change of the rate in a second.
    """
    source = np.random.default_rng(seed)
    true_hz = nominal_hz * (1.0 + (source.uniform(-0.07, 0.07) if off is None else off))
    index = np.arange(0, int(duration_s * true_hz), frame, dtype=np.int64)
    taken = index / true_hz
    taken = taken - 0.5 * drift_per_s * taken * (taken - duration_s)
    seen = np.maximum.accumulate(taken + frame / true_hz + source.exponential(jitter_s, len(index)))
    if poll_s:
        phase = source.uniform(0.0, poll_s)
        number = np.ceil((seen - phase) / poll_s).astype(np.int64)
        late = source.exponential(5e-5, int(number.max()) + 1)
        seen = number * poll_s + phase + late[number]
    return Stream(true_hz, index, taken, seen + 1e5)
