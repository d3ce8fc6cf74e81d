"""What simulated devices share: times and temperatures of rows, milli-units, and saying nothing."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import AXES, Block, StreamInfo
from allanscope.wire.base import Command
from allanscope.wire.milli_units import truncate

__all__ = ["OneWayEncoder", "milli_units", "temperatures", "times"]


class OneWayEncoder:
    """A device that only sends samples: it has no status, and whatever it is told it ignores."""

    silent_until_started: ClassVar[bool] = False

    def __init__(self, info: StreamInfo) -> None:
        self._info = info

    def samples_per_frame(self, rate_hz: float) -> int:
        """Return 1: each sample is sent by itself."""
        return 1

    def describe(self, info: StreamInfo) -> bytes:
        """Take note of the scales; the format has no words for them."""
        self._info = info
        return b""

    def status(self, produced: int, sent: int, dropped: int, uptime_s: float) -> bytes:
        """Return nothing: such a device does not know what it lost."""
        return b""

    def receive(self, data: bytes) -> list[Command]:
        """Return nothing: such a device does not listen."""
        return []

    def reply(self, command: Command, ok: bool = True) -> bytes:
        """Return nothing."""
        return b""


def times(block: Block, rows: NDArray[np.int64], nominal_hz: float) -> NDArray[np.float64]:
    """Return the device time of some rows of a block, in seconds.

    Interpolated between the ticks; beyond them, or without any, carried on at the nominal rate.
    """
    period = 1.0 / nominal_hz if nominal_hz else 0.0
    known = np.isfinite(block.ticks.device_s)
    if not known.any():
        return np.asarray((block.index + rows) * period, np.float64)
    offsets, seconds = block.ticks.offset[known], block.ticks.device_s[known]
    beyond = np.maximum(rows - offsets[-1], 0) + np.minimum(rows - offsets[0], 0)
    found = np.interp(rows, offsets, seconds) + beyond * period
    return np.asarray(np.maximum(found, 0.0), np.float64)


def temperatures(block: Block, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the temperature at some rows of a block, interpolated; NaN when it has none."""
    known = np.isfinite(block.ticks.temperature_c)
    if not known.any():
        return np.full(len(rows), np.nan)
    offsets, degrees = block.ticks.offset[known], block.ticks.temperature_c[known]
    return np.asarray(np.interp(rows, offsets, degrees), np.float64)


def milli_units(block: Block, info: StreamInfo) -> NDArray[np.int64]:
    """Return counts as stock firmware sends them: mdps and mg, cut, shape (n, 6), absent ones 0."""
    sent = np.zeros((len(block), len(AXES)), np.int64)
    columns = [AXES.index(axis) for axis in info.axes]
    sent[:, columns] = truncate(block.counts, np.round(np.asarray(info.scale) * 1e3, 6))
    return sent
