"""The live recorder: a thread that writes, so that neither a slow nor a full disk stops a reading.

The reader thread hands over every chunk and goes on; it never waits, and wakes no other thread. The
writer thread takes what has come and closes an MCAP chunk twice a second, which bounds what a
killed process loses, and every few seconds waits for the disk itself, which bounds what a power cut
loses. When the disk is full, the session goes on in memory for a while and is written as soon as
there is room again; beyond that, reads are dropped, counted, and their numbers left out so that a
replay knows of the gap. `alarm` says all this in one line; monitoring continues in every case.
"""

from __future__ import annotations

import math
import os
import queue
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from allanscope.recording.chunk import Chunk
from allanscope.recording.session import SessionWriter

__all__ = ["Recorder"]

COMMIT_S = 0.5
"""A killed process is to lose less than a second, on a busy machine too."""

SYNC_S = 5.0
HURRY_BYTES = 1 << 20
"""So much makes the writer come early: a source may be faster than any port."""

BACKLOG_BYTES = 32 << 20
"""What may wait in memory for the disk: some six minutes of a device at its fastest."""

RESERVE_BYTES = 4 << 20
"""Kept free for the end of the file, which says what a full disk did not take."""

SCARCE_S = (60.0, 120.0, 300.0, 600.0, 1800.0)
"""Free space that is used up sooner than the last of these is worth an alarm, and another one
whenever it falls below the next."""


class Recorder:
    """Record a live session; every method returns at once and may be called from any thread.

    Parameters
    ----------
    path : Path
        The first file, or a folder in which it will be called ``session.mcap``.
    metadata : mapping of str to str
        Device, wire format, settings: whatever a reader should know. Written before all else.
    on_alarm : callable, optional
        Is called in the writer thread with the alarm whenever it changes; empty when it is over.
        It changes when there is something new to say, not with every figure.
    resume : bool
        Continue the session that is there in a new file.
    commit_s, sync_s : float
        How often to write, and how often to wait for the disk.
    backlog_bytes : int
        What may wait in memory.
    max_seconds : float
        A new file is begun when one has become this long, or a gibibyte large.
    free_bytes : callable
        Free space of the disk that holds a folder.

    Raises
    ------
    UsageError
        If the session exists already or cannot be written there at all.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str],
        *,
        on_alarm: Callable[[str], None] | None = None,
        resume: bool = False,
        commit_s: float = COMMIT_S,
        sync_s: float = SYNC_S,
        backlog_bytes: int = BACKLOG_BYTES,
        max_seconds: float = 3600.0,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        self._session = SessionWriter(path, metadata, max_seconds=max_seconds, resume=resume)
        self.alarm = ""
        self.failure = ""
        """What of the recording is missing, known at its end; empty if nothing."""
        self.dropped_bytes = 0
        self.space_left_s: float | None = None
        self._scarce_s = math.inf
        self._on_alarm = on_alarm or (lambda _: None)
        self._commit_s, self._sync_s = commit_s, sync_s
        self._backlog_bytes = backlog_bytes
        self._free_bytes = free_bytes
        self._queue: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._hurry = threading.Event()
        self._lock = threading.Lock()
        self._queued_bytes = 0
        self._missed_reads = 0
        self._began = time.monotonic()
        self._size_before = _session_bytes(self._session.first)
        self._reserve = _reserved(self._session.first)
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The file that is being written."""
        return self._session.path

    @property
    def bytes_written(self) -> int:
        """Bytes on the disk."""
        return self._session.bytes_written

    def rx(self, chunk: Chunk) -> None:
        """Keep what one read brought."""
        size = len(chunk.data)
        with self._lock:
            if self._queued_bytes + self._session.pending + size > self._backlog_bytes:
                self.dropped_bytes += size
                self._missed_reads += 1
                return
            self._queued_bytes += size
            hurry = self._queued_bytes >= HURRY_BYTES
            missed, self._missed_reads = self._missed_reads, 0
        self._put(lambda: self._write_chunk(chunk, missed))
        if hurry and not self._hurry.is_set():
            self._hurry.set()

    def tx(self, data: bytes, host_ns: int) -> None:
        """Keep what was written to the device."""
        self._put(lambda: self._session.tx(data, host_ns))

    def event(self, fields: Mapping[str, Any], host_ns: int | None = None) -> None:
        """Keep a remark: a mapping with a ``kind``, plain JSON."""
        at = time.monotonic_ns() if host_ns is None else host_ns
        kept = dict(fields)
        self._put(lambda: self._session.event(kept, at))

    def mark(self, text: str, host_ns: int | None = None) -> None:
        """Keep a remark of the user at the present moment."""
        self.event({"kind": "mark", "text": text}, host_ns)

    def describe(self, **facts: str) -> None:
        """Add to the metadata what was not known at the start, e.g. the wire format."""
        self._put(lambda: self._session.describe(facts))

    def close(self, timeout_s: float = 30.0) -> None:
        """Write what waits, and the index; give a disk that hangs this long and no longer."""
        self._queue.put(None)
        self._hurry.set()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self._fail(f"{self.path}: the disk does not answer; the end is not written")

    def _put(self, task: Callable[[], None]) -> None:
        if self._thread.is_alive():
            self._queue.put(task)

    # --- the writer thread --------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._write()
        except Exception as error:  # whatever it is, it must not end the measurement
            self._fail(f"{self.path}: recording has stopped: {error}")
            self._backlog_bytes = -1

    def _write(self) -> None:
        next_commit = time.monotonic() + self._commit_s
        next_sync = time.monotonic() + self._sync_s
        while True:
            self._hurry.wait(max(next_commit - time.monotonic(), 0.0))
            self._hurry.clear()
            for _ in range(self._queue.qsize()):
                task = self._queue.get()
                if task is None:
                    self._finish()
                    return
                task()
            now = time.monotonic()
            if now >= next_commit:
                self._commit(sync=now >= next_sync)
                next_commit = now + self._commit_s
                next_sync = now + self._sync_s if now >= next_sync else next_sync

    def _write_chunk(self, chunk: Chunk, missed: int) -> None:
        if missed:
            self._session.missed(missed)
            self._session.event({"kind": "dropped", "reads": missed}, chunk.host_ns)
        self._session.chunk(chunk)
        with self._lock:
            self._queued_bytes -= len(chunk.data)

    def _commit(self, sync: bool) -> None:
        try:
            self._session.commit()
            if sync:
                self._session.sync()
            self._raise_alarm(self._remaining())
        except OSError as error:
            self._raise_alarm(self._refusal(error))

    def _finish(self) -> None:
        """End the file; on a disk that is full to the end, with what is missing said in it."""
        lost = self._missed_reads > 0
        try:
            if not self._try_commit():
                self._reserve.unlink(missing_ok=True)
            if not self._try_commit():
                self.dropped_bytes += self._session.discard()
                lost = True
            if lost:
                self._session.end_with_gap(self._missed_reads)
            self._reserve.unlink(missing_ok=True)
            self._session.close()
        except OSError as error:
            self._fail(f"{self.path}: its end is not written ({error.strerror})")
        else:
            self._raise_alarm(self._remaining())
            self.failure = self._dropped()

    def _try_commit(self) -> bool:
        try:
            self._session.commit()
        except OSError:
            return False
        return True

    def _refusal(self, error: OSError) -> str:
        """Return one line that changes only when something new is to be said."""
        state = "new data are held in memory"
        if self.dropped_bytes:
            state = "memory is full; new data are lost"
        return (
            f"{self.path}: not recording ({error.strerror}): {state}; free some space, "
            "monitoring continues"
        )

    def _remaining(self) -> str:
        """Return what is wrong although the disk has just taken everything."""
        parts = self._session.incident, self._dropped(), self._scarce_space_line()
        return "; ".join(one for one in parts if one)

    def _dropped(self) -> str:
        if not self.dropped_bytes:
            return ""
        return f"{self.dropped_bytes} bytes were not recorded: the disk was full or too slow"

    def _scarce_space_line(self) -> str:
        """Return what to say of the room that is left."""
        folder = self.path.parent
        # The viewer's file grows beside the recording, and at low rates faster.
        grown = max(_session_bytes(self._session.first) - self._size_before, self.bytes_written)
        rate = grown / max(time.monotonic() - self._began, 1.0)
        left_s = self.space_left_s = self._free_bytes(folder) / rate
        if left_s < self._scarce_s or left_s > 1.5 * self._scarce_s:
            self._scarce_s = next((step for step in SCARCE_S if left_s < step), math.inf)
        if self._scarce_s < math.inf:
            return (
                f"{folder} will be full in less than {self._scarce_s / 60:.0f} min; free some space"
            )
        return ""

    def _raise_alarm(self, line: str) -> None:
        if line != self.alarm:
            self.alarm = line
            with suppress(Exception):  # a listener that fails is no reason to stop writing
                self._on_alarm(line)

    def _fail(self, line: str) -> None:
        self.failure = "; ".join(one for one in (line, self._dropped()) if one)
        self._raise_alarm(self.failure)


def _session_bytes(first: Path) -> int:
    """Return the bytes of a session: of all files that are named after its first one."""
    size = 0
    with suppress(OSError), os.scandir(first.parent) as entries:
        for one in entries:
            if one.name.startswith(first.stem):
                size += one.stat().st_size
    return size


def _reserved(first: Path) -> Path:
    """Return a file that takes up room until the end; there is none where it does not fit."""
    path = first.with_name(f".{first.stem}.reserve")
    try:
        with path.open("wb") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
    except OSError:
        with suppress(OSError):
            path.unlink(missing_ok=True)
    return path
