"""How rows come to the sums fast: many at a time, on two cores, compared at the speed of memory.

Every call into the sums costs some tens of microseconds whatever it brings, and a live port brings
three rows at a time. What arrives in small pieces is therefore copied to a buffer and handed on
when that is full; what is large already passes by untouched. The sums of a stream do not depend on
each other, and nearly all of their time is spent in compiled code that releases the interpreter's
lock: those that take longest run in a thread of their own, one piece behind (`BackgroundTask`):
neither waits for the other as long as there is work. None of this changes a result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BUFFERED", "WORTH_IT", "BackgroundTask", "RowBuffer", "lowest_and_highest"]

BUFFERED = 1 << 13
"""Rows that a live run buffers: 1.2 s at 6.66 kHz. A refresh takes them out early, from a copy."""

WORTH_IT = 1 << 15
"""Rows from which on a second thread pays: some milliseconds of work."""

FOLD = 64
"""Rows that are laid side by side: numpy compares long rows with vector registers, short ones not.
Six columns of int16 then take 0.1 ns a sample instead of 5."""

Piece = tuple[NDArray[Any], NDArray[np.float64] | None]


class RowBuffer:
    """Rows of counts, and the temperature at each of them, on their way to the sums.

    What is yielded is good until the next call; counts that are enough for another thread for ever.

    Parameters
    ----------
    size : int
        Rows that are buffered.

    Examples
    --------
    >>> buffer = RowBuffer(size=4)
    >>> three = np.zeros((3, 1), np.int16)
    >>> [len(counts) for counts, _ in buffer.feed(three, None)]
    []
    >>> [len(counts) for counts, _ in buffer.feed(three, None)], buffer.waiting
    ([3], 3)
    >>> [len(counts) for counts, _ in buffer.flush()], buffer.waiting
    ([3], 0)
    """

    def __init__(self, size: int = BUFFERED) -> None:
        self.waiting = 0
        self._size = size
        self._counts: NDArray[Any] = np.empty((0, 0), np.int16)
        self._temperature_c = np.empty(0)

    def feed(
        self, counts: NDArray[Any], temperature_c: NDArray[np.float64] | None
    ) -> Iterator[Piece]:
        """Take contiguous rows, and yield those that are to be summed up now, in order."""
        rows = len(counts)
        fits = counts.dtype == self._counts.dtype and rows <= len(self._counts) - self.waiting
        if not fits:
            yield from self.flush()
        if rows >= min(self._size, WORTH_IT):
            yield from self.flush()
            yield counts, temperature_c
            return
        if self.waiting == 0:
            self._allocate(counts)
        new = slice(self.waiting, self.waiting + rows)
        self._counts[new] = counts
        self._temperature_c[new] = np.nan if temperature_c is None else temperature_c
        self.waiting += rows

    def flush(self) -> Iterator[Piece]:
        """Yield what is waiting: a gap follows, or the result is wanted."""
        if self.waiting:
            rows, self.waiting = self.waiting, 0
            counts = self._counts[:rows]
            if rows >= WORTH_IT:
                self._counts = np.empty((0, 0), counts.dtype)
            yield counts, self._temperature_c[:rows]

    def _allocate(self, like: NDArray[Any]) -> None:
        shape = self._size, like.shape[1]
        if self._counts.shape != shape or self._counts.dtype != like.dtype:
            self._counts = np.empty(shape, like.dtype)
            self._temperature_c = np.empty(self._size)


class BackgroundTask:
    """Work that lags behind its owner by one piece, in another thread where that pays.

    Pieces are done in order. An error in one is raised where the next is handed in, or at `wait`.

    Examples
    --------
    >>> task, done = BackgroundTask(), []
    >>> task.do(WORTH_IT, lambda: done.append("one"))
    >>> task.do(3, lambda: done.append("two"))
    >>> task.wait()
    >>> done
    ['one', 'two']
    """

    def __init__(self) -> None:
        self._running: Future[None] | None = None

    def do(self, rows: int, work: Callable[[], None]) -> None:
        """Do what concerns so many rows, which stay as they are, once the last piece is done."""
        self.wait()
        if rows < WORTH_IT:
            work()
        else:
            self._running = _threads().submit(work)

    def wait(self) -> None:
        """Wait until all is done."""
        running, self._running = self._running, None
        if running is not None:
            running.result()


@cache
def _threads() -> ThreadPoolExecutor:
    """Return the threads of this process, which wait for work and for nothing else."""
    return ThreadPoolExecutor(thread_name_prefix="sums")


def lowest_and_highest(rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the minima and the maxima of the columns of an array of shape (n, k), n > 0.

    Examples
    --------
    >>> low, high = lowest_and_highest(np.array([[1, -5], [3, 2]]))
    >>> low.tolist(), high.tolist()
    ([1, -5], [3, 2])
    """
    whole = len(rows) // FOLD * FOLD
    if whole < 2 * FOLD or not rows.flags.c_contiguous:
        return rows.min(axis=0), rows.max(axis=0)
    columns = rows.shape[1]
    wide = rows[:whole].reshape(-1, FOLD * columns)
    low = np.vstack([wide.min(axis=0).reshape(FOLD, columns), rows[whole:]])
    high = np.vstack([wide.max(axis=0).reshape(FOLD, columns), rows[whole:]])
    return low.min(axis=0), high.max(axis=0)
