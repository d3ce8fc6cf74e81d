"""Many data frames of one size at once: CRC and COBS over a matrix with a frame in each row."""

from __future__ import annotations

from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from allanscope.wire.native.layout import CRC_BYTES, DATA_HEADER, SAMPLE_BYTES

__all__ = ["stuff_frames"]


def stuff_frames(headers: NDArray[np.void], samples: NDArray[np.int16]) -> bytes:
    """Return data frames as they go over the wire.

    Parameters
    ----------
    headers : ndarray of DATA_HEADER, shape (m,)
        All with the same number of samples.
    samples : ndarray of int16, shape (m * n, 6)
    """
    rows = len(headers)
    if rows == 0:
        return b""
    head = DATA_HEADER.itemsize
    tail = head + SAMPLE_BYTES * int(headers["n"][0])
    # Column 0 is the byte that COBS adds, the last one the delimiter; the frame is between.
    wire = np.zeros((rows, 1 + tail + CRC_BYTES + 1), np.uint8)
    frame = wire[:, 1:-1]
    frame[:, :head] = headers.view(np.uint8).reshape(rows, head)
    frame[:, head:tail] = samples.astype("<i2", copy=False).view(np.uint8).reshape(rows, -1)
    checks = [crc32(row) for row in np.ascontiguousarray(frame[:, :tail])]
    frame[:, tail:] = np.array(checks, "<u4").view(np.uint8).reshape(rows, CRC_BYTES)
    return _distances(wire).tobytes()


def _distances(wire: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Replace every zero but the last of each row by its distance to the next one."""
    width = wire.shape[1]
    column = np.arange(width, dtype=np.uint8)
    zero = wire == 0
    here_or_later = np.where(zero, column, np.uint8(width - 1))
    np.minimum.accumulate(here_or_later[:, ::-1], axis=1, out=here_or_later[:, ::-1])
    distance = here_or_later[:, 1:] - column[:-1]
    wire[:, :-1] = np.where(zero[:, :-1], distance, wire[:, :-1])
    return wire
