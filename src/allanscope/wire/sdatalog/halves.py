"""Samples of one sensor from its packets, and samples of both sensors from those of each."""

from __future__ import annotations

import math
import struct
from collections import deque

import numpy as np

from allanscope.wire.row import ABSENT, Triple

__all__ = ["Frames", "Halves", "single"]

_SINGLE = struct.Struct("<d3h")
_COUNTER = 4
_WRAP = 1 << 32
_STAMP = 8
_ROW = 6
_LATEST_S = 1e9
_HALF = 0.5
"""Two halves of a sample are less than so many periods apart."""

_MOST_WAITING = 20_000

Half = tuple[float, Triple]
"""Time in s, and what one sensor measured then."""


def single(content: bytes) -> list[Half] | None:
    """Return the sample of a packet with one: a time and three counts; None for anything else."""
    if len(content) != _SINGLE.size:
        return None
    time_s, x, y, z = _SINGLE.unpack(content)
    return [(time_s, (x, y, z))] if 0.0 <= time_s < _LATEST_S else None


class Frames:
    """The samples of one sensor in binary data of HSDatalog.

    A packet is a counter of bytes, up to its end, and a piece of a stream of frames: `rows` samples
    and the time of the last one. Where the counter jumps, frames are missing, and it tells where
    the next one begins.

    Parameters
    ----------
    rows : int
        Samples of a frame.
    period_s : float
        Nominal, for the times of the samples of a first frame.
    """

    def __init__(self, rows: int, period_s: float) -> None:
        self._rows = rows
        self._size = rows * _ROW + _STAMP
        self._period_s = period_s
        self._held = bytearray()
        self._position = -1
        self._skip = 0
        self._last_s = math.nan

    def take(self, content: bytes) -> list[Half]:
        """Return the samples that a packet completes."""
        counter, data = int.from_bytes(content[:_COUNTER], "little"), content[_COUNTER:]
        if not data:
            return []
        before = max(self._position, 0)
        end = before + (counter - before) % _WRAP
        begin = end - len(data)
        if begin != self._position:
            self._held.clear()
            self._skip = -begin % self._size
            self._last_s = math.nan
        self._position = end
        self._held += data[self._skip :]
        self._skip = max(self._skip - len(data), 0)
        found: list[Half] = []
        while len(self._held) >= self._size:
            found += self._frame(bytes(self._held[: self._size]))
            del self._held[: self._size]
        return found

    def _frame(self, frame: bytes) -> list[Half]:
        (last_s,) = struct.unpack_from("<d", frame, self._rows * _ROW)
        if not 0.0 <= last_s < _LATEST_S:
            self._last_s = math.nan
            return []
        step = (last_s - self._last_s) / self._rows
        if not 0.0 < step < 2 * self._period_s:
            step = self._period_s
        self._last_s = last_s
        counts = np.frombuffer(frame[:-_STAMP], "<i2").reshape(-1, 3).tolist()
        ago = range(self._rows - 1, -1, -1)
        return [(last_s - step * i, (x, y, z)) for i, (x, y, z) in zip(ago, counts, strict=True)]


class Halves:
    """Samples of a gyroscope and of an accelerometer to rows of six values.

    Those of one time belong together. One without its partner is given up: the time of the next row
    tells that it is missing.

    Parameters
    ----------
    kinds : tuple of str
        Of the sensors that are on: ``gyro``, ``acc``.
    period_s : float
        Nominal.
    """

    def __init__(self, kinds: tuple[str, ...], period_s: float) -> None:
        self._waiting: dict[str, deque[Half]] = {
            kind: deque(maxlen=_MOST_WAITING) for kind in kinds
        }
        self._apart_s = _HALF * period_s

    def take(self, kind: str, halves: list[Half]) -> list[tuple[tuple[float, ...], float]]:
        """Return the rows that these samples complete, with their times."""
        if len(self._waiting) == 1:
            if kind == "gyro":
                return [((*triple, *ABSENT), time_s) for time_s, triple in halves]
            return [((*ABSENT, *triple), time_s) for time_s, triple in halves]
        waiting = self._waiting[kind]
        for half in halves:
            if waiting and half[0] < waiting[-1][0]:  # the board was restarted
                for each in self._waiting.values():
                    each.clear()
            waiting.append(half)
        gyro, accel = self._waiting["gyro"], self._waiting["acc"]
        rows: list[tuple[tuple[float, ...], float]] = []
        while gyro and accel:
            later = gyro[0][0] - accel[0][0]
            if abs(later) <= self._apart_s:
                (one_s, rates), (other_s, forces) = gyro.popleft(), accel.popleft()
                rows.append(((*rates, *forces), min(one_s, other_s)))
            else:
                (accel if later > 0.0 else gyro).popleft()
        return rows
