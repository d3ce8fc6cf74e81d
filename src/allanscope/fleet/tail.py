"""What a survey keeps of the samples in place of sums: the last ones, and how long segments are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.shard import ALIGNED, BLOCK

__all__ = ["Nothing", "Tail"]


class Tail:
    """The end of the open segment; takes samples and gaps as a bank does.

    Parameters
    ----------
    axes : int
        Number of columns.

    Attributes
    ----------
    anchor : ndarray, shape (axes,), or None
        First sample of the run.
    taken : int
        Samples of the open segment.
    """

    def __init__(self, axes: int) -> None:
        self.anchor: NDArray[np.float64] | None = None
        self.taken = 0
        self._rows = 0
        self._held = np.empty((0, axes))
        self._waiting: list[NDArray[Any]] = []

    def update(self, counts: NDArray[Any]) -> None:
        """Take in the next samples."""
        if not len(counts):
            return
        if self.anchor is None:
            self.anchor = counts[0].astype(np.float64)
        self.taken += len(counts)
        self._waiting.append(counts.copy())  # the room it came in is used again
        if sum(map(len, self._waiting)) > ALIGNED:
            self._held = self.recent()
            self._waiting = []

    def gap(self) -> None:
        """End the segment."""
        self._rows += self.taken // (BLOCK // 2)
        self.taken = 0
        self._held = self._held[:0]
        self._waiting = []

    def recent(self) -> NDArray[Any]:
        """Return the last samples, from `ALIGNED` before the last multiple of it on."""
        wanted = min(self.taken, self.taken % ALIGNED + ALIGNED)
        # An empty array of floats must not turn counts into floats.
        parts = [part for part in (self._held, *self._waiting) if len(part)]
        joined = np.concatenate(parts) if parts else self._held
        return joined[len(joined) - wanted :].copy()

    def rows_of_half_a_stretch(self) -> int:
        """Return how many rows the archive of one pass would have at half the stride of ours."""
        return self._rows + self.taken // (BLOCK // 2)


class Nothing:
    """Takes samples and gaps, and keeps nothing."""

    def update(self, counts: NDArray[Any]) -> None:
        """Take in nothing."""

    def gap(self) -> None:
        """End nothing."""
