"""The table of frames: where the plain reader and the batch reader meet.

Both turn bytes into the same table, and everything that has meaning (epochs, losses, scales) is
worked out from the table alone. So the fast way cannot say anything else than the plain one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.wire.native.layout import (
    DATA_HEADER,
    MOST_SAMPLES,
    SAMPLE_BYTES,
    VERSION_MAJOR,
    FrameType,
)

__all__ = ["FrameTable", "OtherFrame", "is_data", "table_of"]


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


def is_data(frame: bytes) -> bool:
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
        if is_data(frame):
            data.append(frame)
            ends.append(end)
        else:
            others.append(OtherFrame(len(data), frame))
    split = DATA_HEADER.itemsize
    headers = np.frombuffer(b"".join([frame[:split] for frame in data]), DATA_HEADER)
    samples = np.frombuffer(b"".join([frame[split:] for frame in data]), "<i2")
    return FrameTable(headers, samples.reshape(-1, 6), np.asarray(ends, np.int64), others)
