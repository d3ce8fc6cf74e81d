"""The Python side of the batch reader: its buffers, and the state shared with the plain one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.wire.native.framing import Deframer
from allanscope.wire.native.kernel import crc_tables, read_frames
from allanscope.wire.native.layout import CRC_BYTES, DATA_HEADER, HEADER_BYTES, SAMPLE_BYTES
from allanscope.wire.native.table import FrameTable, OtherFrame

__all__ = ["batch_table"]

_TABLES = crc_tables()
_SHORTEST_DATA = 2 + DATA_HEADER.itemsize + SAMPLE_BYTES + CRC_BYTES
_SHORTEST_OTHER = 2 + HEADER_BYTES + CRC_BYTES


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
    rows, filled, count, crc_errors, malformed, consumed, joining, overlong = read_frames(
        np.frombuffer(buffer, np.uint8),
        deframer.joining,
        _TABLES,
        headers,
        ends,
        samples,
        others,
        other_rows,
        other_ends,
    )
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
