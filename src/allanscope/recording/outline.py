"""Where the records of a file lie, found by walking over their headers and never by its index.

A file that was killed has no index, and one whose index is corrupt is not worse than one without,
so the index is not used. The walk goes from header to header. Where it meets something that can be
no header (a truncation, a flipped byte, zeros that a crash left) it searches for the next chunk,
whose header is unmistakable: the name of the compression followed by a length that must agree with
the length of the record. What lies between is reported as damage. Every length is checked
against the file and against a limit before a byte is read.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode

from allanscope.errors import InputError
from allanscope.quantities import count, duration
from allanscope.recording.layout import MCAP_MAGIC, PROFILE, SEAL, is_intact
from allanscope.recording.records import (
    END_BYTES,
    HEAD_BYTES,
    HEADER,
    MAX_METADATA_BYTES,
    ChunkRecord,
    candidates,
    chunk_at,
    chunk_seconds,
    has_believable_length,
    metadata_in,
    profile_in,
    summary_start,
)

__all__ = ["TRUNCATED", "Damage", "Outline", "outline_of"]

TRUNCATED = "truncated: the end is not readable"
"""What a `Damage` says of a recording without its end."""

_STEP = 1 << 20
"""The search for the next record goes through the file in pieces of this size."""


@dataclass(frozen=True, slots=True)
class Damage:
    """Something of a recording that cannot be read.

    Attributes
    ----------
    file : Path
        In which file.
    offset, length : int
        Where in it; the length is 0 when only something that should follow is missing.
    what : str
        What is wrong, in plain words.
    seconds : float or None
        Time that it held, in seconds; None where unknown.
    """

    file: Path
    offset: int
    length: int
    what: str
    seconds: float | None = None

    def __str__(self) -> str:
        held = "" if self.seconds is None else f", {duration(self.seconds)}"
        size = f" ({count(self.length)} bytes{held})" if self.length else ""
        return f"{self.file.name}, byte {self.offset}: {self.what}{size}"


@dataclass(slots=True)
class Outline:
    """What a file holds, without having unpacked any of it.

    Attributes
    ----------
    metadata : dict of str to str
        The newest sound metadata record; a damaged one if there is no other.
    chunks : list of ChunkRecord
        In order.
    damage : list of Damage
        What the walk could not make sense of.
    finished : bool
        Whether the file was closed properly.
    profile : str
        Who wrote it.
    """

    metadata: dict[str, str] = field(default_factory=dict)
    chunks: list[ChunkRecord] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    finished: bool = False
    profile: str = ""


def outline_of(path: Path) -> Outline:
    """Walk over a file.

    Raises
    ------
    InputError
        If it cannot be read, or is no MCAP file at all.
    """
    try:
        with path.open("rb") as file:
            return _Walk(path, file).outline
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error


class _Walk:
    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.path = path
        self.file = file
        self.size = file.seek(0, 2)
        self.outline = Outline()
        self._loose: list[int] = []
        self._labels: set[bytes] = set()
        self._records()

    def _records(self) -> None:
        position = self._start()
        while position < self.size and not self.outline.finished:
            length = self._read_record(position)
            position = self._resume_after(position) if length is None else position + length
        if self._loose:
            first, end, count = self._loose
            text = f"{count} messages outside of chunks, which are not read"
            self._report(first, end - first, text)
        if not self.outline.finished and position <= self.size:
            self._report(self.size, 0, "never closed: up to a second at its end may be missing")

    def _start(self) -> int:
        """Return where the first record is; the file may have lost its very beginning."""
        if self._read(0, len(MCAP_MAGIC)) == MCAP_MAGIC:
            return len(MCAP_MAGIC)
        if not self.size:
            raise InputError(f"{self.path} is empty")
        first = self._next_record(0) if self.path.suffix == ".mcap" else None
        if first is None:
            raise InputError(f"not a recording: {self.path} is not an MCAP file")
        self._report(0, first, "the beginning is not readable")
        return first

    def _read_record(self, position: int) -> int | None:
        """Note the record at `position` and return its length; None if there is no record."""
        head = self._read(position, HEAD_BYTES)
        if not has_believable_length(head):
            return None
        opcode, length = HEADER.unpack_from(head)
        if position + HEADER.size + length > self.size:
            return None
        if opcode == Opcode.CHUNK:
            record = chunk_at(position, head)
            if record is None:
                return None
            if record.is_dated and record.label in self._labels:
                text = "a duplicate chunk, read once"
                self._report(position, HEADER.size + int(length), text, record.seconds)
            else:
                self._labels.add(record.label)
                self.outline.chunks.append(record)
        elif opcode == Opcode.MESSAGE:
            end = position + HEADER.size + int(length)
            first, count = (self._loose[0], self._loose[2]) if self._loose else (position, 0)
            self._loose = [first, end, count + 1]
        elif opcode == Opcode.METADATA:
            if not self._take_metadata(position, length):
                return None
        elif opcode == Opcode.HEADER:
            profile = profile_in(self._body(position, length))
            if profile is None:
                return None
            self.outline.profile = profile
        self.outline.finished = opcode in (Opcode.FOOTER, Opcode.DATA_END)
        return HEADER.size + int(length)

    def _take_metadata(self, position: int, length: int) -> bool:
        found = metadata_in(self._body(position, length))
        if found is None or found[0] != PROFILE:
            return found is not None
        pairs = found[1]
        sound = is_intact(pairs)
        if not sound:
            self._report(position, HEADER.size + length, "the metadata is damaged")
        if sound or not self.outline.metadata:
            self.outline.metadata = {k: v for k, v in pairs.items() if k != SEAL}
        return True

    def _resume_after(self, position: int) -> int:
        """Return where to go on after something that is no record, and report what is skipped."""
        following = self._next_record(position + 1)
        if following is None:
            summary = summary_start(self._read(max(self.size - END_BYTES, 0), END_BYTES))
            following = summary if summary and position < summary < self.size else None
        if following is None:
            seconds = chunk_seconds(self._read(position, HEAD_BYTES))
            self._report(position, self.size - position, TRUNCATED, seconds)
            return self.size + 1
        self._report(position, following - position, "not readable")
        return following

    def _next_record(self, start: int) -> int | None:
        """Return the position of the first record at or after `start` that is unmistakable."""
        for base in range(start, self.size, _STEP):
            block = self._read(base, _STEP + HEAD_BYTES)
            for position in sorted(base + at for at in candidates(block) if at < _STEP):
                if self._is_record(position):
                    return position
        return None

    def _is_record(self, position: int) -> bool:
        head = self._read(position, HEAD_BYTES)
        opcode, length = HEADER.unpack_from(head)
        if position + HEADER.size + length > self.size:
            return False
        if opcode == Opcode.CHUNK:
            return chunk_at(position, head) is not None
        return opcode == Opcode.METADATA and metadata_in(self._body(position, length)) is not None

    def _body(self, position: int, length: int) -> bytes:
        """Return the body of a small record; cut short, and so never sound, if it is not small."""
        return self._read(position + HEADER.size, min(length, MAX_METADATA_BYTES))

    def _report(self, offset: int, length: int, what: str, seconds: float | None = None) -> None:
        self.outline.damage.append(Damage(self.path, offset, length, what, seconds))

    def _read(self, offset: int, length: int) -> bytes:
        self.file.seek(offset)
        return self.file.read(length)
