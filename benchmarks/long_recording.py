"""A long recording in little time, for the benchmarks that need a night of samples.

    python benchmarks/long_recording.py OUT.mcap [--hours 12] [--rate 6660]

The simulated SensorTile makes every sample from its physics; a night at 6.66 kHz would take it half
an hour. Here it is white noise and a random walk and nothing else: the same bytes on the wire, ten
times as fast. Both are fresh for every sample: a search for effects would find any that repeat.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from allanscope.recording import Chunk, write_recording
from allanscope.samples import AXES, Block, StreamInfo, Ticks
from allanscope.simulator import simulate_blocks

WHITE, WALK = 12.0, 6e-4
"""Counts: standard deviation of the noise, and of the step that the walk takes at each sample."""
TRUE = 0.985
"""True over nominal rate: these parts are off by some per cent."""
FRAME = 16


class Tape:
    """What `simulate_blocks` asks of a sensor: samples without end, cheaply."""

    def __init__(self, rate_hz: float) -> None:
        self.info = StreamInfo(
            AXES,
            (4.375e-3,) * 3 + (6.1e-5,) * 3,
            nominal_hz=rate_hz,
            part="LSM6DSM",
            time_resolution_s=1e-6,
            device_clock=True,
        )
        self.clock = SimpleNamespace(true_hz=TRUE * rate_hz)
        self.index = 0
        self._rng = np.random.default_rng(1)
        self._level = np.array([30.0, -50.0, 10.0, 200.0, -100.0, 16000.0])

    def read(self, n: int) -> Block:
        """Return the next `n` rows."""
        white, steps = self._rng.standard_normal((2, n, len(AXES)), dtype=np.float32)
        walk = self._level + WALK * np.cumsum(steps, axis=0, dtype=np.float64)
        self._level = walk[-1]
        counts = np.rint(WHITE * white + walk).astype(np.int16)
        offset = np.arange(0, n, FRAME)
        seconds = (self.index + offset) / self.clock.true_hz
        warm = 31.0 - 5.0 * np.exp(-seconds / 900.0) + 0.2 * np.sin(seconds / 4000.0)
        ticks = Ticks(offset, seconds, np.full(len(offset), np.nan), warm)
        block = Block(self.index, counts, ticks)
        self.index += n
        return block


def make(path: Path, hours: float, rate_hz: float) -> Path:
    """Write a recording and return its path."""
    sensor = cast(Any, Tape(rate_hz))

    def chunks() -> Iterator[Chunk]:
        for host_ns, data in simulate_blocks(hours, sensor, start_ns=1):
            yield Chunk(host_ns, data)

    return write_recording(path, chunks(), {"name": "benchmark", "wire": "native"})


def main() -> None:
    """Write one from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--hours", type=float, default=12.0)
    parser.add_argument("--rate", type=float, default=6660.0)
    arguments = parser.parse_args()
    make(arguments.out, arguments.hours, arguments.rate)


if __name__ == "__main__":
    main()
