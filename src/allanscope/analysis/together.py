r"""Boards that were recorded together on one bench: what moves the bench, and the noise of each.

The records are brought to one clock: each by its measured rate, and to each other by the motion
that they share. Then everything that all boards see at once cancels in differences, and the
covariance of two differences that share one board is the Allan variance of that board alone

.. math:: \sigma_i^2 = \mathrm{cov}(x_i - x_j,\; x_i - x_k)

(Groslambert, Fest, Olivier and Gagnepain 1981). Two boards have one difference, which holds the
noise of both: then only what they share is told from what they do not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import ndtri

from allanscope.allan import deviation
from allanscope.analysis.result import Analysis
from allanscope.quantities import MAD_TO_SIGMA

__all__ = [
    "AlignedRecords",
    "IndividualNoise",
    "Separation",
    "aligned",
    "separate_units",
    "separated",
]

Array = NDArray[np.float64]

_ROWS = 4
"""Rows of the slowest record in a step of the common clock."""
_SURE = 8.0
"""Standard deviations of a correlation by which records are known to share a motion."""
_LEAST_OVERLAP = 0.2
_WINDOWS = 8
_PASSES = 4
_SHORTEST = 64
_SMOOTHED = 9
_LEAST_EDF = 5.0
_FIRST_OCTAVE = 2
_SURE_OF_GAIN = 3.0
_FEWEST_STEPS = 64


@dataclass(frozen=True, slots=True)
class AlignedRecords:
    """Records on one clock.

    Attributes
    ----------
    values : ndarray, shape (boards, n, axes)
        Means over the steps of that clock.
    rate_hz : float
        Steps in a second.
    lag_s : tuple of float
        By how much each record starts after the first; 0 of one that shares no motion with it.
    drift_ppm : tuple of float
        Correction of the measured rate of each.
    is_common : bool
        Whether all share a motion, without which they cannot be aligned in time.
    """

    values: Array
    rate_hz: float
    lag_s: tuple[float, ...]
    drift_ppm: tuple[float, ...]
    is_common: bool


@dataclass(frozen=True, slots=True)
class IndividualNoise:
    """The Allan deviation of one board without what all boards share.

    Attributes
    ----------
    deviation, lower, upper : ndarray, shape (k,)
        With 95 % limits; `lower` is 0 where none is sure, and the deviation NaN where the noise of
        the others hides it.
    measured : ndarray, shape (k,)
        With what all share.
    gain : float
        By which the board sees what all share, relative to the mean of the boards.
    """

    deviation: Array
    lower: Array
    upper: Array
    measured: Array
    gain: float


@dataclass(frozen=True, slots=True)
class Separation:
    """One axis of boards that were recorded together.

    Attributes
    ----------
    tau : ndarray, shape (k,)
        Averaging times in s.
    common : ndarray, shape (k,)
        Allan deviation of what all share; NaN where it is lost in the noise.
    own : tuple of IndividualNoise
        Of each board; of two boards the same mean of both.
    """

    tau: Array
    common: Array
    own: tuple[IndividualNoise, ...]

    @property
    def is_individual(self) -> bool:
        """Whether each board has a curve of its own: that takes three."""
        return len(self.own) > 2


def separate_units(
    results: Sequence[Analysis], names: Sequence[str]
) -> tuple[AlignedRecords | None, dict[str, Separation], list[str]]:
    """Return results of one bench on one clock, each axis separated, and what must be said of it.

    Parameters
    ----------
    results : sequence of Analysis
        Of two units or more, each with its record.
    names : sequence of str
        Of the units, for what must be said.

    Returns
    -------
    clock : AlignedRecords or None
        None where they have no axis in common.
    axes : dict of str to Separation
        Empty if they cannot be aligned in time.
    remarks : list of str

    Raises
    ------
    ValueError
        For a result without samples in one piece, and for copies of one record.
    """
    shared = [a for a in results[0].axes if all(a in one.axes for one in results)]
    if not shared:
        return None, {}, ["the recordings have no axis in common"]
    records, rates = [], []
    for one in results:
        record = one.record
        if record is None or not len(record.segments):
            raise ValueError("a recording has no samples in one piece")
        first, last = max(record.segments.tolist(), key=lambda s: s[1] - s[0])
        columns = [record.axes.index(axis) for axis in shared]
        records.append(record.values[first:last, columns])
        rates.append(record.rate_hz)
    for (i, one_record), (j, other) in combinations(enumerate(records), 2):
        if np.array_equal(one_record, other):
            raise ValueError(
                f"{names[i]} and {names[j]} hold the same samples: two boards never do"
            )
    clock = aligned(records, rates)
    if not clock.is_common:
        why = "the recordings have no common signal to align them in time"
        return clock, {}, [f"{why}; no common motion was separated"]
    if clock.values.shape[1] < _FEWEST_STEPS:
        return clock, {}, ["the recordings overlap for too short a time"]
    axes = {
        axis: separated(clock.values[:, :, k], clock.rate_hz)
        for k, axis in enumerate(shared)
        if all(np.ptp(clock.values[:, :, k], axis=1) > 0)
    }
    two = ["two recordings: the individual noise is the mean of both"]
    return clock, axes, two if len(results) == 2 else []


def aligned(records: Sequence[Array], rates_hz: Sequence[float]) -> AlignedRecords:
    """Return records on one clock, as long as all of them last.

    Parameters
    ----------
    records : sequence of ndarray, shape (n, axes)
        The same axes of each board, without gaps.
    rates_hz : sequence of float
        Measured true rates.

    Notes
    -----
    The integral of each is interpolated at the steps of the common clock: its differences are means
    over these steps. Of white noise 1 / (3 m) of the variance is lost in a mean of m rows, because
    two steps share a row.
    """
    step_s = _ROWS / min(rates_hz)
    first, *others = records
    base = _means(first, rates_hz[0], 0.0, 1.0, step_s)
    lags, drifts, sure = [0.0], [0.0], True
    for record, rate in zip(others, rates_hz[1:], strict=True):
        found = _lag(base, _means(record, rate, 0.0, 1.0, step_s))
        lag, stretch = (found or 0) * step_s, 1.0
        sure = sure and found is not None
        for _ in range(_PASSES if found is not None else 0):
            at, late = _late(base, _means(record, rate, lag, stretch, step_s), step_s)
            if len(at) < 3:
                break
            slope, offset = np.polyfit(at, late, 1)
            lag, stretch = lag + float(offset), stretch * (1.0 + float(slope))
        lags.append(lag)
        drifts.append(1e6 * (stretch - 1.0))
    parts = [
        _means(record, rate, lag, 1.0 + 1e-6 * drift, step_s)
        for record, rate, lag, drift in zip(records, rates_hz, lags, drifts, strict=True)
    ]
    n = min(len(part) for part in parts)
    values = np.stack([part[:n] for part in parts])
    whole = np.isfinite(values).all(axis=(0, 2))
    inside = np.flatnonzero(whole)
    values = values[:, inside[0] : inside[-1] + 1] if len(inside) else values[:, :0]
    # Where another record begins is where it says that the first has reached so far.
    return AlignedRecords(values, 1 / step_s, tuple(0.0 - one for one in lags), tuple(drifts), sure)


def _means(record: Array, rate_hz: float, lag_s: float, stretch: float, step_s: float) -> Array:
    """Return means over steps of the common clock, which shows 0 at `lag_s` of the record."""
    n = len(record)
    integral = np.vstack([np.zeros(record.shape[1]), np.cumsum(record, axis=0)]) / rate_hz
    ends = np.arange(int(n / rate_hz / step_s) + 1) * step_s
    place = (lag_s + ends * stretch) * rate_hz
    phase = CubicSpline(np.arange(n + 1), integral)(np.clip(place, 0, n))
    means = np.diff(phase, axis=0) / (step_s * stretch)
    inside = (place[:-1] >= 0) & (place[1:] <= n)
    means[~inside] = np.nan
    return means


def _lag(first: Array, second: Array) -> int | None:
    """Return by how many steps the second shows it later; None where they share nothing."""
    size = 1 << (len(first) + len(second) - 1).bit_length()
    total = np.zeros(size)
    for a, b in zip(_steps(first).T, _steps(second).T, strict=True):
        x, y = np.fft.rfft(a, size), np.fft.rfft(b, size)
        total += np.fft.irfft(x.conj() * y, size)
    # Of nothing in common the sum over k steps has the variance k.
    shift = np.arange(size)
    shift[shift > size // 2] -= size
    overlap = np.minimum(len(first), len(second) - shift) - np.maximum(0, -shift) - 1
    usable = overlap >= _LEAST_OVERLAP * min(len(first), len(second))
    if not usable.any():
        return None
    score = np.where(usable, total / np.sqrt(np.maximum(overlap, 1)), -np.inf)
    scale = max(1.0, MAD_TO_SIGMA * float(np.median(np.abs(score[usable]))))
    top = int(np.argmax(score))
    return int(shift[top]) if score[top] > _SURE * scale else None


def _steps(values: Array) -> Array:
    """Return the changes from step to step, which no wander of a level correlates, in sigmas."""
    change = np.diff(np.nan_to_num(values), axis=0)
    return np.asarray(change / np.maximum(change.std(axis=0), 1e-300))


def _late(first: Array, second: Array, step_s: float) -> tuple[Array, Array]:
    """Return times and, in each window, by how many seconds the second shows it later.

    A delay d turns the phase of the cross-spectrum by omega d. Each frequency counts by its
    coherence C as C / (1 - C), which makes the estimate as good as it can be (Hannan and Thomson
    1973), and each axis adds its own.
    """
    n = min(len(first), len(second))
    both = np.stack([first[:n], second[:n]])
    rows = np.flatnonzero(np.isfinite(both).all(axis=(0, 2)))
    size = len(rows) // _WINDOWS
    if size < _SHORTEST:
        return np.empty(0), np.empty(0)
    parts = both[:, rows[: size * _WINDOWS]].reshape(2, _WINDOWS, size, -1)
    spectra = np.fft.rfft(np.diff(parts, axis=2) * np.hanning(size - 1)[:, None], axis=2)
    cross = spectra[0].conj() * spectra[1]
    kernel = np.ones(_SMOOTHED) / _SMOOTHED

    def smooth(values: Array) -> Array:
        whole = values.mean(axis=0)
        return np.stack([np.convolve(one, kernel, "same") for one in whole.T], axis=1)

    shared = np.hypot(smooth(cross.real), smooth(cross.imag))
    powers = smooth(np.abs(spectra[0]) ** 2) * smooth(np.abs(spectra[1]) ** 2)
    coherence = np.clip(shared**2 / np.maximum(powers, 1e-300), 0.0, 1.0 - 1e-6)
    # What nothing in common shows as well is no coherence.
    coherence[coherence < 8.0 / (_SMOOTHED * _WINDOWS)] = 0.0
    omega = 2 * np.pi * np.fft.rfftfreq(size - 1, step_s)[:, None]
    weight = coherence / (1 - coherence) / np.maximum(shared, 1e-300)
    bend = float(np.sum(omega**2 * weight * shared))
    if not bend > 0:
        return np.empty(0), np.empty(0)
    late = -np.sum(omega * weight * cross.imag, axis=(1, 2)) / bend
    at = (rows[0] + size * (np.arange(_WINDOWS) + 0.5)) * step_s
    return at, np.asarray(np.clip(late, -step_s, step_s))


def separated(values: Array, rate_hz: float) -> Separation:
    """Return the deviation of what all boards share, and of each board alone.

    Parameters
    ----------
    values : ndarray, shape (boards, n)
        One axis on one clock.
    rate_hz : float
        Steps in a second.

    Raises
    ------
    ValueError
        Of one board, or of a record too short.
    """
    boards, n = values.shape
    if boards < 2 or n < _FEWEST_STEPS:
        raise ValueError("need two boards and 64 steps that they have in common")
    values = values - values.mean(axis=1, keepdims=True)
    m = 2 ** np.arange(_FIRST_OCTAVE, int(math.log2(n / 4)) + 1)
    # Allan terms of all boards, and their covariances at each averaging factor.
    phase = np.concatenate([np.zeros((boards, 1)), np.cumsum(values, axis=1)], axis=1)
    covariance = np.empty((len(m), boards, boards))
    for row, k in enumerate(m):
        terms = phase[:, 2 * k :] - 2 * phase[:, k:-k] + phase[:, : -2 * k]
        covariance[row] = terms @ terms.T / (2.0 * k**2 * terms.shape[1])
    gains = _gains(covariance, n / m)
    covariance /= np.outer(gains, gains)
    scaled = values / gains[:, None]
    pairs = list(combinations(range(boards), 2))
    shared = np.mean([covariance[:, i, j] for i, j in pairs], axis=0)
    edf = np.mean([_edf(scaled[i] - scaled[j], rate_hz, m) for i, j in pairs], axis=0)
    own = np.array([_own(covariance, i, pairs) for i in range(boards)])
    if boards == 2:
        own = np.tile((covariance[:, 0, 0] + covariance[:, 1, 1]) / 2 - covariance[:, 0, 1], (2, 1))
    known = edf >= _LEAST_EDF
    curves = []
    for i in range(boards):
        others = [j for j in range(boards) if j != i]
        limits = np.array(
            [
                _limits(own[i, row], own[others, row], edf[row], boards)
                for row in np.flatnonzero(known)
            ]
        ).reshape(-1, 2)
        curves.append(
            IndividualNoise(
                deviation=gains[i] * _root(own[i, known]),
                lower=gains[i] * limits[:, 0],
                upper=gains[i] * limits[:, 1],
                measured=gains[i] * np.sqrt(covariance[known, i, i]),
                gain=float(gains[i]),
            )
        )
    return Separation(m[known] / rate_hz, _root(shared[known]), tuple(curves))


def _own(covariance: Array, i: int, pairs: Sequence[tuple[int, int]]) -> Array:
    """Return the variance of one board: the mean over all pairs of others."""
    rows = [
        covariance[:, i, i] - covariance[:, i, j] - covariance[:, i, k] + covariance[:, j, k]
        for j, k in pairs
        if i not in (j, k)
    ]
    return np.asarray(np.mean(rows, axis=0) if rows else covariance[:, i, i])


def _root(variance: Array) -> Array:
    return np.sqrt(np.where(variance > 0, variance, np.nan))


def _edf(difference: Array, rate_hz: float, m: NDArray[np.int64]) -> Array:
    """Return degrees of freedom of the difference of two boards, 0 where there is no value."""
    curve = deviation(difference, rate_hz, "oadev", taus=m / rate_hz)
    found = np.zeros(len(m))
    for tau, edf in zip(curve.tau, curve.edf, strict=True):
        found[int(np.argmin(np.abs(m / rate_hz - tau)))] = edf
    return found


def _gains(covariance: Array, terms: Array) -> Array:
    """Return how much each board sees of what all share, their mean 1; 1 where that is little.

    The covariance of two boards is the product of their gains and the variance of what is shared;
    that of a board with itself has its own noise in it and is left out. The logarithms are taken
    together over all averaging times, each as sure as the noise beside what is shared makes it.

    Parameters
    ----------
    covariance : ndarray, shape (k, boards, boards)
        Of Allan terms.
    terms : ndarray, shape (k,)
        How many of them are independent.
    """
    boards = covariance.shape[1]
    gains = np.ones(boards)
    pairs = list(combinations(range(boards), 2))
    if boards < 3:
        return gains
    design = np.zeros((len(pairs), boards))
    for row, (i, j) in enumerate(pairs):
        design[row, [i, j]] = 1.0
    of_pairs = np.array([covariance[:, i, j] for i, j in pairs])
    powers = np.array([[covariance[:, i, i], covariance[:, j, j]] for i, j in pairs])
    noise = np.maximum(powers - of_pairs[:, None], 0.0)
    error = np.sqrt((powers.prod(axis=1)) / terms)
    sure = (of_pairs > _SURE_OF_GAIN * error).all(axis=0)
    if not sure.any():
        return gains
    share = of_pairs[:, sure]
    spread = (noise.sum(axis=1)[:, sure] / share + noise.prod(axis=1)[:, sure] / share**2).mean(0)
    weight = terms[sure] / np.maximum(spread, 1e-12)
    # The variance of what is shared is another at each averaging time.
    logs = np.log(share) - np.log(share).mean(axis=0)
    mean = (logs * weight).sum(axis=1) / weight.sum()
    centred = design - design.mean(axis=0)
    gains = np.exp(np.linalg.lstsq(centred, mean)[0])
    return np.asarray(gains / gains.mean())


def _limits(own: float, others: Array, edf: float, boards: int) -> tuple[float, float]:
    """Return 95 % limits of the deviation of one board.

    The estimate is the mean of a_i^2 less products of a_i with the terms of other boards, and
    of those with each other: each adds its variance. The limits are those variances at which the
    estimate would be at the 2.5 % points (Wilson and Hilferty's for the squares).
    """
    floor = max(own, 1e-3 * float(np.max(np.abs(others))), 1e-300)
    rest = np.maximum(others, 0.0)
    if boards == 2:  # The mean of both, of one difference.
        cross, mixed = 0.0, 0.0
    else:
        cross = 4.0 * float(rest.sum()) / (boards - 1) ** 2
        pairs = (boards - 1) * (boards - 2) / 2
        mixed = (float(rest.sum()) ** 2 - float(np.sum(rest**2))) / 2 / pairs**2

    def quantile(true: float, p: float) -> float:
        z = float(ndtri(p))
        spread = math.sqrt((cross * true + mixed) / edf)
        square = true * max(1 - 2 / (9 * edf) + z * math.sqrt(2 / (9 * edf)), 0.0) ** 3
        return true + math.copysign(math.hypot(square - true, z * spread), z)

    def solved(p: float) -> float:
        high = 100.0 * floor * (1 + 10 / edf)
        low = 1e-9 * floor
        if quantile(low, p) >= own:
            return 0.0
        if quantile(high, p) <= own:
            return high
        return float(brentq(lambda true: quantile(true, p) - own, low, high, xtol=low))

    return math.sqrt(solved(0.975)), math.sqrt(solved(0.025))
