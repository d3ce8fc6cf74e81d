"""Is a tone one tone? Level beside a line, and whether it stays the same through the record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma
from scipy.stats import chi2, spearmanr

from allanscope.explain.demodulation import demodulate
from allanscope.explain.series import CHI_SQUARE_MEDIAN
from allanscope.explain.view import View

__all__ = [
    "constancy",
    "evenness",
    "local_level",
    "sweeps",
    "unsteadiness",
]

Array = NDArray[np.float64]

_PARTS = 16
_FEWEST_CYCLES = 8.0
"""Fewer waves cannot show that they are alike: the noise beside them is of another level."""
_IN_ORDER = 0.85
"""Rank correlation of frequency and time: reached by chance once in some 10^4 bands."""
_CELLS = 12
_REACH = 2.5
"""Half of the range around a band that is looked at, in bandwidths."""


def local_level(view: View, frequency: float, ordinates: int = 400) -> float:
    """Variance of an ordinate around a frequency, from the median, which a line does not move."""
    centre = int(frequency * 2 * view.grid.n / view.grid.rate_hz)
    half = min(ordinates, max(8, centre // 3))
    near = view.squares[max(0, centre - half) : centre + half]
    return float(np.median(near)) / CHI_SQUARE_MEDIAN


def constancy(data: Array, rate: float, frequency: float, parts: int = _PARTS) -> float:
    """Probability that the parts of a record would differ so much if the tone were constant.

    The noise of the amplitudes comes from their neighbours in frequency, two resolutions away. A
    line of few cycles is taken to be one.
    """
    cycles = frequency * len(data) / rate
    if cycles < _FEWEST_CYCLES:
        return 1.0
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
    if np.ptp(centres) == 0:
        return False
    return bool(abs(spearmanr(np.arange(_PARTS), centres).statistic) > _IN_ORDER)


def unsteadiness(data: Array, rate: float, frequency: float, bandwidth: float) -> float:
    r"""Return by how many sigma the power in a band moves through the record more than noise does.

    The band and its surroundings are cut into cells of frequency and parts of time. For noise in a
    band, however narrow, the powers :math:`P_t` of a cell are drawn from one gamma distribution of
    d degrees of freedom; whether they are is Bartlett's test,

    .. math:: d \left(T \ln \bar P - \sum_{t=1}^{T} \ln P_t\right),

    summed over the cells. A chirp through a broad band goes through the cells one after the other,
    a modulated tone comes and goes: either is tens of sigma where its band is found at all.
    A narrow chirp has few cells to go through; `sweeps` sees it.

    Parameters
    ----------
    data : ndarray, shape (n,)
        The samples.
    rate : float
        In Hz.
    frequency, bandwidth : float
        Of the band in Hz.
    """
    n = len(data) // _PARTS
    parts = (data[: n * _PARTS] - data.mean()).reshape(_PARTS, n) * np.hanning(n)
    f = np.arange(n // 2 + 1) * rate / n
    inside = np.abs(f - frequency) <= _REACH * bandwidth
    power = np.abs(np.fft.rfft(parts, axis=1)[:, inside]) ** 2
    size = max(4, power.shape[1] // _CELLS)
    excess = variance = 0.0
    for start in range(0, power.shape[1] - size + 1, size):
        cell = power[:, start : start + size]
        mean = cell.mean(axis=0)
        # Two degrees an ordinate if all are alike; half of them, for the window couples neighbours.
        d = max(2.0, float(mean.sum() ** 2 / np.sum(mean**2)))
        total = cell.sum(axis=1)
        bartlett = _PARTS * np.log(total.mean()) - np.sum(np.log(total))
        expected = digamma(_PARTS * d / 2) - digamma(d / 2) - np.log(_PARTS)
        excess += d * float(bartlett - _PARTS * expected)
        spread = _PARTS * polygamma(1, d / 2) - _PARTS**2 * polygamma(1, _PARTS * d / 2)
        variance += d**2 * float(spread)
    return excess / np.sqrt(variance) if variance > 0 else 0.0


def evenness(data: Array, rate: float, frequency: float, bandwidth: float) -> float:
    r"""Return by how many sigma the envelope of a band is more even than that of noise.

    The power :math:`p = |z|^2` of Gaussian noise in a band is exponentially distributed, with
    :math:`\overline{p^2} / \bar p^2 = 2`; that of a tone of constant amplitude whose frequency
    moves has 1. The estimate has the deviation :math:`2 / \sqrt{N}` with the
    :math:`N = \pi w T` independent powers of a band of width w.

    Parameters
    ----------
    data : ndarray, shape (n,)
        The samples.
    rate : float
        In Hz.
    frequency, bandwidth : float
        Of the band in Hz.
    """
    duration = len(data) / rate
    parts = int(min(len(data), max(_PARTS, 4 * bandwidth * duration)))
    power = np.abs(demodulate(data, rate, frequency, parts)) ** 2
    ratio = float(np.mean(power**2) / np.mean(power) ** 2)
    return (2 - ratio) * float(np.sqrt(np.pi * bandwidth * duration)) / 2
