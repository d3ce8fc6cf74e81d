"""Reading a recording: its chunks as they came, or in bulk, and what is wrong with it."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from allanscope.errors import InputError
from allanscope.recording.chunk import Chunk, LinkEvent
from allanscope.recording.layout import (
    CHANNELS,
    EVENTS,
    MCAP_MAGIC,
    PROFILE,
    RX,
    TX,
    first_segment,
    session_files,
)
from allanscope.recording.outline import Damage, Outline, outline_of
from allanscope.recording.records import (
    MAX_CHUNK_BYTES,
    MOST_MESSAGES,
    CorruptChunkError,
    Message,
    messages_of,
    most_unpacked,
    unpacked,
)

__all__ = ["Buffer", "Fingerprint", "Recording", "is_recording"]


@dataclass(frozen=True, slots=True)
class Buffer:
    """Many reads in one piece, for decoding in bulk.

    Attributes
    ----------
    data : bytes
        The bytes of all reads, one after the other.
    offset : ndarray of int64, shape (n,)
        Where in `data` each read begins, ascending from 0.
    host_ns : ndarray of int64, shape (n,)
        Host monotonic time of each read.
    event : str
        What happened to the link before these bytes, or empty.
    event_ns : int
        When; 0 without an event.
    text : str
        Of a mark.
    """

    data: bytes
    offset: NDArray[np.int64]
    host_ns: NDArray[np.int64]
    event: LinkEvent = ""
    event_ns: int = 0
    text: str = ""

    def chunks(self) -> Iterator[Chunk]:
        """Take it apart again."""
        if self.event:
            yield Chunk(self.event_ns, b"", self.event, self.text)
        bounds = [*self.offset.tolist(), len(self.data)]
        for index, host_ns in enumerate(self.host_ns.tolist()):
            yield Chunk(host_ns, self.data[bounds[index] : bounds[index + 1]])


def is_recording(path: Path) -> bool:
    """Return whether a path is a recording or the folder of one; its content may still be bad."""
    try:
        first = first_segment(path)
        if not first.is_file():
            return False  # a serial port must not be opened just to look
        with first.open("rb") as file:
            return first.suffix == ".mcap" or file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    except (OSError, InputError):
        return False


class Recording:
    """A recording that can be read as often as one likes.

    Parameters
    ----------
    path : Path
        A file, the first file of a session that grew over several, or the folder of a session.

    Raises
    ------
    InputError
        If it is no recording.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._segments = _segments(path)
        packed = sum(file.stat().st_size for file in self.files)
        if self.unpacked_bytes > MAX_CHUNK_BYTES + most_unpacked(packed):
            raise InputError(f"{path} claims to unpack to {self.unpacked_bytes} bytes")
        self._rotten: dict[tuple[Path, int], Damage] = {}
        self._read_through = False

    @property
    def files(self) -> list[Path]:
        """The files that make it up, in order."""
        return [file for file, _ in self._segments]

    @property
    def metadata(self) -> dict[str, str]:
        """What the recording says about itself; the first file has the first word."""
        merged: dict[str, str] = {}
        for _, outline in self._segments:
            merged = {**outline.metadata, **merged}
        return merged

    @property
    def damage(self) -> list[Damage]:
        """Everything that cannot be read, in order; reads the whole recording once to know."""
        if not self._read_through:
            for _ in self.intact_chunks():
                pass
        known = [damage for _, outline in self._segments for damage in outline.damage]
        files = self.files
        return sorted(
            [*known, *self._rotten.values()], key=lambda one: (files.index(one.file), one.offset)
        )

    @property
    def unpacked_bytes(self) -> int:
        """Bytes that all chunks unpack to, sound or not: what there is to read."""
        return sum(one.unpacked_length for _, outline in self._segments for one in outline.chunks)

    @property
    def duration_s(self) -> float:
        """Time from the first read to the last, pauses included, in seconds."""

        def first_read_ns(step: int) -> int:
            """Return the time of the first read, or from the end (-1) of the last; 0 without."""
            for _, found in self.intact_chunks(step):
                for message in found[::step]:
                    if message[0] == RX:
                        return message[2]
            return 0

        first, last = first_read_ns(1), first_read_ns(-1)
        return (last - first) * 1e-9

    def chunks(self) -> Iterator[Chunk]:
        """Yield what the source gave, in order: bytes with their times, events of the link, marks.

        Where reads are missing there is a Chunk with the event ``hole`` and no bytes.
        """
        for buffer in self.buffers():
            yield from buffer.chunks()

    def buffers(self, size: int = 1 << 22, after: int = 0) -> Iterator[Buffer]:
        """Yield the same in pieces of up to `size` bytes; an event of the link begins a new one.

        `after` is the number that the first read should have, for a part of a recording.
        """
        gathered = _ReadBatch()
        expected = after
        for data, messages in self.intact_chunks():
            for topic, sequence, _, host_ns, start, stop in messages:
                if topic == RX:
                    if sequence != expected and expected and sequence:
                        yield from gathered.drain()
                        gathered = _ReadBatch("hole", host_ns)
                    elif (
                        gathered.length + stop - start > size
                        or len(gathered.times) >= MOST_MESSAGES  # they cost memory without bytes
                    ):
                        yield from gathered.drain()
                        gathered = _ReadBatch()
                    expected = sequence + 1 & 0xFFFFFFFF
                    gathered.add(data[start:stop], host_ns)
                elif topic == EVENTS:
                    fields = _json(data[start:stop])
                    if event := _link_event(fields):
                        yield from gathered.drain()
                        gathered = _ReadBatch(event, host_ns, _text(fields))
        yield from gathered.drain()

    def part(self, number: int, parts: int) -> Recording:
        """Return one of so many parts, about equally long; together they are the whole."""
        ends = np.cumsum([one.length for _, outline in self._segments for one in outline.chunks])
        goals = np.arange(1, parts) * (ends[-1] / parts if len(ends) else 0.0)
        bounds = [0, *np.searchsorted(ends, goals).tolist(), len(ends)]
        part = copy.copy(self)
        vars(part)["_segments"] = _some(self._segments, bounds[number], bounds[number + 1])
        return part

    def next_read(self, after: int = 0) -> int:
        """Return the number that a read behind the last one should have; `after` without one."""
        for _, messages in self.intact_chunks(-1):
            for message in reversed(messages):
                if message[0] == RX:
                    return message[1] + 1 & 0xFFFFFFFF
        return after

    def tx(self) -> Iterator[Chunk]:
        """Yield what was written to the device."""
        for host_ns, data in self._topic(TX):
            yield Chunk(host_ns, data)

    def events(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield the remarks, each with its host monotonic time in nanoseconds."""
        for host_ns, data in self._topic(EVENTS):
            if fields := _json(data):
                yield host_ns, fields

    def sha256(self) -> str:
        """Return a hash of the bytes and times that were read, whatever files they lie in."""
        fingerprint = Fingerprint()
        for buffer in self.buffers():
            fingerprint.add(buffer)
        return fingerprint.hexdigest()

    def intact_chunks(self, step: int = 1) -> Iterator[tuple[bytes, list[Message]]]:
        """Yield the bytes of every MCAP chunk that is sound, with the messages that lie in them.

        With step -1 from the last chunk to the first.
        """
        for path, outline in self._segments[::step]:
            topics = {number: topic for topic, number in CHANNELS.items()}
            try:
                with path.open("rb") as file:
                    for record in outline.chunks[::step]:
                        file.seek(record.offset)
                        try:
                            data = unpacked(record, file.read(record.length))
                            yield data, messages_of(data, topics)
                        except CorruptChunkError as error:
                            self._rotten[path, record.offset] = Damage(
                                path, record.offset, record.length, str(error), record.seconds
                            )
            except OSError as error:
                raise InputError(f"cannot read {path}: {error.strerror}") from error
        self._read_through = True

    def _topic(self, wanted: str) -> Iterator[tuple[int, bytes]]:
        for data, messages in self.intact_chunks():
            for topic, _, _, host_ns, start, stop in messages:
                if topic == wanted:
                    yield host_ns, data[start:stop]


class _ReadBatch:
    """Reads that are being joined into a Buffer."""

    def __init__(self, event: LinkEvent = "", event_ns: int = 0, text: str = "") -> None:
        self.length = 0
        self._event: LinkEvent = event
        self._event_ns = event_ns
        self._text = text
        self.times: list[int] = []
        self._parts: list[bytes] = []

    def add(self, data: bytes, host_ns: int) -> None:
        self._parts.append(data)
        self.times.append(host_ns)
        self.length += len(data)

    def drain(self) -> Iterator[Buffer]:
        """Yield the Buffer, if it holds anything."""
        if self._parts or self._event:
            lengths = np.fromiter(map(len, self._parts), np.int64, len(self._parts))
            yield Buffer(
                b"".join(self._parts),
                np.cumsum(lengths) - lengths,
                np.array(self.times, np.int64),
                self._event,
                self._event_ns,
                self._text,
            )


def _segments(path: Path) -> list[tuple[Path, Outline]]:
    """Return the files of a session with their outlines; strangers with a fitting name are not."""
    first, *later = session_files(path)
    outline = _outline(first) if later else outline_of(first)
    beginning = any(damage.offset <= len(MCAP_MAGIC) for damage in outline.damage)
    if not beginning and outline.profile != PROFILE and not outline.metadata:
        raise InputError(f"no recording: {first} is an MCAP file of something else")
    session = outline.metadata.get("session")
    found = [(first, outline)]
    for file in later:
        following = _outline(file)
        # Where the beginning is lost the next file says which session it is.
        session = session or following.metadata.get("session")
        if following.metadata.get("session", session) == session:
            found.append((file, following))
    return found


def _outline(path: Path) -> Outline:
    """Return the outline of one of several files; one that is there and none of ours is damage."""
    try:
        return outline_of(path)
    except InputError as error:
        try:
            size = path.stat().st_size
        except OSError:
            raise error from None
        return Outline(damage=[Damage(path, 0, size, str(error))])


def _some(
    segments: list[tuple[Path, Outline]], first: int, stop: int
) -> list[tuple[Path, Outline]]:
    """Return the files with those of their chunks that have some numbers."""
    kept = []
    for path, outline in segments:
        mine = outline.chunks[max(first, 0) : max(stop, 0)]
        kept.append((path, replace(outline, chunks=mine)))
        first, stop = first - len(outline.chunks), stop - len(outline.chunks)
    return kept


def _json(data: bytes) -> dict[str, Any]:
    """Return a remark; empty if it is no JSON object."""
    try:
        fields = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return fields if isinstance(fields, dict) else {}


def _link_event(fields: dict[str, Any]) -> LinkEvent:
    """Return what a remark says about the link, or that it is a mark; empty if it is neither."""
    if fields.get("kind") == "mark":
        return "mark"
    event = fields.get("event")
    if fields.get("kind") != "link" or event not in get_args(LinkEvent):
        return ""
    return "" if event in ("mark", "end") else cast(LinkEvent, event)


def _text(fields: dict[str, Any]) -> str:
    """Return the words of a remark; empty if it has none."""
    text = fields.get("text", "")
    return text if isinstance(text, str) else ""


class Fingerprint:
    """A hash of bytes and times that grows with a recording that is read for another purpose.

    How the reads are joined to Buffers does not change it; neither does recovery, or rotation over
    several files.
    """

    def __init__(self) -> None:
        self._content = hashlib.sha256()
        self._times = hashlib.sha256()

    def add(self, buffer: Buffer) -> None:
        """Take the next piece."""
        self._content.update(buffer.data)
        lengths = np.diff(buffer.offset, append=len(buffer.data))
        self._times.update(np.column_stack([buffer.host_ns, lengths]).astype("<i8").tobytes())

    def hexdigest(self) -> str:
        """Return the fingerprint of everything so far, 64 hexadecimal digits."""
        return hashlib.sha256(self._content.digest() + self._times.digest()).hexdigest()
