"""Flicker noise the way of DT0064: a sum of held values, each renewed half as often as the last."""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from allanscope.compiled import njit

__all__ = ["TrailingZeros"]

ROWS = 48
"""The last row changes every 2^48 samples: never."""


class TrailingZeros:
    """Voss's generator, driven by the number of trailing zeros of a counter.

    With the counter at k, value number ctz(k) is drawn anew and the output is the sum of all
    values: value j lives for 2^(j+1) samples, so the sum holds one octave of 1/f noise for each.
    A value of variance s^2 that is held for P samples has the Allan variance (x = m / P)

        2 x / 3                                    for x < 1/2,
        2 - 2 x / 3 - 1 / x + 1 / (6 x^2)          for 1/2 < x < 1,
        1 / x - 1 / (2 x^2)                        for x > 1,

    times s^2. The integral of that over ln x is 2 ln 2, one octave is ln 2, hence the sum of all
    octaves has AVAR = 2 s^2, and s = B sqrt(ln 2 / pi). Nothing lives shorter than two samples: the
    octaves that are missing above would have added 2 s^2 / m, so AVAR is (1 - 1/m) of the plateau
    (0.500 at m = 1, 0.687 at 2, 0.943 at 16, 0.992 at 128). One random number a sample, and
    cheap; but short by that at small m, and its steps fall on a fixed grid of times. `Flicker` is
    what the simulated device uses.

    Parameters
    ----------
    B : float
        Coefficient in the unit of the axis; the floor of ADEV is 0.664 B.
    rate_hz : float
        Samples per second; flicker noise does not depend on it.
    rng : Generator
        Source of randomness, used by this process alone.

    Notes
    -----
    R. F. Voss's algorithm as told by M. Gardner, Scientific American 238 (April 1978) 16; the order
    of renewal by trailing zeros is that of ST design tip DT0064.
    """

    def __init__(self, B: float, rate_hz: float, rng: Generator) -> None:
        del rate_hz
        self._sigma = B * math.sqrt(math.log(2.0) / math.pi)
        self._rng = rng
        self._rows = rng.standard_normal(ROWS)
        self._counter = 0

    def take(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` samples, shape (n,), in the unit of the axis."""
        samples = self._rng.standard_normal(n)
        _sum_of_held(self._rows, self._counter, samples)
        self._counter += n
        samples *= self._sigma
        return samples


@njit(cache=True, nogil=True)
def _sum_of_held(rows: NDArray[np.float64], counter: int, samples: NDArray[np.float64]) -> None:
    for i in range(samples.shape[0]):
        k = counter + i + 1
        row = 0
        while k & 1 == 0:
            k >>= 1
            row += 1
        rows[row] = samples[i]
        samples[i] = rows.sum()
