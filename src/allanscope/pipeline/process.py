"""What a run asks of its process: signals that end it, little memory, help by others.

A run that lasts a night keeps its memory small. The C library keeps a heap for every thread, and
learns from large blocks that were freed to take the next ones from there too; after an hour of
results, each with copies of some twenty megabytes, those heaps are mostly gaps. Told otherwise, it
gives large blocks back at once. Half of what a process holds when it has begun are pages of
libraries that are used to load them and hardly ever again. They are unchanged pages of files, so
nothing is lost when they are released; the few that are still needed come back by themselves. Only
Linux with its usual C library is told anything.

A result makes and drops arrays as long as the record thousands of times. Each that is given back is
cleared page by page by the kernel when it is taken again: two fifths of the processor time at the
end of a live run. `reuse_memory` keeps what is freed in one heap, for a process that soon ends;
that holds less, too, than a heap for every thread.

SciPy keeps the tables of the last sixteen lengths that it transformed, of each kind of transform:
15 bytes a row. A record has another length at every result, and sixteen of the longest were 50 MB.

A search shares its axes with a second process, which takes half a second to load, several where no
bytecode is there yet. `search_process` starts it before anything heavy is loaded here: it is ready
when the input is read, and what it has compiled need not be compiled twice.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from allanscope.worker_process import KEPT_BYTES, REUSED_BYTES, SEARCH, WorkerProcess

__all__ = [
    "configure_malloc",
    "forget_transforms",
    "reuse_memory",
    "search_process",
    "stopped_by_signals",
    "trim_memory",
    "usable_processes",
]

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Ctrl-C, the system that shuts down or stops a service, the terminal or connection that closes."""

MOST_PROCESSES = 4
"""No more share the axes of one sensor: each takes a hundred megabytes and a second to start."""

LONG = 1 << 20
"""Bytes of an input from which a second process is worth its start."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX, _DONTNEED = -1, -3, -8, 4
_LARGE_BYTES = 1 << 18
_HEAPS = 2
_SHORTEST, _KEPT_TRANSFORMS = 8, 16
"""Length of the shortest of them, and how many lengths SciPy keeps."""


@contextmanager
def stopped_by_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` when a signal asks to end; the second one raises KeyboardInterrupt.

    A signal that the program was started to ignore, as under ``nohup``, stays ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def on_signal(number: int, _: object) -> None:
        signal.signal(number, signal.default_int_handler)
        stop()

    before = {
        number: signal.signal(number, on_signal)
        for number in ENDING
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def configure_malloc() -> None:
    """Keep blocks from 256 KiB on out of the heaps, and share two of them among all threads."""
    if (libc := _glibc()) is not None:
        libc.mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)
        libc.mallopt(_ARENA_MAX, _HEAPS)


def reuse_memory() -> None:
    """Keep freed blocks of up to 64 MiB for the next ones, in one heap for all threads."""
    if (libc := _glibc()) is not None:
        libc.mallopt(_MMAP_THRESHOLD, REUSED_BYTES)
        libc.mallopt(_TRIM_THRESHOLD, KEPT_BYTES)
        libc.mallopt(_ARENA_MAX, 1)


def trim_memory() -> None:
    """Release free memory and library pages; pages that are needed again are read again."""
    if (libc := _glibc()) is None:
        return
    libc.malloc_trim(ctypes.c_size_t(0))
    for start, length in _unchanged_libraries(Path("/proc/self")):
        libc.madvise(ctypes.c_void_p(start), ctypes.c_size_t(length), _DONTNEED)


def forget_transforms() -> None:
    """Let short transforms take the places of those of a record in SciPy's memory."""
    if "scipy.fft" not in sys.modules:
        return
    from numpy import zeros
    from scipy.fft import dct, fft, rfft

    for length in range(_SHORTEST, _SHORTEST + _KEPT_TRANSFORMS):
        for transform in (dct, fft, rfft):
            transform(zeros(length))


def usable_processes() -> int:
    """Return in how many processes a long computation is worth sharing on this machine."""
    if hasattr(os, "sched_getaffinity"):
        return min(len(os.sched_getaffinity(0)), MOST_PROCESSES)
    return min(os.cpu_count() or 1, MOST_PROCESSES)


@contextmanager
def search_process(path: Path) -> Iterator[list[WorkerProcess]]:
    """Give a process that loads what a search of this input takes; none for a short one."""
    if usable_processes() < 2 or not _is_long(path):
        yield []
        return
    with WorkerProcess(SEARCH) as worker:
        yield [worker]


def _is_long(path: Path) -> bool:
    """Return whether it takes a while to read; what is wrong with it says who opens it."""
    try:
        files = list(path.iterdir()) if path.is_dir() else [path]
        return any(file.stat().st_size > LONG for file in files)
    except (OSError, ValueError):
        return False


def _unchanged_libraries(process: Path) -> Iterator[tuple[int, int]]:
    """Yield address and length of all mappings of libraries that were never written to.

    A library that another thread is just loading is mapped as a whole before its data get pages of
    their own. Such a mapping is gone when the interpreter's lock is ours again, so that only what
    two readings show alike is there to stay.
    """
    settled = set((process / "maps").read_text("utf-8", "replace").splitlines())
    found: tuple[int, int] | None = None
    for line in (process / "smaps").read_text("utf-8", "replace").splitlines():
        name, *fields = line.split()
        if not name.endswith(":"):
            start, stop = (int(end, 16) for end in name.split("-"))
            is_library = len(fields) > 4 and ".so" in fields[4] and "w" not in fields[0]
            is_library &= line in settled
            found = (start, stop - start) if is_library else None
        elif name == "Anonymous:" and found is not None and fields[0] == "0":
            yield found


def _glibc() -> ctypes.CDLL | None:
    if not sys.platform.startswith("linux"):
        return None
    libc = ctypes.CDLL(None)
    return libc if hasattr(libc, "mallopt") and hasattr(libc, "malloc_trim") else None
