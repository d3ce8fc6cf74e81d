"""1/f noise as ST's design tip DT0064 makes it: white generators in octaves, added up.

Generator k draws a new number at every sample whose count has k trailing binary zeros, each 2^(k+1)
samples, and holds it (R. Voss's algorithm, in J. McCartney's order). Held for T samples, noise of
variance s^2 has the density ``s^2 T sinc^2(f T)``; over all octaves of T these add up to

    S(f) = s^2 / (2 ln 2 f),    so that  s^2 = B^2 ln 2 / pi

makes the flicker noise of coefficient B. Octaves show in the density, which waves by 7 % about 1/f,
but not in the Allan variance, which rises smoothly to its floor.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from allanscope.simulator.noise.power_law import LONGEST_S

__all__ = ["OctaveFlicker"]


class OctaveFlicker:
    """The design tip's 1/f generator as a stream.

    S(f) = B^2 / (2 pi f) for f << 1/t0 (two-sided), within 7 %. The Allan variance at m = 1, 8, 32
    and 128 is 0.54, 0.90, 0.97 and 0.99 of (2 ln 2 / pi) B^2: the fastest numbers are held for two
    samples. `Flicker` is exact; this one is what the design tip's curves are of.

    Parameters
    ----------
    B : float
        Coefficient in the unit of the axis; the floor of ADEV is 0.664 B.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.

    Notes
    -----
    The listing adds ``rand(1)*sd`` to each sample, for the highest octave. Its mean of sd / 2 is
    left out here: an offset is no noise.
    """

    def __init__(self, B: float, rate_hz: float, rng: Generator) -> None:
        self.sigma = B * math.sqrt(math.log(2.0) / math.pi)
        self._normal, (self._uniform,) = rng, rng.spawn(1)
        octaves = math.ceil(math.log2(LONGEST_S * rate_hz))
        self._held = self.sigma * rng.standard_normal(octaves)
        self._sum = float(self._held.sum())
        self._count = 0

    def take(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` samples, shape (n,), in the unit of the axis."""
        drawn = self.sigma * self._normal.standard_normal(n)
        first = self._count + 1
        change = drawn.copy()
        for k in range(len(self._held)):
            # The last generator takes all counts with as many zeros or more.
            period = 1 << (k + 1 if k + 1 < len(self._held) else k)
            at = slice((((1 << k) - first) % period), n, period)
            new = drawn[at]
            if new.size:
                change[at] -= np.append(self._held[k], new[:-1])
                self._held[k] = new[-1]
        self._count += n
        if n:
            change[0] += self._sum
            np.cumsum(change, out=change)
            self._sum = float(change[-1])
        high: NDArray[np.float64] = self._uniform.uniform(-0.5, 0.5, n)
        return change + self.sigma * high
