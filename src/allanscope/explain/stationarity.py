r"""Whether a tone or a process of the spectrum is there all along, as its name says.

The spectrum of a record tells how much power is at a frequency, not when: a tone that sweeps
through 0 Hz has the spectrum of Gauss-Markov noise, a chirp that of noise behind a band-pass. Only
a stationary process has it all the time. The frequencies where it counts are cut into cells and
the record into parts. For a stationary process the powers :math:`P_t` of a cell are draws from one
gamma distribution of d degrees of freedom; whether they are is Bartlett's test,

.. math:: d \left(T \ln \bar P - \sum_{t=1}^{T} \ln P_t\right),

summed over the cells, in standard deviations. A part may be loud as a whole (`variance_change`):
the noise beside the process is scaled by the power of its part at all other frequencies first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.special import chdtrc, digamma, polygamma

from allanscope.compiled import Pointer, kernel
from allanscope.explain.candidate import Candidate
from allanscope.explain.view import View
from allanscope.noise.components import Component, Floor, White
from allanscope.noise.filters import made_white_share

__all__ = [
    "UNSTEADY",
    "PowerInParts",
    "bartlett_z",
    "bartlett_z_of",
    "constancy",
    "demodulate",
    "envelope_z",
    "reach_in",
    "reach_of",
    "sweeps",
]

Array = NDArray[np.float64]

UNSTEADY = 2.2
"""Sigma; of 220 true processes of all widths and sizes one came beyond."""
_LADDER = (4, 8, 16, 32)
"""Parts of time into which a record is cut to see a process come and go."""
_FIRST, _FEWEST, _CELLS = 1, 2, 12
"""First ordinate of a part, ordinates of a cell and most cells."""
_LEAST_BESIDE, _LEAST_OF_FILTER = 100, 48
"""Ordinates of a part that tell how loud it is: beside a process, and all of those of a filter."""
_MARGIN, _ROUNDING = 3, 0.1
"""Ordinates beside a range that was cut out into which its edge leaks; and the share of the power
that rounding may have where a process is looked at."""
_BURSTS = 0.5
"""Share of the power that comes in bursts from which a frequency is theirs."""
_DRIFT = 0.05
"""Share of the band below which a filter does nothing."""
_COUPLED = (1.0, 2 * 4 / 9, 2 / 36)
"""Squared correlation of the ordinates of Hann's window with the next ones, on both sides."""
_ALIKE = 8.0
"""Variance of the powers of the parts, over what chance makes of one ordinate, that is nothing."""
_BAND = 0.05
"""Share of the power from which noise in a band counts."""
_COUNTS = 0.25
"""Process over the noise beside it from which a frequency counts, if it comes so far."""

_PARTS = 16
"""Parts of the time in which a line or band must be the same."""
_FEWEST_CYCLES = 8.0
"""Fewer waves cannot show that they are alike: the noise beside them is of another level."""
_IN_ORDER = 0.85
"""Rank correlation of frequency and time: reached by chance once in some 10^4 bands."""
_REACH = 2.5
"""Half of the range around a band that is looked at, in bandwidths."""
_SUMS, _LONG = range(128, 192), 4096
"""Short sums in a part, of which the number that fits best is taken, and rows in a part from which
they are used: five resolutions away they are low by a half per cent."""
_TURNS = 1024
"""Samples after which the wave is computed afresh: rounding does not build up."""


@dataclass(frozen=True, eq=False)
class PowerInParts:
    """Periodograms of equal parts of a record, by Hann's window.

    Attributes
    ----------
    power : ndarray, shape (parts, m)
        The mean square at every frequency, as of ordinates.
    frequency : ndarray, shape (m,)
        In Hz.
    """

    power: Array
    frequency: Array

    @classmethod
    def of(cls, data: Array, rate: float, parts: int = _PARTS) -> PowerInParts:
        """Cut samples at a rate in Hz into parts."""
        n = len(data) // parts
        window = np.hanning(n)
        rows = (data[: n * parts] - data.mean()).reshape(parts, n)
        power = np.abs(np.fft.rfft(rows * window, axis=1)) ** 2 / np.sum(window**2)
        return cls(power, np.arange(power.shape[1]) * rate / n)

    @classmethod
    def of_view(cls, view: View, parts: int = _PARTS) -> PowerInParts:
        """Return those of the data of a view, whatever its model is."""
        known = view.of_data.setdefault(cls, {})
        if parts not in known:
            known[parts] = cls.of(view.data, view.grid.rate_hz, parts)
        return cast("PowerInParts", known[parts])


def reach_of(view: View, candidate: Candidate, least: float = _COUNTS) -> tuple[float, float]:
    """Return the lowest and the highest frequency where a process counts in the spectrum.

    A filter counts everywhere but where the level drifts.
    """
    return reach_in(view.with_parts(*candidate.parts), candidate, least)


def bartlett_z_of(view: View, candidate: Candidate) -> float:
    """Return by how many sigma a process comes and goes more than a stationary one does."""
    after = view.with_parts(*candidate.parts)  # the noise is fitted once
    low, high = reach_in(after, candidate)
    return max(_unsteadiness(view, after, candidate, low, high, parts) for parts in _LADDER)


def reach_in(after: View, candidate: Candidate, least: float = _COUNTS) -> tuple[float, float]:
    """Return the same by the view that has the process already: its noise is fitted once."""
    f = after.grid.centre
    if not _adding(candidate):
        return _DRIFT * after.grid.rate_hz / 2, after.grid.rate_hz / 2
    process, rest = _shares(after, candidate, f)
    ratio = process / rest
    counts = np.flatnonzero(ratio >= min(least, 0.2 * float(ratio.max())))
    return float(f[counts[0]]), float(f[counts[-1]])


def _shares(after: View, candidate: Candidate, f: Array) -> tuple[Array, Array]:
    """Return the variance of the process and of the noise beside it at some frequencies."""
    components, added = after.spectrum.model.components, len(_adding(candidate))
    own = components[-added:] if added else ()
    process, whole = after.spectrum.split((own, components), f)
    return process, np.maximum(whole - process, 1e-300)


def _adding(candidate: Candidate) -> list[Component]:
    """Return the processes that a candidate adds; the floor behind a filter belongs to that."""
    added = [part for part in candidate.parts if isinstance(part, Component)]
    return [part for part in added if not isinstance(part, Floor)]


def _open(view: View, f: Array) -> NDArray[np.bool_]:
    """Tell which frequencies are not within or next to what was cut out of the fit."""
    kept = np.ones(len(f), bool)
    for low, high in view.excluded:
        kept &= (f < low) | (f > high)
    return np.asarray(minimum_filter1d(kept, 2 * _MARGIN + 1))


def _in_bursts(after: View, f: Array) -> NDArray[np.bool_]:
    """Tell where most of the noise is what rows that are held make of it, which comes in bursts."""
    model = after.model
    filters = model.filters_on(White(1.0))
    share = made_white_share(filters, model.dt, lambda one: one.response(f, model.dt))
    return np.broadcast_to(share > _BURSTS, f.shape)


def _in_bands(after: View, f: Array) -> NDArray[np.bool_]:
    """Tell where there is noise in bands: if it comes and goes, that says nothing of a filter."""
    spectrum = after.spectrum
    narrow = [one for one in spectrum.model if one.is_narrow]
    return spectrum.of(narrow, f) > _BAND * spectrum.at(f)


def _unsteadiness(
    view: View, after: View, candidate: Candidate, low: float, high: float, parts: int
) -> float:
    known = PowerInParts.of_view(view, parts)
    power, f = known.power, known.frequency
    process, rest = (np.append(1.0, share) for share in _shares(after, candidate, f[1:]))
    # Rounding is as loud in every part, and behind a filter it may be all there is at the top.
    kept = _open(view, f) & (view.fitted_floor < _ROUNDING * (process + rest))
    kept[1:] &= ~_in_bursts(after, f[1:])
    kept[:_FIRST] = False
    inside = (f >= low) & (f <= high) & kept
    is_filter = not _adding(candidate)
    if is_filter:
        inside[1:] &= ~_in_bands(after, f[1:])
    if np.count_nonzero(inside) < 2 * _FEWEST:
        return 0.0
    beside = ~inside & (f > high) if np.count_nonzero(f > high) > len(f) // 4 else ~inside
    beside &= kept
    if is_filter:
        beside = inside
    loud = np.ones(parts)
    if np.count_nonzero(beside) > (_LEAST_OF_FILTER if is_filter else _LEAST_BESIDE):
        loud = np.mean(power[:, beside] / rest[beside], axis=1)
        loud /= loud.mean()
        if beside is not inside and float(np.var(loud)) * np.count_nonzero(beside) < _ALIKE:
            loud[:] = 1.0
    expected = process + loud[:, np.newaxis] * rest
    u = power[:, inside] / expected[:, inside]
    cells = np.array_split(u, min(_CELLS, u.shape[1] // _FEWEST), axis=1)
    return _bartlett_z((cell, _freedom(cell.mean(axis=0))) for cell in cells)


def _freedom(weight: Array) -> float:
    """Return the degrees of freedom of a sum of ordinates of these mean powers."""
    pairs = sum(
        share * float(weight[: len(weight) - lag] @ weight[lag:])
        for lag, share in enumerate(_COUPLED)
    )
    return 2 * float(weight.sum()) ** 2 / pairs


def _bartlett_z(cells: Iterable[tuple[Array, float]]) -> float:
    """Return by how many sigma the powers of cells differ from part to part more than chance does.

    A cell has shape (parts, ordinates) and a number of degrees of freedom.
    """
    excess = variance = 0.0
    for cell, d in cells:
        parts, total = len(cell), cell.mean(axis=1)
        bartlett = parts * np.log(total.mean()) - np.sum(np.log(total))
        usual = digamma(parts * d / 2) - digamma(d / 2) - np.log(parts)
        excess += d * float(bartlett - parts * usual)
        spread = parts * polygamma(1, d / 2) - parts**2 * polygamma(1, parts * d / 2)
        variance += d**2 * float(spread)
    return float(excess / np.sqrt(variance)) if variance > 0 else 0.0


def constancy(data: Array, rate: float, frequency: float) -> float:
    """Probability that the parts of a record would differ so much if the tone were constant.

    The noise of the amplitudes comes from their neighbours in frequency, two resolutions away. A
    line of few cycles is taken to be one.
    """
    cycles = frequency * len(data) / rate
    if cycles < _FEWEST_CYCLES:
        return 1.0
    parts = int(min(_PARTS, max(2, cycles // 4)))
    resolution = rate / (len(data) // parts)
    near = _near(data, rate, frequency, parts)
    amplitude = near(0.0)
    offsets = [s * k * resolution for k in (2, 3, 4, 5) for s in (-1, 1)]
    offsets = [o for o in offsets if 0 < frequency + o < rate / 2]
    if not offsets:
        return 1.0
    beside = [np.abs(near(offset)) ** 2 for offset in offsets]
    noise = float(np.median(beside)) / np.log(2)
    distance = 2 * np.sum(np.abs(amplitude - amplitude.mean()) ** 2) / noise
    return float(chdtrc(2 * (parts - 1), distance))


def _near(
    data: Array, rate: float, frequency: float, parts: int
) -> Callable[[float], NDArray[np.complex128]]:
    """Return what gives the amplitudes in each part at some distance from a frequency in Hz.

    Of a long record the rows are gone through once: within a few resolutions of the frequency short
    sums are as good.
    """
    part = len(data) // parts
    if part < _LONG:
        return lambda offset: demodulate(data, rate, frequency + offset, parts)
    count = min(_SUMS, key=lambda k: part % k)
    sums = demodulate(data, rate, frequency, parts * count)
    at = np.arange(parts * count) * (len(data) // (parts * count)) / rate

    def amplitudes(offset: float) -> NDArray[np.complex128]:
        turned = sums * np.exp(-2j * np.pi * offset * at)
        return np.asarray(turned.reshape(parts, count).mean(axis=1))

    return amplitudes


def sweeps(record: PowerInParts, frequency: float, bandwidth: float) -> bool:
    """Return whether a band is a tone that moves in one direction: a chirp, not noise in a band.

    The centre of the band's power is followed through the record. For noise, or a line that
    wanders to and fro, it goes up and down; for a chirp it is in the order of time.
    """
    inside = np.abs(record.frequency - frequency) <= _REACH * bandwidth
    if np.count_nonzero(inside) < 4:
        return False
    power = record.power[:, inside]
    excess = power - np.median(power, axis=1, keepdims=True)
    centres = record.frequency[inside][np.argmax(excess, axis=1)].tolist()
    if np.ptp(centres) == 0:
        return False
    return bool(abs(_rank_correlation(centres)) > _IN_ORDER)


def _rank_correlation(values: list[float]) -> float:
    """Return Spearman's correlation of values with their order; ties share a rank."""
    _, at, count = np.unique(values, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(count) - (count - 1) / 2)[at]
    return float(np.corrcoef(np.arange(len(values)), ranks)[0, 1])


def bartlett_z(record: PowerInParts, frequency: float, bandwidth: float) -> float:
    r"""Return by how many sigma the power in a band moves through the record more than noise does.

    The band and its surroundings are cut into cells of frequency and parts of time. A chirp through
    a broad band goes through the cells one after the other, a modulated tone comes and goes: either
    is tens of sigma where its band is found at all. A narrow chirp has few cells to go through;
    `sweeps` sees it.

    Parameters
    ----------
    record : PowerInParts
        The samples.
    frequency, bandwidth : float
        Of the band in Hz.
    """
    power = record.power[:, np.abs(record.frequency - frequency) <= _REACH * bandwidth]
    size = max(4, power.shape[1] // _CELLS)
    starts = range(0, power.shape[1] - size + 1, size)
    cells = (power[:, start : start + size] for start in starts)
    # Two degrees an ordinate if all are alike; half of them, for the window couples neighbours.
    return _bartlett_z(
        (cell, max(2.0, float(np.sum(mean := cell.mean(axis=0)) ** 2 / np.sum(mean**2))))
        for cell in cells
    )


def envelope_z(data: Array, rate: float, frequency: float, bandwidth: float) -> float:
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
    sums = np.empty(parts, np.complex128)
    _demodulate(used, parts, size, float(used.mean()), 2 * np.pi * frequency / rate, sums)
    return np.asarray(2 * sums / size)


_demodulate = kernel(
    "demodulate",
    *(Pointer(np.float64, 1), int, int, float, float),
    Pointer(np.complex128, 1, written=True),
)
"""Sum data less a mean, times the conjugate wave, over each of some parts of equal size."""
