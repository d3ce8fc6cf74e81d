"""When faults happen: at random with a mean rate, or once."""

from __future__ import annotations

import math

from numpy.random import Generator

__all__ = ["Occurrences"]


class Occurrences:
    """A Poisson process along any coordinate (bytes, seconds), plus one fixed point.

    Parameters
    ----------
    rate : float
        Mean number per unit of the coordinate; 0 for none.
    rng : Generator
        Draws the distances.
    at : float, optional
        A point at which one more happens.

    Examples
    --------
    >>> import numpy as np
    >>> once = Occurrences(0.0, np.random.default_rng(1), at=5.0)
    >>> once.next, once.until(4.9), once.until(5.0), once.until(9.0)
    (5.0, 0, 1, 0)
    """

    def __init__(self, rate: float, rng: Generator, at: float | None = None) -> None:
        self._rate = rate
        self._rng = rng
        self._at = math.inf if at is None else at
        self._random = self._distance()

    @property
    def next(self) -> float:
        """Where the next one is; infinity for never."""
        return min(self._at, self._random)

    def until(self, coordinate: float) -> int:
        """Return how many happen up to a coordinate that has not been asked for before."""
        count = 0
        while self.next <= coordinate:
            count += 1
            if self._at <= self._random:
                self._at = math.inf
            else:
                self._random += self._distance()
        return count

    def _distance(self) -> float:
        return float(self._rng.exponential(1.0 / self._rate)) if self._rate else math.inf
