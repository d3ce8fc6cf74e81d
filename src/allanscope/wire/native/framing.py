r"""Frames on the wire: CRC-32, COBS and a zero byte.

A frame is never longer than 246 bytes, so that COBS (consistent overhead byte stuffing) takes its
simplest form: one byte is put in front, and every zero byte of the frame is replaced by the
distance to the next one (or to the end). What is sent holds no zero, so a zero byte ends it::

    frame        11 22 00 33
    on the wire  03 11 22 02 33 00
                  |_______^ |_____^ distances

A receiver that joins in the middle, or that lost bytes, is in step again after the next zero.
`Deframer` reads frame by frame; a simulated device writes its data frames many at once
(`pack_data_frames`), a frame in each row of a matrix.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from allanscope.wire.native.layout import (
    CRC_BYTES,
    DATA_HEADER,
    HEADER_BYTES,
    LONGEST_CHUNK,
    LONGEST_FRAME,
    SAMPLE_BYTES,
    VERSION,
)

__all__ = ["Deframer", "cobs_decode", "cobs_encode", "pack_data_frames", "pack_frame"]

_HEADER = struct.Struct("<BBHHBB")


def cobs_encode(frame: bytes) -> bytes:
    r"""Return the COBS form of a frame of at most 253 bytes, without the final zero.

    >>> cobs_encode(bytes([0x11, 0x22, 0x00, 0x33])).hex(" ")
    '03 11 22 02 33'
    """
    return b"".join(bytes((len(run) + 1,)) + run for run in frame.split(b"\0"))


def cobs_decode(chunk: bytes) -> bytes | None:
    r"""Return the frame that `cobs_encode` made this chunk of, or None when nothing can give it.

    >>> cobs_decode(bytes.fromhex("03 11 22 02 33")).hex(" ")
    '11 22 00 33'
    >>> cobs_decode(bytes.fromhex("04 11 22")) is None
    True
    """
    frame = bytearray(chunk)
    end = len(chunk)
    here = 0
    while here < end:
        step = chunk[here]
        if step == 0:
            return None
        frame[here] = 0
        here += step
    return bytes(frame[1:]) if here == end and end else None


def pack_frame(kind: int, seq: int, epoch: int, body: bytes) -> bytes:
    """Return a frame other than data as it goes over the wire, with its final zero."""
    frame = _HEADER.pack(kind, VERSION, seq & 0xFFFF, epoch & 0xFFFF, 0, len(body)) + body
    if len(frame) + CRC_BYTES > LONGEST_FRAME:
        raise ValueError(
            f"a body of {len(body)} bytes is too long for a frame; "
            f"{LONGEST_FRAME - CRC_BYTES - HEADER_BYTES} fit"
        )
    return cobs_encode(frame + crc32(frame).to_bytes(CRC_BYTES, "little")) + b"\0"


class Deframer:
    """Bytes to frames whose CRC is right, in plain Python.

    Attributes
    ----------
    crc_errors : int
        Chunks of a possible length whose CRC was wrong.
    malformed : int
        Chunks that cannot be a frame, and the first chunk after a start when it was only the tail
        of one.
    partial : bytearray
        What has come of the chunk that is still open: never longer than a chunk can be.
    overlong : bool
        Whether the open chunk is already longer than that, so that its end is all that matters.
    joining : bool
        Whether no chunk has been complete yet.
    """

    def __init__(self) -> None:
        self.crc_errors = 0
        self.malformed = 0
        self.partial = bytearray()
        self.overlong = False
        self.joining = True

    def feed(self, data: bytes) -> Iterator[tuple[bytes, int]]:
        """Yield the frames that the bytes complete, without CRC, and where in `data` they end."""
        *chunks, rest = data.split(b"\0")
        end = 0
        for chunk in chunks:
            end += len(chunk) + 1
            frame = self._close(chunk)
            if frame is not None:
                yield frame, end
        self._keep(rest)

    def reset(self) -> None:
        """Forget a partial frame; the next chunk may be the tail of another."""
        self.partial = bytearray()
        self.overlong = False
        self.joining = True

    def _keep(self, piece: bytes) -> None:
        if self.overlong or len(self.partial) + len(piece) > LONGEST_CHUNK:
            self.overlong = True
            self.partial = bytearray()
        else:
            self.partial += piece

    def _close(self, piece: bytes) -> bytes | None:
        self._keep(piece)
        chunk, overlong, joining = bytes(self.partial), self.overlong, self.joining
        self.partial = bytearray()
        self.overlong = False
        if not chunk and not overlong:
            return None
        self.joining = False
        frame = None if overlong else cobs_decode(chunk)
        if frame is None or len(frame) < HEADER_BYTES + CRC_BYTES:
            self.malformed += 1
            return None
        if crc32(frame[:-CRC_BYTES]) != int.from_bytes(frame[-CRC_BYTES:], "little"):
            self.malformed += joining
            self.crc_errors += not joining
            return None
        return frame[:-CRC_BYTES]


def pack_data_frames(headers: NDArray[np.void], samples: NDArray[np.int16]) -> bytes:
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
