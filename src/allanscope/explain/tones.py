"""Is a tone one tone? Level beside a line, and whether it stays the same through the record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from allanscope.explain.view import View

__all__ = ["constancy", "demodulate", "envelope_kurtosis", "local_level"]

Array = NDArray[np.float64]

_PARTS = 16


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


def envelope_kurtosis(
    data: Array, rate: float, frequency: float, bandwidth: float
) -> tuple[float, float]:
    """Return E|a|^4 / (E|a|^2)^2 of the band's complex envelope, and its standard error.

    2 for Gaussian noise in a band, 1 for a tone that only wanders in frequency. The noise outside
    the band is taken off both moments.
    """
    seconds = 0.3 / bandwidth
    parts = int(len(data) / rate / seconds)
    if parts < 16:
        return 2.0, np.inf
    amplitude = np.abs(demodulate(data, rate, frequency, parts)) ** 2
    offset = 6 * max(bandwidth, 1 / seconds)
    beside = [
        float(np.mean(np.abs(demodulate(data, rate, f, parts)) ** 2))
        for f in (frequency - offset, frequency + offset)
        if 0 < f < rate / 2
    ]
    noise = float(np.mean(beside)) if beside else 0.0
    signal = float(amplitude.mean()) - noise
    if signal <= 0.05 * noise:
        return 2.0, np.inf
    fourth = float(np.mean(amplitude**2)) - 4 * signal * noise - 2 * noise**2
    error = float(np.std(amplitude**2)) / np.sqrt(parts / 2)
    return fourth / signal**2, error / signal**2
