"""The bytes of MCAP records, as far as a walk over a file needs them. Nothing here reads a file.

Every function says None, or raises ValueError, where lengths within a record do not agree with each
other: that agreement is what tells a record from rot.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from mcap.opcode import Opcode

from allanscope.recording.layout import MAGIC, PROFILE

__all__ = [
    "END_BYTES",
    "HEADER",
    "HEAD_BYTES",
    "MAX_CHUNK_BYTES",
    "MAX_METADATA_BYTES",
    "ChunkRecord",
    "candidates",
    "chunk_at",
    "chunk_seconds",
    "has_believable_length",
    "metadata_in",
    "profile_in",
    "summary_start",
]

MAX_CHUNK_BYTES = 64 << 20
"""Chunks larger than this, before or after decompression, are refused: ours hold a second."""

MAX_METADATA_BYTES = 1 << 16

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


@dataclass(frozen=True, slots=True)
class ChunkRecord:
    """A chunk in a file: where its packed bytes are and what they must unpack to."""

    offset: int
    length: int
    compression: str
    unpacked_length: int
    unpacked_crc: int
    seconds: float | None


def has_believable_length(head: bytes) -> bool:
    """Return whether opcode and length of the record that begins with `head` can be true."""
    if len(head) < HEADER.size:
        return False
    opcode, length = HEADER.unpack_from(head)
    if opcode != Opcode.CHUNK and head.startswith(_ZSTD_MARK, _ZSTD_OFFSET):
        return False  # a chunk whose first byte has rotted
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
    return ChunkRecord(offset, packed_length, name, unpacked_length, crc, chunk_seconds(head))


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
    sound = opcode == Opcode.FOOTER and length == _FIXED[Opcode.FOOTER] and magic == MAGIC
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
            raise ValueError("a string is longer than what holds it")
        yield data[position - length : position].decode("utf-8")
