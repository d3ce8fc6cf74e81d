"""Holes in a stream whose clock stands still for several samples.

Hundredths of a second at 416 Hz, milliseconds at 6.66 kHz: most stamps repeat the one before, so
there is no period to compare with (`pacing`). Such a clock still goes step by step. When it jumps
over some, samples are missing; how many, nothing tells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

__all__ = ["Standstill"]

_STEPS = 2.5


class Standstill:
    """Follow the stamps of a clock that is coarser than the samples.

    Parameters
    ----------
    farthest_s : float
        A stamp that is farther than this from the one before has jumped.
    """

    def __init__(self, farthest_s: float = math.inf) -> None:
        self._farthest_s = farthest_s
        self._last_s = math.nan

    @classmethod
    def of(cls, times: Sequence[float], resolution_s: float) -> Standstill:
        """Return what follows a stream that begins with these times; deaf unless they stand still.

        >>> clock = Standstill.of([0.0, 0.0, 0.0, 0.01, 0.01, 0.01], 0.01)
        >>> clock.follow(0.01)
        >>> clock.jumped(0.02), clock.jumped(0.5)
        (False, True)
        """
        steps = np.diff(np.asarray(times, np.float64))
        still = len(steps) > 0 and float(np.median(np.abs(steps))) == 0.0
        return cls(_STEPS * resolution_s if still and resolution_s > 0.0 else math.inf)

    def jumped(self, time_s: float) -> bool:
        """Return whether the clock went farther than a step or two since the last stamp."""
        return abs(time_s - self._last_s) > self._farthest_s

    def follow(self, time_s: float) -> None:
        """Take the next stamp."""
        self._last_s = time_s
