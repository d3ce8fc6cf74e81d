"""A session that is being written: numbering, times, rotation over several files. No threads."""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from allanscope.errors import UsageError
from allanscope.recording.chunk import Chunk
from allanscope.recording.layout import (
    CHANNELS,
    EVENTS,
    RX,
    TX,
    circumstances,
    segment_number,
    segment_path,
    session_files,
)
from allanscope.recording.outline import outline_of
from allanscope.recording.records import MOST_MESSAGES
from allanscope.recording.segment import COMMIT_BYTES, Segment

__all__ = ["SessionWriter", "write_recording"]


class SessionWriter:
    """Write a session, file after file.

    Everything that can fail because of the disk fails in `commit`, `sync` and `close`, never in
    `rx`, `tx` and `event`, which only fill memory.

    Parameters
    ----------
    path : Path
        The first file, or a folder in which it will be called ``session.mcap``.
    metadata : mapping of str to str
        What to say about the session: device, wire format, settings.
    max_bytes, max_seconds : float
        A new file is begun when one has become this large or this long.
    resume : bool
        Continue a session that is already there in a new file; else it must not exist.
    anchor_ns : tuple of int, optional
        Time since 1970 and monotonic time of one moment, in nanoseconds; now, if not given.

    Raises
    ------
    UsageError
        If the session exists, or does not exist although it is to be resumed, or cannot be
        written there.

    Attributes
    ----------
    incident : str
        The last thing that another program has done to the files; empty if nothing.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str],
        *,
        max_bytes: float = 1 << 30,
        max_seconds: float = 3600.0,
        resume: bool = False,
        anchor_ns: tuple[int, int] | None = None,
    ) -> None:
        self.first = path / "session.mcap" if path.is_dir() else path
        self._segment_number = _next_number(self.first, resume)
        epoch_ns, host_ns = anchor_ns or (time.time_ns(), time.monotonic_ns())
        self._offset_ns = epoch_ns - host_ns
        self._metadata = {
            **circumstances(epoch_ns),
            "clock_offset_ns": str(self._offset_ns),
            "session": _session_name(self.first, resume),
            **metadata,
        }
        self._max_bytes = max_bytes
        self._max_ns = max_seconds * 1e9
        self._numbers = dict.fromkeys(CHANNELS, 0)
        self._began_ns: int | None = None
        self._last_ns = self._last_epoch_ns = 0
        self._finished_bytes = 0
        self.incident = ""
        try:
            self._segment = self._open()
        except OSError as error:
            raise UsageError(f"cannot record to {self.first}: {error.strerror}") from error

    @property
    def path(self) -> Path:
        """The file that is being written."""
        return self._segment.path

    @property
    def bytes_written(self) -> int:
        """Bytes on the disk, all files of this run together."""
        return self._finished_bytes + self._segment.committed

    @property
    def pending(self) -> int:
        """Bytes that the disk has refused so far and that wait in memory."""
        return self._segment.pending

    def describe(self, facts: Mapping[str, str]) -> None:
        """Add to the metadata what was not known at the start, e.g. the wire format."""
        self._metadata |= facts
        self._segment.describe(self._facts())

    def rx(self, data: bytes, host_ns: int) -> None:
        """Add one read."""
        self._add(RX, data, host_ns)

    def missed(self, reads: int) -> None:
        """Leave out the numbers of reads that are not kept, so that a replay knows of the gap."""
        self._numbers[RX] += reads

    def end_with_gap(self, missed: int) -> None:
        """Add an empty read behind reads that were not kept: without one their gap is not seen."""
        self.missed(missed)
        self.rx(b"", self._last_ns)

    def tx(self, data: bytes, host_ns: int) -> None:
        """Add one write to the device."""
        self._add(TX, data, host_ns)

    def event(self, fields: Mapping[str, Any], host_ns: int) -> None:
        """Add one remark; `fields` has a ``kind`` and is plain JSON."""
        self._add(EVENTS, json.dumps(dict(fields)).encode(), host_ns)

    def chunk(self, chunk: Chunk) -> None:
        """Add what one read of a source brought: an event of the link, a mark, bytes, or both."""
        if chunk.event == "mark":
            self.event({"kind": "mark", "text": chunk.text}, chunk.host_ns)
        elif chunk.event and chunk.event != "end":
            self.event({"kind": "link", "event": chunk.event}, chunk.host_ns)
        if chunk.data:
            self.rx(chunk.data, chunk.host_ns)

    def commit(self) -> int:
        """Write the buffered data, then begin a new file if it is time; return bytes written.

        Raises
        ------
        OSError
            If the disk does not take it. Nothing is lost then: the next commit tries again.
        """
        self._check_file()
        written = self._segment.commit()
        if self._is_long():
            self._rotate()
        return written

    def _check_file(self) -> None:
        """Notice what another program has done to the file, and lose as little as can be."""
        name = self.path.name
        if self._segment.is_replaced:
            if self.path.exists():
                self._segment_number += 1
            self._segment.restore(segment_path(self.first, self._segment_number))
            self.incident = f"another program has removed {name}: saved again as {self.path.name}"
        elif added := self._segment.resync_size():
            self._rotate(truncated=True)
            self.incident = (
                f"another program has {'cut' if added < 0 else 'added'} {abs(added)} bytes "
                f"{'off' if added < 0 else 'to'} {name}: recording continues in {self.path.name}"
            )

    def discard(self) -> int:
        """Give up what the disk has refused so far; return its bytes. Their reads become a gap."""
        return self._segment.discard()

    def sync(self) -> None:
        """Make what was committed survive a power cut."""
        self._segment.sync()

    def close(self) -> None:
        """Write the rest and the index."""
        self._segment.close()

    def _add(self, topic: str, data: bytes, host_ns: int) -> None:
        self._numbers[topic] += 1
        if self._began_ns is None:
            self._began_ns = host_ns
        self._last_ns = host_ns
        # Threads report their times one after the other, not always in the order of time.
        epoch_ns = self._last_epoch_ns = max(host_ns + self._offset_ns, self._last_epoch_ns)
        self._segment.add(topic, self._numbers[topic], epoch_ns, host_ns, data)

    def _is_long(self) -> bool:
        if self._segment.committed >= self._max_bytes:
            return True
        return self._began_ns is not None and self._last_ns - self._began_ns >= self._max_ns

    def _rotate(self, truncated: bool = False) -> None:
        """Open the next file before the old one is given up, so that a failure costs nothing.

        What waits for a truncated file goes into the next: it could not be read behind the cut.
        """
        self._segment_number += 1
        try:
            following = self._open()
        except OSError:
            self._segment_number -= 1
            raise
        finished, self._segment = self._segment, following
        if truncated:
            following.copy_unwritten(finished)
        self._began_ns = None
        try:
            finished.close()
        finally:
            self._finished_bytes += finished.committed

    def _open(self) -> Segment:
        return Segment(segment_path(self.first, self._segment_number), self._facts())

    def _facts(self) -> dict[str, str]:
        return {**self._metadata, "segment": str(self._segment_number)}


def write_recording(path: Path, chunks: Iterable[Chunk], metadata: Mapping[str, str]) -> Path:
    """Write a whole recording from chunks that are already there: an import, a simulation.

    Parameters
    ----------
    path : Path
        The file to write; must not exist.
    chunks : iterable of Chunk
        In order.
    metadata : mapping of str to str
        What to say about it.

    Returns
    -------
    Path
        The first file.
    """
    session = SessionWriter(path, metadata, max_seconds=float("inf"), max_bytes=float("inf"))
    waiting = 0
    try:
        with closing(session):
            for number, chunk in enumerate(chunks, 1):
                session.chunk(chunk)
                waiting += len(chunk.data)
                if waiting > COMMIT_BYTES or number % MOST_MESSAGES == 0:
                    session.commit()
                    waiting = 0
    except OSError as error:
        raise UsageError(f"cannot record to {session.path}: {error.strerror}") from error
    return session.first


def _next_number(first: Path, resume: bool) -> int:
    existing = [file for file in session_files(first) if file.exists()]
    if resume and not existing:
        raise UsageError(f"there is no session to resume at {first}")
    if existing and not resume:
        raise UsageError(f"{existing[0]} exists; a recording is never overwritten, name another")
    return (segment_number(first, existing[-1]) or 0) + 1 if existing else 0


def _session_name(first: Path, resume: bool) -> str:
    """Return what the files of one session have in common: the name survives a resumption."""
    return outline_of(first).metadata.get("session", "") if resume else uuid.uuid4().hex
