"""Noise that is not even in time, and what it does to evidence that takes it for even.

A stretch of loud noise (found later, as `variance_change`) makes the level move more there than a
stationary model lets expect, and correlates neighbouring ordinates of the spectrum. Both would pass
for effects, so gains are divided by how far the assumption is off. On even noise both are 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["crowding", "loudness"]

Array = NDArray[np.float64]

_PARTS = 256
_CLEARLY = 1.5
"""Power of a part over that of all which its scatter does not explain."""
_AROUND_S = 30.0
"""A level is compared over so many seconds: noise farther away does not move it."""


def crowding(data: Array) -> float:
    """Return how many neighbouring ordinates say the same because the noise is uneven.

    Noise that is loud in a tenth of the record has a spectrum that is smooth over ten ordinates: a
    run of ten high ones is then no more of a surprise than one.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> loud = np.where(np.arange(100_000) < 10_000, 10.0, 1.0)
    >>> round(crowding(loud * rng.normal(size=100_000)))
    8
    """
    parts = np.array_split(np.diff(data), _PARTS)
    power = np.array([float(np.mean(part**2)) for part in parts])
    mean = float(np.mean(power))
    return max(1.0, float(np.mean(power**2)) / mean**2) if mean > 0 else 1.0


def loudness(data: Array, rate_hz: float, first: int, last: int) -> float:
    """Return the white power around samples `first` to `last` over that of all, 1 at the least.

    Where it is clearly louder before, between or after them, that part decides.
    """
    reach = int(_AROUND_S * rate_hz)
    squares = np.diff(data) ** 2
    everywhere = float(np.mean(squares))
    if everywhere <= 0:
        return 1.0
    before, after = max(0, first - reach), last + reach
    parts = [squares[a:b] for a, b in ((before, first), (first, last), (last, after))]
    loudest = max(float(np.mean(part)) for part in parts if len(part)) / everywhere
    around = float(np.mean(squares[before:after])) / everywhere
    return max(1.0, loudest if loudest > _CLEARLY else around)
