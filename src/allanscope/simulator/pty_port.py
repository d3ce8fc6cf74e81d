"""A pseudo-terminal at a fixed path: a virtual serial port that any program can open.

Traps, each met by a line below. A new pty is cooked and echoes what it is told, so it is made raw
before anybody opens it. Its settings live as long as the device's end is open, so the host's end
need not be held open, and the device can see whether a host is there. A cable is pulled by
closing the device's end; that throws away what the host has not read, so those bytes are counted
first. The number of a pty changes from one to the next, so the path is a link to it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import sys
import tempfile
import termios
import time
import tty
from collections.abc import Iterator
from pathlib import Path

from allanscope.errors import UsageError

__all__ = ["PtyPort"]

PATIENCE_S = 0.5
"""A queue in which nothing moved for so long is at rest, however busy the machine is."""
CALM_S = 0.02
MARKER = b"\x55\xaa" * 8
"""Written last of all, so that the end of what was written before can be seen. It holds no byte
that would end a frame."""


class PtyPort:
    """A raw pty behind a symbolic link.

    Parameters
    ----------
    path : Path, optional
        Where to put the link; ``ttySensorTile0`` in a new temporary folder when not given.

    Raises
    ------
    UsageError
        If the path is taken by something that is no link, or its folder does not exist.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._folder = None if path else tempfile.TemporaryDirectory(prefix="allanscope-")
        self._path = path or Path(str(self._folder and self._folder.name)) / "ttySensorTile0"
        if self._path.exists() and not self._path.is_symlink():
            raise UsageError(f"{self._path} exists and is not a link; choose another path")
        self.url = str(self._path)
        self._device: int | None = None
        self._open()

    def attached(self) -> bool:
        """Return whether a host has it open."""
        return self._device is not None and not self._poll(0.0) & select.POLLHUP

    def read(self) -> bytes:
        """Return what the host wrote; empty when nothing."""
        if self._device is None:
            return b""
        try:
            return os.read(self._device, 4096)
        except OSError:  # no data, or no reader
            return b""

    def write(self, data: bytes) -> int:
        """Hand over bytes and return how many the port took: 0 when it is full."""
        if self._device is None:
            return 0
        try:
            return os.write(self._device, data)
        except OSError:
            return 0

    def wait(self, timeout_s: float) -> None:
        """Wait until the host writes, or for `timeout_s`."""
        if not self.attached():  # a pty without a host is always "ready"
            time.sleep(timeout_s)
        else:
            self._poll(timeout_s)

    def forget(self) -> int:
        """Throw away what the host has not read, and return how many bytes that was."""
        if self._device is None:
            return 0
        with self._host_end() as host:
            return _drain(self._device, host)

    def unplug(self) -> int:
        """Pull the cable: the host's end fails. Returns how many bytes the host never read.

        A host that is reading gets a moment to read what was sent before, so that it and this
        do not both take from the same queue. The link goes first: one that is held up, and finds
        the queue emptied, must not open a port that is about to go.
        """
        if self._device is None:
            return 0
        self._path.unlink(missing_ok=True)
        with self._host_end() as host:
            calm_since = start = time.monotonic()
            while (now := time.monotonic()) < min(calm_since + CALM_S, start + PATIENCE_S):
                if _waiting(host):
                    calm_since = now
                time.sleep(CALM_S / 10)
            unread = _drain(self._device, host)
        self._hang_up()
        return unread

    def replug(self) -> None:
        """Put the cable back: the same `url` can be opened again."""
        if self._device is None:
            self._open()

    def close(self) -> None:
        """Remove the port for good."""
        self._hang_up()
        if self._folder:
            self._folder.cleanup()

    def _open(self) -> None:
        device, host = os.openpty()
        try:
            tty.setraw(host)
            os.set_blocking(device, False)
            self._name = os.ttyname(host)
            # The link appears in one step, in the place of one that a crash may have left.
            fresh = self._path.with_name(f"{self._path.name}.{os.getpid()}")
            fresh.symlink_to(self._name)
            fresh.replace(self._path)
        except OSError as error:
            os.close(device)
            raise UsageError(f"cannot make a port at {self._path}: {error.strerror}") from error
        finally:
            os.close(host)
        self._device = device

    def _hang_up(self) -> None:
        if self._device is None:
            return
        self._path.unlink(missing_ok=True)
        os.close(self._device)
        self._device = None

    @contextlib.contextmanager
    def _host_end(self) -> Iterator[int]:
        host = os.open(self._name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            yield host
        finally:
            os.close(host)

    def _poll(self, timeout_s: float) -> int:
        """Return the events of the device's end, after at most `timeout_s`."""
        assert self._device is not None
        poll = select.poll()
        poll.register(self._device, select.POLLIN)
        return next((events for _, events in poll.poll(timeout_s * 1e3)), 0)


def _waiting(host: int) -> int:
    """Return how many bytes the host could read at once."""
    answer = fcntl.ioctl(host, termios.FIONREAD, b"\0" * 4)
    return int.from_bytes(answer, sys.byteorder)


def _drain(device: int, host: int) -> int:
    """Read everything that the host has not, and return how many bytes it was.

    What was written passes through a queue of the system, whose worker may be late: that nothing
    can be read does not mean that nothing is left. So a marker is sent after it and waited for.
    Should the host read the marker, it has read everything before it.
    """
    read, unsent, end = 0, MARKER, b""
    deadline = time.monotonic() + PATIENCE_S
    while end != MARKER and time.monotonic() < deadline:
        with contextlib.suppress(BlockingIOError):
            unsent = unsent[os.write(device, unsent) :] if unsent else b""
        data = b""
        with contextlib.suppress(BlockingIOError):
            data = os.read(host, 65536)  # empty, too, when the host has set VMIN to 0
        if not data:
            time.sleep(0.001)
            continue
        read += len(data)
        end = (end + data)[-len(MARKER) :]
        deadline = time.monotonic() + PATIENCE_S
    return max(read - len(MARKER), 0)
