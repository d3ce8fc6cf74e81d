"""A device at the other end of a real pseudo-terminal, and reading until it has spoken."""

from __future__ import annotations

import contextlib
import fcntl
import os
import termios
import time
import tty
from collections.abc import Callable
from pathlib import Path

from allanscope.recording import Chunk
from allanscope.sources import SerialSource

PATIENCE = 400
"""Reads, of 50 ms each at most, in which something has to happen."""


class Device:
    """The far end of a pseudo-terminal; unplugging and plugging in keeps the path."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._ends: list[int] = []
        self.plug()

    def plug(self) -> None:
        near, far = os.openpty()
        tty.setraw(far)
        self._ends = [near, far]
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(far))

    def unplug(self) -> None:
        self.path.unlink(missing_ok=True)
        for end in self._ends:
            os.close(end)
        self._ends = []

    def say(self, data: bytes) -> None:
        assert os.write(self._ends[0], data) == len(data)

    def fill(self) -> int:
        """Write zeros until no more are taken; return how many were."""
        taken = 0
        os.set_blocking(self._ends[0], False)
        with contextlib.suppress(BlockingIOError):
            while True:
                taken += os.write(self._ends[0], bytes(500))
        os.set_blocking(self._ends[0], True)
        # The kernel passes on what was written in its own time.
        for _ in range(PATIENCE):
            if (
                int.from_bytes(fcntl.ioctl(self._ends[1], termios.FIONREAD, bytes(4)), "little")
                > 4000
            ):
                return taken
            time.sleep(0.01)
        raise AssertionError("the port was never full")

    def heard(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            data += os.read(self._ends[0], count - len(data))
        return data


def read_until(source: SerialSource, wanted: Callable[[Chunk], bool]) -> list[Chunk]:
    """Read until a chunk is wanted; return all that were not empty."""
    found = []
    for _ in range(PATIENCE):
        chunk = source.read()
        if chunk.data or chunk.event:
            found.append(chunk)
        if wanted(chunk):
            return found
    raise AssertionError(f"did not come; there was {found}")


def read_bytes(source: SerialSource, count: int) -> bytes:
    """Read until that many bytes have come."""
    data = b""
    for _ in range(PATIENCE):
        data += source.read().data
        if len(data) >= count:
            return data
    raise AssertionError(f"only {len(data)} of {count} bytes came")
