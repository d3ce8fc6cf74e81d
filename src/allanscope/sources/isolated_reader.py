"""A port that is read by a process of its own (`port_reader`), and by this one until that is there.

The port is opened and configured here, and written to from here. The other process is given the
open file; while it starts, which takes some hundredths of a second, this one reads, so that a board
need not wait and a start takes no longer. Then it is told to go on alone: never do both read. If it
cannot be started, or is killed, this process reads again, and `description` says so.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections import deque
from contextlib import suppress
from pathlib import Path

from allanscope.sources import port_reader
from allanscope.sources.port_reader import (
    DATA,
    GONE,
    HEADER,
    HELD_BYTES,
    PRIORITY,
    READY,
    REAL_TIME,
    RUNNING_US,
)
from allanscope.sources.rtkit import make_real_time
from allanscope.sources.transport import PosixPort

__all__ = ["IsolatedReader", "buffers", "isolated_reader_of", "may_run_in_real_time"]

PIPE_BYTES = 1 << 20
END_S = 2.0
A_THREAD = "a thread of the measuring process"


def isolated_reader_of(link: PosixPort) -> PosixPort | IsolatedReader:
    """Return a link that a process of its own reads, where there can be one; else the link."""
    if not sys.platform.startswith("linux") or not sys.executable:
        return link
    try:
        return IsolatedReader(link)
    except OSError:
        return link


def buffers() -> dict[str, int]:
    """Return how many bytes wait on their way here without loss, by who holds them.

    The system's part is measured on a pseudo-terminal without a reader; of a board it is the same
    queue, and what its own driver holds comes to it.
    """
    import tty

    device, host = os.openpty()
    try:
        tty.setraw(host)
        os.set_blocking(device, False)
        in_system = 0
        with suppress(BlockingIOError):
            while True:
                in_system += os.write(device, bytes(256))
    finally:
        os.close(device)
        os.close(host)
    return {"the system": in_system, "the reader": HELD_BYTES}


def may_run_in_real_time() -> bool:
    """Return whether the reader is allowed real-time priority, by asking for it for a moment."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    except OSError:
        return _is_granted_real_time()
    os.sched_setscheduler(0, policy, parameters)
    return True


def _is_granted_real_time() -> bool:
    """Return whether RealtimeKit gives real-time priority, by having it given to a process.

    Not to this one, whose limits could not be taken back.
    """
    limits = f"import resource as r, sys; r.setrlimit(r.RLIMIT_RTTIME, {RUNNING_US})"
    with subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", f"{limits}; print(flush=True); sys.stdin.read()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as waiting:
        assert waiting.stdout is not None
        waiting.stdout.readline()
        return make_real_time(waiting.pid, PRIORITY)


class IsolatedReader:
    """A serial port whose reads are those of another process.

    Parameters
    ----------
    link : PosixPort
        The open port.

    Attributes
    ----------
    read_ns : int
        Host monotonic time, in ns, of what `read` returned last; 0 where it was read right then.
    description : str
        Who reads, at which priority.
    is_reading : bool
        Whether the other process reads.
    missed : bool
        Set when that process was killed: bytes that it had read are lost.

    Raises
    ------
    OSError
        If no process can be started.
    """

    def __init__(self, link: PosixPort) -> None:
        self._link = link
        self.read_ns = 0
        self.description = A_THREAD
        self.is_reading = self.missed = False
        self._raw = bytearray()
        self._frames: deque[tuple[bytes, int, bytes]] = deque()
        self._data, out = os.pipe()
        control, self._control = os.pipe()
        try:
            self._enlarge_pipe(out)
            script = Path(port_reader.__file__)
            self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
                # Isolated and without site: it starts in ten milliseconds.
                [sys.executable, "-I", "-S", script, *map(str, (link.fileno(), out, control))],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=(link.fileno(), out, control),
                start_new_session=True,  # what the terminal sends is for the measuring process
            )
        except BaseException:
            os.close(self._data)
            os.close(self._control)
            raise
        finally:
            os.close(out)
            os.close(control)

    @property
    def waiting(self) -> bool:
        """Whether something has been read that `read` returns at once."""
        return bool(self._frames)

    def read(self, timeout_s: float) -> bytes:
        """Return what one read of the port brought, waiting for it at most this long."""
        until = time.monotonic() + timeout_s
        while not self._frames:
            if self._process is None:
                self.read_ns = 0
                return self._link.read(max(until - time.monotonic(), 0.0))
            ports = [] if self.is_reading else [self._link.fileno()]
            left_s = max(until - time.monotonic(), 0.0)
            ready = select.select([self._data, *ports], [], [], left_s)[0]
            if not ready:
                self.read_ns = 0
                return b""
            if self._data in ready:
                self._read_pipe()
            elif ready:
                self.read_ns = 0
                return self._link.read(0.0)
        kind, self.read_ns, data = self._frames.popleft()
        if kind == GONE:
            number = int(data)
            raise OSError(
                number, os.strerror(number) if number else "the device closed the connection"
            )
        return data

    def write(self, data: bytes) -> None:
        """Send bytes, from this process."""
        self._link.write(data)

    def close(self) -> None:
        """End the other process and close the port: it is free when both have released it."""
        self._end()
        self._link.close()

    def _read_pipe(self) -> None:
        """Take what is in the pipe."""
        got = os.read(self._data, PIPE_BYTES)
        if not got:
            self._fall_back()
            return
        self._raw += got
        at = 0
        while len(self._raw) - at >= HEADER.size:
            kind, read_ns, size = HEADER.unpack_from(self._raw, at)
            if len(self._raw) - at < HEADER.size + size:
                break
            at += HEADER.size + size
            frame = bytes(self._raw[at - size : at])
            if kind == READY:
                self._start_reader_process(frame.decode())
            elif kind in (DATA, GONE):
                self._frames.append((kind, read_ns, frame))
        del self._raw[:at]

    def _start_reader_process(self, priority: str) -> None:
        """Let the other process read from here on; nothing is read here any more."""
        with suppress(BrokenPipeError):
            os.write(self._control, b"g")
        self.is_reading = True
        if (
            self._process is not None
            and not priority.startswith(REAL_TIME)
            and make_real_time(self._process.pid, PRIORITY)
        ):
            priority = f"{REAL_TIME} (SCHED_RR {PRIORITY}, by RealtimeKit)"
        self.description = f"a separate process at {priority}"

    def _fall_back(self) -> None:
        """Read here again: the other process ended without a word."""
        self.missed = self.is_reading
        self.is_reading = False
        self.description = f"{A_THREAD}, because its process has ended"
        self._raw.clear()
        self._end()

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        os.close(self._control)
        os.close(self._data)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_S)

    @staticmethod
    def _enlarge_pipe(pipe: int) -> None:
        """Let the pipe hold seconds instead of a fraction of one, where that is allowed."""
        import fcntl

        with suppress(OSError, AttributeError):
            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
