"""One MCAP file that is being written, and whose end is always a whole record.

The MCAP writer writes into memory; `Segment.commit` writes it to the disk in
one call. If the disk takes only a part of it (it is full), the file is cut back to the last whole
record and the rest stays in memory for the next try, so that a file is never damaged in its middle
and a disk that has room again in time costs nothing at all. A file that another program deletes or
replaces is still there as long as it is open: `Segment.restore` saves it under a name again.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from allanscope.recording.layout import CHANNELS, EVENT_SCHEMA, EVENTS, PROFILE, sealed

__all__ = ["COMMIT_BYTES", "Segment"]

COMMIT_BYTES = 1 << 22
"""Bulk writing goes to the disk in pieces of about this size."""

_COPIED_BYTES = 1 << 22
CHUNK_BYTES = 1 << 18
"""A chunk is closed at this size even when no commit is due: what rots is lost by the chunk."""


class Segment:
    """One file of a session.

    Parameters
    ----------
    path : Path
        A file that must not exist yet.
    metadata : mapping of str to str
        Written first, before any sample.

    Raises
    ------
    OSError
        If the file exists or cannot be written.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self.path = path
        self.committed = 0
        self._has_index = True
        self._fd = _made(path)
        self._spool = _Spool()
        self._writer: Any = Writer(
            cast("IO[bytes]", self._spool), chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD
        )
        self._writer.start(profile=PROFILE, library="allanscope")
        schema = self._writer.register_schema("allanscope.event", "jsonschema", EVENT_SCHEMA)
        for topic, number in CHANNELS.items():
            encoding, schema_id = (
                ("json", schema) if topic == EVENTS else ("application/octet-stream", 0)
            )
            channel = self._writer.register_channel(topic, encoding, schema_id)
            assert channel == number, "the MCAP writer numbers channels from 1 in order"
        self.describe(metadata)
        try:
            self.commit()
            self.sync()
            _sync_folder(path.parent)
        except OSError:
            os.close(self._fd)
            path.unlink(missing_ok=True)
            raise

    @property
    def pending(self) -> int:
        """Bytes that wait in memory for the next commit, without the chunk in progress."""
        return len(self._spool.waiting)

    def describe(self, metadata: Mapping[str, str]) -> None:
        """Add a metadata record; the newest one counts."""
        self._writer.add_metadata(PROFILE, sealed(metadata))

    def add(self, topic: str, sequence: int, epoch_ns: int, host_ns: int, data: bytes) -> None:
        """Add one message, in memory."""
        number = sequence & 0xFFFFFFFF
        self._writer.add_message(CHANNELS[topic], epoch_ns, data, host_ns, number)

    def commit(self) -> int:
        """Close the chunk in progress and write all that waits; return the bytes written.

        Raises
        ------
        OSError
            If the disk does not take it all; the file then ends where it ended before, and the
            next commit tries again.
        """
        self._writer.flush()
        waiting = self._spool.waiting
        try:
            _write_all(self._fd, waiting)
        except OSError:
            os.ftruncate(self._fd, self.committed)
            os.lseek(self._fd, self.committed, os.SEEK_SET)
            raise
        written = len(waiting)
        self.committed += written
        waiting.clear()
        return written

    def sync(self) -> None:
        """Wait until what was committed would survive a power cut."""
        getattr(os, "fdatasync", os.fsync)(self._fd)

    @property
    def is_replaced(self) -> bool:
        """Whether another program has deleted the file, or put another one in its place."""
        try:
            named = self.path.stat()
        except FileNotFoundError:
            return True
        own = os.fstat(self._fd)
        return (named.st_dev, named.st_ino) != (own.st_dev, own.st_ino)

    def restore(self, path: Path) -> None:
        """Save all that was committed in a new file, and go on there.

        Raises
        ------
        OSError
            If there is no room for it; then nothing has changed.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        fd = _made(path)
        try:
            for at in range(0, self.committed, _COPIED_BYTES):
                os.lseek(self._fd, at, os.SEEK_SET)
                piece = os.read(self._fd, min(_COPIED_BYTES, self.committed - at))
                _write_all(fd, bytearray(piece))
            _sync_folder(path.parent)
        except OSError:
            os.lseek(self._fd, self.committed, os.SEEK_SET)
            os.close(fd)
            path.unlink(missing_ok=True)
            raise
        os.close(self._fd)
        self._fd, self.path = fd, path

    def resync_size(self) -> int:
        """Go on at the end of the file as it is; return the bytes that another program added.

        Negative where it has cut the file.
        """
        added = os.lseek(self._fd, 0, os.SEEK_END) - self.committed
        self.committed += added
        return added

    def copy_unwritten(self, former: Segment) -> None:
        """Take what another segment has not written yet: whole chunks, the same in every file."""
        former._writer.flush()
        self._spool.write(bytes(former._spool.waiting))
        former._spool.waiting.clear()

    def discard(self) -> int:
        """Give up what waits in memory, as the disk will never take it; return its bytes."""
        self._writer.flush()
        given_up = len(self._spool.waiting)
        self._spool.waiting.clear()
        self._has_index = self._has_index and not given_up
        return given_up

    def close(self) -> None:
        """Write the index at the end and close; the file is readable even if this fails."""
        try:
            if self._has_index:
                self._writer.finish()
            self.commit()
            self.sync()
        finally:
            os.close(self._fd)


class _Spool:
    """The memory that the MCAP writer takes for a file."""

    def __init__(self) -> None:
        self.waiting = bytearray()
        self._written = 0

    def write(self, data: bytes) -> int:
        self.waiting += data
        self._written += len(data)
        return len(data)

    def tell(self) -> int:
        return self._written

    def flush(self) -> None:
        """Nothing: the commit is ours."""


def _made(path: Path) -> int:
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    return os.open(path, flags, 0o644)


def _write_all(fd: int, data: bytearray) -> None:
    with memoryview(data) as view:
        done = 0
        while done < len(view):
            done += os.write(fd, view[done:])


def _sync_folder(folder: Path) -> None:
    """Make the new name itself survive a power cut; a no-op where folders cannot be opened."""
    if os.name != "posix":
        return
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
