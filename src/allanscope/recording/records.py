"""The bytes of MCAP records: headers, as far as a walk over a file needs them, and chunk contents.

Nothing here reads a file, and nothing is trusted: neither a length nor the bytes. The functions for
headers say None, or raise ValueError, where lengths within a record do not agree with each other:
that agreement is what tells a record from corruption. A chunk is unpacked and checked against its
checksum (`unpacked`) before its messages are taken out (`messages_of`).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import zstandard
from mcap.opcode import Opcode

from allanscope.recording.layout import MCAP_MAGIC, PROFILE

__all__ = [
    "END_BYTES",
    "HEADER",
    "HEAD_BYTES",
    "MAX_CHUNK_BYTES",
    "MAX_METADATA_BYTES",
    "MOST_MESSAGES",
    "ChunkRecord",
    "CorruptChunkError",
    "Message",
    "candidates",
    "chunk_at",
    "chunk_seconds",
    "has_believable_length",
    "messages_of",
    "metadata_in",
    "most_unpacked",
    "profile_in",
    "summary_start",
    "unpacked",
]

MAX_CHUNK_BYTES = 64 << 20
"""Chunks larger than this, before or after decompression, are refused: ours hold a second."""

MAX_METADATA_BYTES = 1 << 16

FREE_UNPACKED_BYTES = 16 << 20
MOST_RATIO = 100
"""What sensors say packs to a half or a tenth; whatever packs to less than a hundredth was made up,
and would take minutes to read."""

MOST_MESSAGES = 1 << 18
"""Ours hold a second of reads; empty messages pack to nothing, but each costs memory here."""

HEADER = struct.Struct("<BQ")
"""Opcode and length, before every record."""

_CHUNK = struct.Struct("<QQQII")  # first and last log time, size and CRC when unpacked, name length
_END = struct.Struct("<BQQQI8s")  # the footer and the magic at the very end
END_BYTES = _END.size

HEAD_BYTES = HEADER.size + _CHUNK.size + 16
"""As much of a record as is needed to judge it."""

_ZSTD_MARK = b"\x04\x00\x00\x00zstd"
_ZSTD_OFFSET = HEADER.size + 28
_NAME_MARK = len(PROFILE).to_bytes(4, "little") + PROFILE.encode()
_KNOWN = frozenset(int(opcode) for opcode in Opcode)
_FIXED = {int(Opcode.FOOTER): 20, int(Opcode.DATA_END): 4, int(Opcode.SUMMARY_OFFSET): 17}
_LONGEST_DAY_S = 86400.0

_LAST_NS = (1 << 63) - 1
_MESSAGE = struct.Struct("<BQHIQQ").unpack_from  # opcode, length, channel, number, two times
_HEADER_BYTES, _MESSAGE_BYTES = HEADER.size, 22

Message = tuple[str, int, int, int, int, int]
"""Topic, number, time since 1970 and host time in ns, then where its bytes begin and end.

A plain tuple: a night has millions of them, and this is the loop that a replay waits for.
"""


@dataclass(frozen=True, slots=True)
class ChunkRecord:
    """A chunk in a file: where its packed bytes are and what they must unpack to."""

    offset: int
    length: int
    compression: str
    unpacked_length: int
    unpacked_crc: int
    seconds: float | None
    label: bytes
    """Times of its first and last message, size and checksum, as they stand in the file."""

    @property
    def is_dated(self) -> bool:
        """Whether it has times, so that another one of the same label is a copy."""
        return any(self.label[:16])


def has_believable_length(head: bytes) -> bool:
    """Return whether opcode and length of the record that begins with `head` can be true."""
    if len(head) < HEADER.size:
        return False
    opcode, length = HEADER.unpack_from(head)
    if opcode != Opcode.CHUNK and head.startswith(_ZSTD_MARK, _ZSTD_OFFSET):
        return False  # a chunk whose first byte is corrupt
    if opcode == Opcode.MESSAGE_INDEX:
        return _sized(head, HEADER.size + 2, length - 6)
    return opcode in _KNOWN and bool(_FIXED.get(opcode, length) == length)


def chunk_at(position: int, head: bytes) -> ChunkRecord | None:
    """Return the chunk whose record begins with `head` at `position` of a file."""
    name_at = HEADER.size + _CHUNK.size
    if len(head) < name_at:
        return None
    opcode, length = HEADER.unpack_from(head)
    _, _, unpacked_length, crc, name_length = _CHUNK.unpack_from(head, HEADER.size)
    packed_at = name_at + name_length + 8
    if opcode != Opcode.CHUNK or len(head) < packed_at:
        return None
    (packed_length,) = struct.unpack_from("<Q", head, packed_at - 8)
    if packed_at + packed_length != HEADER.size + length:
        return None
    if max(packed_length, unpacked_length) > MAX_CHUNK_BYTES:
        return None
    name = head[name_at : packed_at - 8].decode("ascii", "replace")
    offset = position + packed_at
    label = head[HEADER.size : name_at - 4]
    return ChunkRecord(
        offset, packed_length, name, unpacked_length, crc, chunk_seconds(head), label
    )


def chunk_seconds(head: bytes) -> float | None:
    """Return the time between first and last message of the chunk that begins with `head`."""
    if len(head) < HEADER.size + 16 or head[0] != Opcode.CHUNK:
        return None
    first, last = struct.unpack_from("<QQ", head, HEADER.size)
    seconds = (last - first) * 1e-9
    return seconds if 0.0 <= seconds < _LONGEST_DAY_S else None


def profile_in(body: bytes) -> str | None:
    """Return who wrote a file, from the body of its header record."""
    try:
        texts = list(_strings(body))
    except (ValueError, struct.error):
        return None
    return texts[0] if texts else ""


def metadata_in(body: bytes) -> tuple[str, dict[str, str]] | None:
    """Return name and content of a metadata record, from its body."""
    try:
        (name_length,) = struct.unpack_from("<I", body)
        table = 4 + name_length
        name = body[4:table].decode("utf-8")
        texts = list(_strings(body[table + 4 :]))
        pairs = dict(zip(texts[::2], texts[1::2], strict=True))
    except (ValueError, struct.error):
        return None
    return (name, pairs) if _sized(body, table, len(body) - table - 4) else None


def summary_start(end: bytes) -> int | None:
    """Return where the index of a closed file begins, from the last bytes of the file."""
    if len(end) < END_BYTES:
        return None
    opcode, length, summary, _, _, magic = _END.unpack(end)
    sound = opcode == Opcode.FOOTER and length == _FIXED[Opcode.FOOTER] and magic == MCAP_MAGIC
    return int(summary) if sound else None


def candidates(block: bytes) -> Iterator[int]:
    """Yield the offsets at which a chunk of ours, or our metadata record, could begin."""
    for mark, offset in ((_ZSTD_MARK, _ZSTD_OFFSET), (_NAME_MARK, HEADER.size)):
        found = block.find(mark, offset)
        while found >= 0:
            yield found - offset
            found = block.find(mark, found + 1)


def _sized(data: bytes, offset: int, expected: int) -> bool:
    """Whether the 32-bit number at `offset` is the expected one."""
    return len(data) >= offset + 4 and struct.unpack_from("<I", data, offset)[0] == expected


def _strings(data: bytes) -> Iterator[str]:
    """Yield the length-prefixed strings that make up `data`."""
    position = 0
    while position < len(data):
        (length,) = struct.unpack_from("<I", data, position)
        position += 4 + length
        if position > len(data):
            raise ValueError("a string exceeds its record")
        yield data[position - length : position].decode("utf-8")


def most_unpacked(packed_bytes: int) -> int:
    """Return how many bytes may come of so many packed ones.

    >>> most_unpacked(1 << 20) >> 20
    116
    """
    return FREE_UNPACKED_BYTES + MOST_RATIO * packed_bytes


class CorruptChunkError(Exception):
    """A chunk does not hold what was written to it."""


def unpacked(record: ChunkRecord, packed: bytes) -> bytes:
    """Return the records of a chunk, checked against its checksum.

    Raises
    ------
    CorruptChunkError
        If it is short, claims a size that is not believable, cannot be unpacked or has another
        checksum.
    """
    if len(packed) < record.length:
        raise CorruptChunkError("a chunk is truncated")
    if record.compression == "zstd":
        data = _zstd(packed, record.unpacked_length)
    elif not record.compression:
        data = packed
    else:
        raise CorruptChunkError(
            f"a chunk is packed with {record.compression!r}, which is not supported"
        )
    if record.unpacked_crc and zlib.crc32(data) != record.unpacked_crc:
        raise CorruptChunkError("a chunk has the wrong checksum")
    return data


def messages_of(data: bytes, topics: dict[int, str]) -> list[Message]:
    """Return the messages of an unpacked chunk; note in `topics` the channels that it declares.

    Raises
    ------
    CorruptChunkError
        If the records do not fill the chunk exactly, are more than a chunk of ours can hold, or
        have times that no clock shows.
    """
    found: list[Message] = []
    position, end = 0, len(data)
    whole = end - _HEADER_BYTES - _MESSAGE_BYTES
    message, channel_record = int(Opcode.MESSAGE), int(Opcode.CHANNEL)  # compared in less time
    while position + _HEADER_BYTES <= end:
        # The last record need not be a message.
        head = data if position <= whole else data + bytes(_MESSAGE_BYTES)
        opcode, length, channel, sequence, epoch_ns, host_ns = _MESSAGE(head, position)
        body, position = position + _HEADER_BYTES, position + _HEADER_BYTES + length
        if opcode == message and length >= _MESSAGE_BYTES:
            if host_ns > _LAST_NS:
                raise CorruptChunkError("a chunk has a message with an impossible time")
            if len(found) == MOST_MESSAGES:
                raise CorruptChunkError(f"a chunk holds more than {MOST_MESSAGES} messages")
            topic, start = topics.get(channel, ""), body + _MESSAGE_BYTES
            found.append((topic, sequence, epoch_ns, host_ns, start, position))
        elif opcode == channel_record:
            _note_channel(data[body:position], topics)
    if position != end:
        raise CorruptChunkError("the records of a chunk do not fill it")
    return found


def _zstd(packed: bytes, expected: int) -> bytes:
    """Decompress, having looked at the size that the frame itself claims."""
    try:
        claimed = zstandard.frame_content_size(packed)
        if claimed > min(expected, MAX_CHUNK_BYTES):
            raise CorruptChunkError(f"a chunk claims to unpack to {claimed} bytes")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=expected)
    except zstandard.ZstdError as error:
        raise CorruptChunkError("a chunk cannot be unpacked") from error


def _note_channel(body: bytes, topics: dict[int, str]) -> None:
    """Remember the topic of a channel that is not one of ours by number."""
    try:
        number, _, length = struct.unpack_from("<HHI", body)
        topic = body[8 : 8 + length].decode("utf-8")
    except (struct.error, UnicodeDecodeError) as error:
        raise CorruptChunkError("a channel record is damaged") from error
    topics[number] = topic
