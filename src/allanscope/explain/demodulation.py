"""The complex amplitude of a tone in parts of a record: one pass, and no table of waves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import njit

__all__ = ["demodulate"]

Array = NDArray[np.float64]

_TURNS = 1024
"""Samples after which the wave is computed afresh: rounding does not build up."""


def demodulate(data: Array, rate: float, frequency: float, parts: int) -> NDArray[np.complex128]:
    """Complex amplitude of a tone in each of `parts` equal parts of the data.

    Examples
    --------
    >>> t = np.arange(4000) / 100
    >>> amplitude = demodulate(3 * np.cos(2 * np.pi * 5 * t + 0.5), 100.0, 5.0, 4)
    >>> np.abs(amplitude).round(6).tolist(), np.angle(amplitude).round(6).tolist()
    ([3.0, 3.0, 3.0, 3.0], [0.5, 0.5, 0.5, 0.5])
    """
    size = len(data) // parts
    used = np.ascontiguousarray(data[: size * parts])
    sums = _demodulated(used, float(used.mean()), 2 * np.pi * frequency / rate, size)
    return np.asarray(2 * sums / size)


@njit(cache=True, nogil=True)
def _demodulated(data, mean, angle, size):  # type: ignore[no-untyped-def]
    sums = np.zeros(data.size // size, np.complex128)
    turn = np.exp(-1j * angle)
    for part in range(sums.size):
        for first in range(part * size, (part + 1) * size, _TURNS):
            wave = np.exp(-1j * (angle * first))
            for k in range(first, min(first + _TURNS, (part + 1) * size)):
                sums[part] += (data[k] - mean) * wave
                wave *= turn
    return sums
