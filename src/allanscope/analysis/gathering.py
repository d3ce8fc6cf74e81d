"""Small blocks joined to large ones: a live port brings three rows at a time, sums like thousands.

Every call into the sums costs some tens of microseconds whatever it brings. What arrives in small
pieces is therefore copied to a fixed room and handed on when that is full; what is large already
passes by untouched. No sum depends on how the samples are cut, so this changes cost, never results.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ROOM", "Gathering"]

ROOM = 1 << 13
"""Rows that a live run gathers: 1.2 s at 6.66 kHz. A refresh takes them out early, from a copy."""

Piece = tuple[NDArray[Any], NDArray[np.float64] | None]


class Gathering:
    """Rows of counts, and the temperature at each of them, on their way to the sums.

    What is yielded is good until the next call.

    Parameters
    ----------
    room : int
        Rows that are gathered.

    Examples
    --------
    >>> gathering = Gathering(room=4)
    >>> three = np.zeros((3, 1), np.int16)
    >>> [len(counts) for counts, _ in gathering.take(three, None)]
    []
    >>> [len(counts) for counts, _ in gathering.take(three, None)], gathering.waiting
    ([3], 3)
    >>> [len(counts) for counts, _ in gathering.rest()], gathering.waiting
    ([3], 0)
    """

    def __init__(self, room: int = ROOM) -> None:
        self.waiting = 0
        self._room = room
        self._counts: NDArray[Any] = np.empty((0, 0), np.int16)
        self._temperature_c = np.empty(0)

    def take(
        self, counts: NDArray[Any], temperature_c: NDArray[np.float64] | None
    ) -> Iterator[Piece]:
        """Take contiguous rows, and yield those that are to be summed up now, in order."""
        rows = len(counts)
        fits = counts.dtype == self._counts.dtype and rows <= len(self._counts) - self.waiting
        if not fits:
            yield from self.rest()
        if rows >= self._room:
            yield counts, temperature_c
            return
        if self.waiting == 0:
            self._make_room(counts)
        new = slice(self.waiting, self.waiting + rows)
        self._counts[new] = counts
        self._temperature_c[new] = np.nan if temperature_c is None else temperature_c
        self.waiting += rows

    def rest(self) -> Iterator[Piece]:
        """Yield what is waiting: a gap follows, or the result is wanted."""
        if self.waiting:
            rows, self.waiting = self.waiting, 0
            yield self._counts[:rows], self._temperature_c[:rows]

    def _make_room(self, like: NDArray[Any]) -> None:
        shape = self._room, like.shape[1]
        if self._counts.shape != shape or self._counts.dtype != like.dtype:
            self._counts = np.empty(shape, like.dtype)
            self._temperature_c = np.empty(self._room)
