"""What a run that lasts a night asks of the memory of its process.

The C library keeps a heap for every thread, and learns from large blocks that were freed to take
the next ones from there too; after an hour of results, each with copies of some twenty megabytes,
those heaps are mostly holes. Told otherwise, it gives large blocks back at once.

Half of what a process holds when it has begun are pages of libraries, LLVM above all, that are
used to load compiled code and hardly ever again. They are unchanged pages of files, so nothing is
lost when they are let go; the few that are still needed come back by themselves.

Only Linux with its usual C library is told anything; elsewhere nothing happens.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from pathlib import Path

__all__ = ["give_large_blocks_back", "let_go_of_what_rests"]

_MMAP_THRESHOLD, _ARENA_MAX = -3, -8
_LARGE_BYTES = 1 << 18
_HEAPS = 2

_DONTNEED = 4


def give_large_blocks_back() -> None:
    """Keep blocks from 256 KiB on out of the heaps, and share two of them among all threads."""
    if (libc := _glibc()) is not None:
        libc.mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)
        libc.mallopt(_ARENA_MAX, _HEAPS)


def let_go_of_what_rests() -> None:
    """Let go of free memory, and of library pages; those that are needed again are read again."""
    if (libc := _glibc()) is None:
        return
    libc.malloc_trim(ctypes.c_size_t(0))
    for start, length in _unchanged_libraries(Path("/proc/self")):
        libc.madvise(ctypes.c_void_p(start), ctypes.c_size_t(length), _DONTNEED)


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
