"""The reader of a port, as a process of its own: bytes and the times at which they came, to a pipe.

The kernel holds some ten milliseconds of a fast device. A thread of the measuring process waits for
the interpreter whenever another thread computes, and loses bytes on a busy machine; this process
has one thread, imports a handful of modules of the standard library, and asks for real-time
priority. It is run by its path, without `site` and without allanscope::

    port_reader.py PORT OUT CONTROL      three file descriptors

It says ``ready`` on OUT, waits for a byte on CONTROL, and from then on writes a frame for each
read: `HEADER` (kind, time, length) and the bytes. It ends when the port fails, with a last frame
that says why, or when CONTROL is closed, which the system does when the other process dies.
"""

from __future__ import annotations

import os
import select
import signal
import struct
import sys
import time
from contextlib import suppress

__all__ = ["DATA", "GONE", "HEADER", "READY", "ReadPacer"]

HEADER = struct.Struct("<cQI")
"""Of a frame: its kind, host monotonic time in ns, length of what follows in bytes."""

READY, DATA, GONE = b"r", b"d", b"g"
"""Kinds of frames: the priority that was had; what a read brought; the error that ended it."""

BATCH_S, FAST_BATCH_S = 0.01, 0.02
"""Pause before the next read of a slow and of a fast stream, for larger reads: fifty a
second cost a tenth of what a thousand cost, while a row that comes alone is to be stamped when it
comes."""

WORTH_BATCHING = 1024
BATCH_BYTES = 2048
"""Where so many would come in the longer time it is taken, but never more than is likely to bring
half of the 4096 bytes that a tty of Linux holds for its reader."""

UNEVEN = 0.25
"""By this share pauses are shorter or longer, at random: a reader that is as regular as the device
would keep in step with it, and its own pace would be taken for the rate of the device."""

LATE_BYTES = 3072
"""Who finds so many is late, because the computer is busy, and reads on without a pause."""

READ_BYTES = 1 << 16
HELD_BYTES = 64 << 20
"""Largest queue of reads; beyond it the port is not read."""
LOOK_EVERY_S = 1.0
REAL_TIME = "real-time priority"
PRIORITY, NICE = 10, -11
RUNNING_US = 100_000, 200_000
"""Longest times at real-time priority without waiting for anything, which no reading of a port
needs: at the first it is given up, at the second the system ends the process."""


class ReadPacer:
    """Say how long to pause before the next read.

    Examples
    --------
    >>> pace = ReadPacer()
    >>> pace.after(15, 10_000_000), pace.after(1860, 20_000_000), pace.after(4000, 20_000_000)
    (0.01, 0.02, 0.0)
    >>> 0.0075 <= pace.unevenly(0.01) <= 0.0125
    True
    """

    def __init__(self) -> None:
        self._state = 1

    def after(self, size: int, took_ns: int) -> float:
        """Return the pause in s after a read of `size` bytes, so long after the one before."""
        if size >= LATE_BYTES:
            return 0.0
        pace = size / max(1e-9 * took_ns, 1e-6)
        longest_s = FAST_BATCH_S if pace * FAST_BATCH_S >= WORTH_BATCHING else BATCH_S
        return min(longest_s, BATCH_BYTES / pace)

    def unevenly(self, pause_s: float) -> float:
        """Return a pause that is not like the last one, where it is not the buffer that ends it."""
        if pause_s < BATCH_S:
            return pause_s
        # A congruential generator (Numerical Recipes): the module `random` takes long to import.
        self._state = (1664525 * self._state + 1013904223) % 2**32
        return pause_s * (1.0 - UNEVEN + 2.0 * UNEVEN * self._state / 2**32)


def _raise_priority() -> str:
    """Take the highest priority that is allowed, and say which."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    except (AttributeError, OSError):
        _accept_real_time()
    else:
        return f"{REAL_TIME} (SCHED_RR {PRIORITY})"
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
    except (AttributeError, OSError):
        return "usual priority, because no higher one is allowed"
    return f"raised priority (nice {NICE})"


def _accept_real_time() -> None:
    """Limit the time without a pause, which RealtimeKit asks for, and give way at its end."""
    with suppress(ImportError, AttributeError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_RTTIME, RUNNING_US)
        usual = os.SCHED_OTHER | os.SCHED_RESET_ON_FORK  # the flag is there to stay
        signal.signal(signal.SIGXCPU, lambda *_: os.sched_setscheduler(0, usual, os.sched_param(0)))


def _frame(kind: bytes, data: bytes) -> bytes:
    return HEADER.pack(kind, time.monotonic_ns(), len(data)) + data


def main(port: int, out: int, control: int) -> None:
    """Read until the port fails or the receiving process ends."""
    parent = os.getppid()
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGPIPE"):
        # The measuring process ends in an orderly way when it is told to, and this one after it.
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    os.write(out, _frame(READY, _raise_priority().encode()))
    if not os.read(control, 1):
        return
    os.set_blocking(out, False)
    waiting = bytearray()
    pace, heard_ns, until = ReadPacer(), time.monotonic_ns(), 0.0
    while os.getppid() == parent:
        left_s = until - time.monotonic()
        wanted = [control] if left_s > 0.0 or len(waiting) > HELD_BYTES else [control, port]
        timeout_s = left_s if left_s > 0.0 else LOOK_EVERY_S
        readable, writable, _ = select.select(wanted, [out] if waiting else [], [], timeout_s)
        if control in readable:
            return
        if port in readable:
            try:
                data = os.read(port, READ_BYTES)
            except BlockingIOError:
                continue
            except OSError as error:
                data, why = b"", str(error.errno)
            else:
                why = "" if data else "0"
            if why:
                os.set_blocking(out, True)
                _write_all(out, waiting + _frame(GONE, why.encode()))
                return
            waiting += _frame(DATA, data)
            now_ns = time.monotonic_ns()
            until = time.monotonic() + pace.unevenly(pace.after(len(data), now_ns - heard_ns))
            heard_ns = now_ns
        if readable or writable:
            _write_some(out, waiting)


def _write_some(out: int, waiting: bytearray) -> None:
    """Write what is taken at once."""
    try:
        while waiting:
            del waiting[: os.write(out, waiting[:READ_BYTES])]
    except BlockingIOError:
        pass


def _write_all(out: int, data: bytes | bytearray) -> None:
    while data:
        data = data[os.write(out, data) :]


if __name__ == "__main__":
    with suppress(BrokenPipeError):  # the other process is gone
        main(*map(int, sys.argv[1:4]))
