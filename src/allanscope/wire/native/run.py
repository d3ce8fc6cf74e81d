"""Runs: data frames that follow one another without a hole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.wire.native.layout import Flag
from allanscope.wire.native.table import FrameTable

__all__ = ["Run", "runs_of"]


@dataclass(frozen=True, slots=True)
class Run:
    """Frames whose sequence numbers and indices run on, of one epoch and one set of sensors.

    Attributes
    ----------
    headers : ndarray of DATA_HEADER, shape (m,)
    samples : ndarray of int16, shape (n, 6)
    host_s : ndarray of float64, shape (m,)
        When each frame was complete.
    """

    headers: NDArray[np.void]
    samples: NDArray[np.int16]
    host_s: NDArray[np.float64]

    @property
    def epoch(self) -> int:
        """Epoch of all frames."""
        return int(self.headers["epoch"][0])

    @property
    def first_seq(self) -> int:
        """Sequence number of the first frame."""
        return int(self.headers["seq"][0])

    def __len__(self) -> int:
        return len(self.headers)

    def frames(self, start: int, stop: int) -> Run:
        """Return some of the frames as a run of its own."""
        n = self.headers["n"]
        begin = int(n[:start].sum())
        end = begin + int(n[start:stop].sum())
        return Run(self.headers[start:stop], self.samples[begin:end], self.host_s[start:stop])


def runs_of(
    table: FrameTable, host_s: NDArray[np.float64]
) -> Iterator[tuple[Run | None, bytes | None]]:
    """Yield what a table holds, in order: runs of data frames, and all other frames."""
    sample_ends = np.cumsum(table.headers["n"], dtype=np.int64)
    breaks = _breaks(table.headers) if len(table.headers) else []
    bounds = sorted({*breaks, *(other.row for other in table.others), len(table.headers)})
    others = iter(table.others)
    other = next(others, None)
    for low, high in pairwise([*bounds, bounds[-1]]):
        while other is not None and other.row == low:
            yield None, other.frame
            other = next(others, None)
        if low < high:
            begin = int(sample_ends[low - 1]) if low else 0
            samples = table.samples[begin : int(sample_ends[high - 1])]
            yield Run(table.headers[low:high], samples, host_s[low:high]), None


def _breaks(headers: NDArray[np.void]) -> list[int]:
    """Return the rows that do not simply continue the row before, the first one included."""
    if len(headers) == 1:
        return [0]
    seq, index, n = headers["seq"], headers["index"], headers["n"]
    flags = headers["flags"] & np.uint8(Flag.GYRO | Flag.ACCEL)
    joined = (
        (seq[1:] == seq[:-1] + np.uint16(1))
        & (index[1:] == index[:-1] + n[:-1])
        & (headers["epoch"][1:] == headers["epoch"][:-1])
        & (flags[1:] == flags[:-1])
    )
    return [0, *(np.flatnonzero(~joined) + 1).tolist()]
