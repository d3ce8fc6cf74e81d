"""Is a tone one tone? Level beside a line, and whether it stays the same through the record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, spearmanr

from allanscope.explain.view import View

__all__ = ["constancy", "demodulate", "local_level", "sweeps"]

Array = NDArray[np.float64]

_PARTS = 16
_IN_ORDER = 0.85
"""Rank correlation of frequency and time: reached by chance once in some 10^4 bands."""


def local_level(view: View, frequency: float, ordinates: int = 400) -> float:
    """Variance of an ordinate around a frequency, from the median, which a line does not move."""
    centre = int(frequency * 2 * view.grid.n / view.grid.rate_hz)
    half = min(ordinates, max(8, centre // 3))
    near = view.squares[max(0, centre - half) : centre + half]
    return float(np.median(near)) / 0.4549


def demodulate(data: Array, rate: float, frequency: float, parts: int) -> NDArray[np.complex128]:
    """Complex amplitude of a tone in each of `parts` equal parts of the data."""
    n = len(data) // parts * parts
    t = np.arange(n) / rate
    mixed = (data[:n] - data[:n].mean()) * np.exp(-2j * np.pi * frequency * t)
    return np.asarray(2 * mixed.reshape(parts, -1).mean(axis=1))


def constancy(data: Array, rate: float, frequency: float, parts: int = _PARTS) -> float:
    """Probability that the parts of a record would differ so much if the tone were constant.

    The noise of the amplitudes comes from their neighbours in frequency, two resolutions away.
    """
    cycles = frequency * len(data) / rate
    parts = int(min(parts, max(2, cycles // 4)))
    amplitude = demodulate(data, rate, frequency, parts)
    resolution = rate / (len(data) // parts)
    offsets = [s * k * resolution for k in (2, 3, 4, 5) for s in (-1, 1)]
    offsets = [o for o in offsets if 0 < frequency + o < rate / 2]
    if not offsets:
        return 1.0
    beside = [np.abs(demodulate(data, rate, frequency + o, parts)) ** 2 for o in offsets]
    noise = float(np.median(beside)) / np.log(2)
    distance = 2 * np.sum(np.abs(amplitude - amplitude.mean()) ** 2) / noise
    return float(chi2.sf(distance, 2 * (parts - 1)))


def sweeps(data: Array, rate: float, frequency: float, bandwidth: float) -> bool:
    """Tell whether a band is a tone that moves in one direction: a chirp, not noise in a band.

    The centre of the band's power is followed through the record. For noise, or a line that
    wanders to and fro, it goes up and down; for a chirp it is in the order of time.
    """
    reach = 2.5 * bandwidth
    low, high = max(frequency - reach, 0.0), min(frequency + reach, rate / 2)
    centres = []
    for part in np.array_split(data - data.mean(), _PARTS):
        power = np.abs(np.fft.rfft(part * np.hanning(len(part)))) ** 2
        f = np.arange(len(power)) * rate / len(part)
        inside = (f >= low) & (f <= high)
        if np.count_nonzero(inside) < 4:
            return False
        excess = np.maximum(power[inside] - np.median(power[inside]), 0.0)
        centres.append(float(f[inside][np.argmax(excess)]))
    return bool(abs(spearmanr(np.arange(_PARTS), centres).statistic) > _IN_ORDER)
