"""The table of frames: where the plain reader and the batch reader meet.

Both turn bytes into the same table, and everything that has meaning (epochs, losses, scales) is
worked out from the table alone. So the fast way cannot say anything else than the plain one. It is
taken run by run: a `Run` is data frames that follow one another without a gap.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.wire.native.layout import (
    DATA_HEADER,
    MOST_SAMPLES,
    SAMPLE_BYTES,
    VERSION_MAJOR,
    Flag,
    FrameType,
)

__all__ = ["FrameTable", "OtherFrame", "Run", "runs_of", "table_of"]


@dataclass(frozen=True, slots=True)
class OtherFrame:
    """A sound frame that is no well-formed data frame.

    Attributes
    ----------
    row : int
        Number of data frames before it.
    frame : bytes
        All of it, without its CRC.
    """

    row: int
    frame: bytes


@dataclass(frozen=True, slots=True)
class FrameTable:
    """Frames in the order in which they came.

    Attributes
    ----------
    headers : ndarray of DATA_HEADER, shape (m,)
        One row a data frame.
    samples : ndarray of int16, shape (n, 6)
        The samples of all data frames, one after another.
    ends : ndarray of int64, shape (m,)
        Position after the final zero of each data frame, in the bytes that were read.
    others : list of OtherFrame
        Everything that is not data.
    """

    headers: NDArray[np.void]
    samples: NDArray[np.int16]
    ends: NDArray[np.int64]
    others: list[OtherFrame]


def _is_data(frame: bytes) -> bool:
    """Return whether a frame without its CRC is data of this version, of the length it claims."""
    return (
        frame[0] == FrameType.DATA
        and frame[1] >> 4 == VERSION_MAJOR
        and 1 <= frame[7] <= MOST_SAMPLES
        and len(frame) == DATA_HEADER.itemsize + SAMPLE_BYTES * frame[7]
    )


def table_of(frames: Iterable[tuple[bytes, int]]) -> FrameTable:
    """Return the table of frames, given each without its CRC and with the position of its end."""
    data: list[bytes] = []
    ends: list[int] = []
    others: list[OtherFrame] = []
    for frame, end in frames:
        if _is_data(frame):
            data.append(frame)
            ends.append(end)
        else:
            others.append(OtherFrame(len(data), frame))
    split = DATA_HEADER.itemsize
    headers = np.frombuffer(b"".join([frame[:split] for frame in data]), DATA_HEADER)
    samples = np.frombuffer(b"".join([frame[split:] for frame in data]), "<i2")
    return FrameTable(headers, samples.reshape(-1, 6), np.asarray(ends, np.int64), others)


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
