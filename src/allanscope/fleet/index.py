"""The index of a fleet where a file cannot be appended to, as on an object store."""

from __future__ import annotations

import time

from allanscope.fleet.remote_path import RemotePath

__all__ = ["RemoteIndex"]

FLUSH_S = 30.0
"""A killed run forgets the files that it saw in this time, and looks at them anew."""


class RemoteIndex:
    """Lines that go into numbered files of a folder, one every half minute and one at the end.

    The first is written at once, empty: a folder that cannot be written to is refused before work.

    Parameters
    ----------
    folder : RemotePath
        Where ``index-NUMBER.jsonl`` go; numbers are times, so that those of later runs are higher.

    Raises
    ------
    OSError
        If the folder cannot be written to.
    """

    def __init__(self, folder: RemotePath) -> None:
        self._folder = folder
        self._lines: list[str] = []
        self._flushed_s = time.monotonic()
        self._next()
        self._path.write_bytes(b"")

    @property
    def name(self) -> str:
        """The file that is written next."""
        return str(self._path)

    def write(self, line: str) -> None:
        """Add a line."""
        self._lines.append(line)

    def flush(self) -> None:
        """Write what has gathered, when it is time."""
        if time.monotonic() - self._flushed_s > FLUSH_S:
            self._put()
            self._next()

    def close(self) -> None:
        """Write the rest."""
        if self._lines:
            self._put()

    def _put(self) -> None:
        self._path.write_bytes("".join(self._lines).encode())
        self._lines = []
        self._flushed_s = time.monotonic()

    def _next(self) -> None:
        self._path = self._folder / f"index-{time.time_ns():020d}.jsonl"
