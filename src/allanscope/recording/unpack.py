"""From a packed chunk to its messages. Nothing is trusted: neither a length nor the bytes."""

from __future__ import annotations

import struct
import zlib

import zstandard
from mcap.opcode import Opcode

from allanscope.recording.records import MAX_CHUNK_BYTES, ChunkRecord

__all__ = ["MOST_MESSAGES", "Message", "RottenChunkError", "messages_of", "unpacked"]


class RottenChunkError(Exception):
    """A chunk does not hold what was written to it."""


Message = tuple[str, int, int, int, int, int]
"""Topic, number, time since 1970 and host time in ns, then where its bytes begin and end.

A plain tuple: a night has millions of them, and this is the loop that a replay waits for.
"""


def unpacked(record: ChunkRecord, packed: bytes) -> bytes:
    """Return the records of a chunk, checked against its checksum.

    Raises
    ------
    RottenChunkError
        If it is short, claims a size that is not believable, cannot be unpacked or has another
        checksum.
    """
    if len(packed) < record.length:
        raise RottenChunkError("a chunk is torn")
    if record.compression == "zstd":
        data = _zstd(packed, record.unpacked_length)
    elif not record.compression:
        data = packed
    else:
        raise RottenChunkError(
            f"a chunk is packed with {record.compression!r}, which is not supported"
        )
    if record.unpacked_crc and zlib.crc32(data) != record.unpacked_crc:
        raise RottenChunkError("a chunk has the wrong checksum")
    return data


def messages_of(data: bytes, topics: dict[int, str]) -> list[Message]:
    """Return the messages of an unpacked chunk; note in `topics` the channels that it declares.

    Raises
    ------
    RottenChunkError
        If the records do not fill the chunk exactly, are more than a chunk of ours can hold, or
        have times that no clock shows.
    """
    found: list[Message] = []
    position, end = 0, len(data)
    padded = data + bytes(_MESSAGE_BYTES)  # so that the last record need not be a message
    while position + _HEADER_BYTES <= end:
        opcode, length, channel, sequence, epoch_ns, host_ns = _MESSAGE(padded, position)
        body, position = position + _HEADER_BYTES, position + _HEADER_BYTES + length
        if opcode == Opcode.MESSAGE and length >= _MESSAGE_BYTES:
            if host_ns > _LAST_NS:
                raise RottenChunkError("a chunk has a message of a time that no clock shows")
            if len(found) == MOST_MESSAGES:
                raise RottenChunkError(f"a chunk holds more than {MOST_MESSAGES} messages")
            topic, start = topics.get(channel, ""), body + _MESSAGE_BYTES
            found.append((topic, sequence, epoch_ns, host_ns, start, position))
        elif opcode == Opcode.CHANNEL:
            _note_channel(data[body:position], topics)
    if position != end:
        raise RottenChunkError("the records of a chunk do not fill it")
    return found


MOST_MESSAGES = 1 << 18
"""Ours hold a second of reads; empty messages pack to nothing, but each costs memory here."""

_LAST_NS = (1 << 63) - 1

_MESSAGE = struct.Struct("<BQHIQQ").unpack_from  # opcode, length, channel, number, two times
_HEADER_BYTES = 9
_MESSAGE_BYTES = 22


def _zstd(packed: bytes, expected: int) -> bytes:
    """Decompress, having looked at the size that the frame itself claims."""
    try:
        claimed = zstandard.frame_content_size(packed)
        if claimed > min(expected, MAX_CHUNK_BYTES):
            raise RottenChunkError(f"a chunk claims to unpack to {claimed} bytes")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=expected)
    except zstandard.ZstdError as error:
        raise RottenChunkError("a chunk cannot be unpacked") from error


def _note_channel(body: bytes, topics: dict[int, str]) -> None:
    """Remember the topic of a channel that is not one of ours by number."""
    try:
        number, _, length = struct.unpack_from("<HHI", body)
        topic = body[8 : 8 + length].decode("utf-8")
    except (struct.error, UnicodeDecodeError) as error:
        raise RottenChunkError("a channel record is damaged") from error
    topics[number] = topic
