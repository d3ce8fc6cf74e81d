"""The table of frames, by the plain reader (`table_of`) or the compiled one (`batch_table`).

Both turn bytes into the same table, and everything that has meaning (epochs, losses, scales) is
worked out from the table alone. So the fast way cannot say anything else than the plain one. It is
taken run by run: a `Run` is data frames that follow one another without a gap.

The compiled reader does COBS, CRC-32 and the split into columns at several hundred megabytes a
second, for replays of whole nights. Two ideas make it fast. First, the distances of COBS are
walked, not searched, and the frame is then copied in one piece; only when the walk leads nowhere is
the chunk searched for its final zero. Second, the CRC takes eight bytes at a step from eight tables
("slicing by eight", Kounavis and Berry, 2005).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import Pointer, kernel
from allanscope.wire.native.framing import Deframer
from allanscope.wire.native.layout import (
    CRC_BYTES,
    DATA_HEADER,
    HEADER_BYTES,
    MOST_SAMPLES,
    SAMPLE_BYTES,
    VERSION_MAJOR,
    Flag,
    FrameType,
)

__all__ = ["FrameTable", "OtherFrame", "Run", "batch_table", "runs_of", "table_of"]


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


_SHORTEST_DATA = 2 + DATA_HEADER.itemsize + SAMPLE_BYTES + CRC_BYTES
_SHORTEST_OTHER = 2 + HEADER_BYTES + CRC_BYTES


def _crc_tables() -> NDArray[np.uint32]:
    """Return the eight tables of the zlib CRC-32, shape (8, 256).

    Table k advances a byte that k more bytes follow; table 0 is the classic one.
    """
    tables = np.zeros((8, 256), np.uint32)
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
        tables[0, byte] = crc
    for k in range(1, 8):
        previous = tables[k - 1]
        tables[k] = previous >> 8 ^ tables[0, previous & 0xFF]
    return tables


_TABLES = _crc_tables()


_BYTES_OUT = Pointer(np.uint8, 1, written=True)
_INTS_OUT = Pointer(np.int64, 1, written=True)
_read_frames = kernel(
    "read_frames",
    *(Pointer(np.uint8, 1), int, int, Pointer(np.uint32, 2)),
    *(_BYTES_OUT, _INTS_OUT, _BYTES_OUT, _BYTES_OUT, _INTS_OUT, _INTS_OUT, _INTS_OUT),
)
"""Read all complete frames of a buffer that starts at the beginning of a chunk.

Parameters
----------
data : ndarray of uint8
size : int
    Its bytes.
joining : int
    Whether the first chunk may be the tail of a frame.
tables : ndarray of uint32, shape (8, 256)
    From `_crc_tables`.
headers : ndarray of uint8
    Receives the first 26 bytes of each data frame, one after another.
ends : ndarray of int64
    Receives, for each data frame, the position after its final zero.
samples : ndarray of uint8
    Receives the samples of each data frame.
others : ndarray of uint8
    Receives all other frames, without CRC, one after another.
other_rows, other_ends : ndarray of int64
    Receive the number of data frames before each of them, and its end in `others`.
found : ndarray of int64, shape (8,)
    Receives rows, sample_bytes, other_count, crc_errors, malformed, consumed, joining, overlong:
    `consumed` is where the first incomplete chunk starts. `overlong` tells that it is already
    longer than a frame can be.
"""


def batch_table(deframer: Deframer, data: bytes) -> FrameTable:
    """Return what ``table_of(deframer.feed(data))`` would, and leave the same state behind."""
    if deframer.overlong:
        # The rest of a chunk that is too long to be a frame: throw away up to its end.
        skipped = data.find(b"\0") + 1
        if skipped == 0:
            return _empty()
        deframer.overlong = deframer.joining = False
        deframer.malformed += 1
        buffer = bytearray(data[skipped:])
        offset = skipped
    else:
        buffer = deframer.partial + data
        offset = -len(deframer.partial)
    size = len(buffer)
    headers, samples, others = (np.empty(size, np.uint8) for _ in range(3))
    ends = np.empty(size // _SHORTEST_DATA + 1, np.int64)
    other_rows, other_ends = (np.empty(size // _SHORTEST_OTHER + 1, np.int64) for _ in range(2))
    found = np.empty(8, np.int64)
    _read_frames(
        np.frombuffer(buffer, np.uint8),
        *(size, deframer.joining, _TABLES, headers, ends, samples),
        *(others, other_rows, other_ends, found),
    )
    rows, filled, count, crc_errors, malformed, consumed, joining, overlong = found.tolist()
    deframer.crc_errors += crc_errors
    deframer.malformed += malformed
    deframer.joining = bool(joining)
    deframer.overlong = bool(overlong)
    deframer.partial = bytearray() if overlong else buffer[consumed:]
    return FrameTable(
        headers=headers[: rows * DATA_HEADER.itemsize].view(DATA_HEADER),
        samples=samples[:filled].view("<i2").reshape(-1, 6),
        ends=ends[:rows] + offset,
        others=_others(others, other_rows[:count], other_ends[:count]),
    )


def _others(
    content: NDArray[np.uint8], rows: NDArray[np.int64], ends: NDArray[np.int64]
) -> list[OtherFrame]:
    starts = [0, *ends[:-1].tolist()]
    return [
        OtherFrame(row, content[start:end].tobytes())
        for row, start, end in zip(rows.tolist(), starts, ends.tolist(), strict=False)
    ]


def _empty() -> FrameTable:
    none = np.empty(0, np.int64)
    return FrameTable(np.empty(0, DATA_HEADER), np.empty((0, 6), np.int16), none, [])


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
