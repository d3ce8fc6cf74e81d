r"""Where a line comes from: the sensor's own clock, outside, and at which frequency it truly is.

Sample n is taken at the true time t(n) = t0 + n T + e(n), where e is how far the sensor's clock is
from a steady one. It is measured: numbers of samples against the times at which they were seen. In
a line of true frequency f the samples hold the phase

.. math:: 2\pi (\nu n + \beta e(n)), \qquad \beta = k f_s \pm f_{observed}

with beta = f where the line is not folded, one of the others where it is, and zero where the line
is made from the sensor's own clock, so that it does not move in counts at all. What is likeliest of
these is told by the power that adds up in phase. Where the clock hardly wanders all are alike: then
only a line that does not keep phase with the samples is known not to be of their clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.fft import fft, ifft, next_fast_len
from scipy.special import chdtrc

from allanscope.analysis.experiments import Experiment, another_rate
from allanscope.analysis.line_families import FOLDS, fold
from allanscope.quantities import DEVIATION, MAD_TO_SIGMA, TWO_SIDED_95, number, symbols

__all__ = [
    "ClockWander",
    "KnownSource",
    "LineOrigin",
    "LineSums",
    "clock_wander_of",
    "origin_of",
    "reduced",
    "without_trend",
]

Array = NDArray[np.float64]
Arrivals = tuple[NDArray[np.int64], Array, NDArray[np.int64]]
Source = Literal["internal", "external", "free-running", "unknown"]

_BLOCKS = 512
"""Sums into which the record is reduced; none may be longer than a fifth of a cycle of offset."""
_PADDING = 4
_FEWEST_BLOCKS = 64
_SECTIONS = 8
_MOST_PIECES = 16
"""Part of the record below which a piece between gaps of unknown length is left out."""
_FEWEST_ARRIVALS = 3
_SURE_OF_SOURCE = 5.0
"""Nats by which a line from outside and one of the sensor's own clock must differ."""
_SURE_OF_FREQUENCY = 4.0
_SYSTEMATIC = 0.002
_ERRORS = 3.0
"""Largest share of a gain that the errors of the measured clock may take, and how many of them."""
_INCOHERENT_P = 1e-6
_INCOHERENT_RAD = 0.5
"""Phase that a line must wander by, rms, before it is said not to be of the samples' clock."""
_HIGHEST_ORDER = 20
_LARGEST_PPM = 1e5
"""Change of a rate that no oscillator shows."""
_NEIGHBOURS, _FAR_OFF = 7, 20.0
"""Times whose median is the usual one, and how many sigma from it a time is no longer used."""
_MAINS = 1e-3
"""Relative tolerance of mains, and of a USB host's frames."""
_USB = 5e-4
_OVERTONES = 10
_LIKELY_CHANCE = 0.05
"""Chance of agreement up to which a known frequency is named."""
_FRACTIONS = 8


@dataclass(frozen=True, slots=True)
class ClockWander:
    """How far a sensor's clock is from a steady one.

    Attributes
    ----------
    coefficients : ndarray, shape (k,)
        Of Chebyshev polynomials, in s.
    first, last : float
        Numbers of the samples between which they hold.
    relative_ppm : float
        Change of the rate over the record, highest less lowest.
    rate_hz : float
        Mean rate: that of the line from which `at` tells the distance.
    error_s : float
        Standard error of the times.
    """

    coefficients: Array
    first: float
    last: float
    relative_ppm: float
    rate_hz: float
    error_s: float

    def at(self, n: Array) -> Array:
        """Return the error of the time of samples in s, shape (n,), without its own line."""
        x = 2.0 * (n - self.first) / (self.last - self.first) - 1.0
        found = chebyshev.chebval(np.clip(x, -1.0, 1.0), self.coefficients)
        return np.asarray(found - np.polyval(np.polyfit(x, found, 1), x))


@dataclass(frozen=True, slots=True)
class KnownSource:
    """A frequency that is common around a sensor, and that would be seen where the line is.

    Attributes
    ----------
    name : str
        E.g. ``mains 50 Hz x 3``.
    frequency_hz, folded_hz : float
        True, and as it would be seen.
    by_chance : float
        Expected number of such agreements among all that were compared, had none a reason.
    """

    name: str
    frequency_hz: float
    folded_hz: float
    by_chance: float


@dataclass(frozen=True, slots=True)
class LineOrigin:
    """What is known of where a line comes from.

    Attributes
    ----------
    source : {'internal', 'external', 'free-running', 'unknown'}
        ``internal`` goes with the sensor's own clock, ``external`` keeps its true frequency while
        that clock wanders, ``free-running`` does not keep phase with it.
    frequency_hz, lower_hz, upper_hz : float or None
        True frequency with its 95 % interval; None if not determined.
    candidates_hz : tuple of float
        True frequencies that remain, the lowest first, of those that would be seen where it is.
    margin_nats : float
        Log-likelihood margin over the next candidate; 0 if not determined.
    wander_ppm : float or None
        Change of the sample rate over the record; None where it was not measured.
    known : tuple of KnownSource
        Common frequencies that agree within the interval.
    attenuation : (float, float) or None
        What the low-pass of the axis leaves of the amplitude at the true frequency: of two poles
        and of one. None where either is not known.
    amplitude : (float, float) or None
        True amplitude before that low-pass, lowest and highest, in the unit of the axis.
    experiment : Experiment or None
        What would tell the source or the frequency, where this record cannot.
    words : str
        All of it in a phrase.
    brief : str
        The source in few words; empty where it is not known.
    """

    source: Source
    frequency_hz: float | None
    lower_hz: float | None
    upper_hz: float | None
    candidates_hz: tuple[float, ...]
    margin_nats: float
    wander_ppm: float | None
    known: tuple[KnownSource, ...]
    attenuation: tuple[float, float] | None
    words: str
    brief: str = ""
    amplitude: tuple[float, float] | None = None
    experiment: Experiment | None = None


def clock_wander_of(arrivals: Arrivals | None) -> ClockWander | None:
    """Return how a clock wandered; None where that is not known better than not at all.

    Parameters
    ----------
    arrivals : (numbers, times in s, segments), each shape (k,), or None
        The smallest delays of a stream (`Clock.arrivals`). Times of different segments have
        different origins.
    """
    if arrivals is None:
        return None
    use = np.bincount(arrivals[2])[arrivals[2]] >= _FEWEST_ARRIVALS
    n = arrivals[0][use].astype(np.float64)
    time_s, segment = arrivals[1][use], arrivals[2][use]
    if len(n) < 4 * _FEWEST_ARRIVALS:
        return None
    first, last = float(n[0]), float(n[-1])
    if last <= first:
        return None
    x = 2.0 * (n - first) / (last - first) - 1.0
    which = np.unique(segment, return_inverse=True)[1]
    starts = (segment[:, None] == np.unique(segment)).astype(np.float64)
    time_s = time_s - time_s[np.flatnonzero(np.diff(which, prepend=-1))][which]
    keep = _among_neighbours(x, time_s, starts)
    for _ in range(3):
        best, origins = _smoothest(x, time_s, starts, keep)
        late = time_s - chebyshev.chebval(x, best) - starts @ origins
        sigma = MAD_TO_SIGMA * float(np.median(np.abs(late - np.median(late))))
        keep = np.abs(late - np.median(late)) <= 5.0 * max(sigma, 1e-9)
    if len(best) <= 2:
        return None
    x = np.linspace(-1.0, 1.0, 257)
    pace = chebyshev.chebval(x, chebyshev.chebder(best))
    mean = float(np.polyfit(x, chebyshev.chebval(x, best), 1)[0])
    relative_ppm = 1e6 * float(np.ptp(pace)) / mean
    if not relative_ppm < _LARGEST_PPM:
        return None
    error_s = max(sigma, 1e-9) * math.sqrt((len(best) + len(origins)) / int(keep.sum()))
    return ClockWander(
        best, 0.0, last - first, relative_ppm, (last - first) / (2.0 * mean), error_s
    )


def _among_neighbours(x: Array, y: Array, starts: Array) -> NDArray[np.bool_]:
    """Return which times lie near those around them: one that is far off bends a polynomial."""
    from scipy.ndimage import median_filter

    design = np.hstack([x[:, np.newaxis], starts])
    late = y - design @ np.linalg.lstsq(design, y)[0]
    apart = np.abs(late - median_filter(late, _NEIGHBOURS, mode="mirror"))
    usual = MAD_TO_SIGMA * float(np.median(apart))
    return np.asarray(apart <= _FAR_OFF * max(usual, 1e-6))


def _smoothest(x: Array, y: Array, starts: Array, keep: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the polynomial that the Schwarz criterion prefers, and the origin of each segment."""
    n = int(keep.sum())
    found: list[tuple[float, Array, Array]] = []
    basis = chebyshev.chebvander(x, _HIGHEST_ORDER)[:, 1:]
    for order in range(1, min(_HIGHEST_ORDER, n // 3) + 1):
        design = np.hstack([basis[keep, :order], starts[keep]])
        c = np.asarray(np.linalg.lstsq(design, y[keep])[0], np.float64)
        rest = y[keep] - design @ c
        misfit = n * math.log(max(float(rest @ rest) / n, 1e-24))
        found.append((misfit + 3 * order * math.log(n), np.r_[0.0, c[:order]], c[order:]))
    return min(found, key=lambda one: one[0])[1:]


@dataclass(frozen=True, slots=True)
class LineSums:
    """A line reduced to sums, of each axis that has it.

    Where it is not known how many samples a gap lacks, the phase beyond is another: then each piece
    of an axis between such gaps has sums of its own, nought elsewhere.

    Attributes
    ----------
    sums : ndarray of complex, shape (axes x pieces, m)
        Of the samples, turned back by the frequency.
    level : ndarray, shape (axes x pieces,)
        Mean power of a sum over the whole piece where there is no line.
    share : ndarray, shape (axes x pieces,)
        Part of the record that a piece is.
    late_s : ndarray, shape (m,)
        Error of the clock.
    reach : int
        Bins of the padded transform on each side in which the line is looked for.
    spread : float
        Bins by which a line of 1 Hz is drawn out because the clock wanders.
    error_s : float
        Standard error of `late_s`.
    """

    sums: NDArray[np.complex128]
    level: Array
    share: Array
    late_s: Array
    reach: int
    spread: float
    error_s: float = 0.0

    def systematic(self, beta: float) -> float:
        """Return the share of a gain that the errors of the clock may take."""
        phase = 2.0 * np.pi * beta * _ERRORS * self.error_s
        return min(_SYSTEMATIC, phase**2)

    def near(self, beta: float) -> NDArray[np.int64]:
        """Return the bins in which a line may be that follows the clock so far."""
        m = _PADDING * self.sums.shape[1]
        reach = min(self.reach + math.ceil(_PADDING * self.spread * abs(beta)), m // 4)
        return np.asarray(np.r_[0 : reach + 1, -reach:0], np.int64)

    def gain(self, beta: float) -> float:
        """Return the log-likelihood that a line gains which follows the clock so far, in nats."""
        return float(np.max(self._gains(beta)))

    def _gains(self, beta: float) -> Array:
        return np.asarray(self._gains_of_pieces(beta).sum(axis=0))

    def _gains_of_pieces(self, beta: float) -> Array:
        turned = self.sums * np.exp(-2j * np.pi * beta * self.late_s)
        power = np.abs(_transform_at(turned, self.near(beta), _PADDING * turned.shape[1])) ** 2
        return np.asarray(power / self.level[:, None])

    def offset(self, beta: float) -> tuple[float, float]:
        """Return how far the line is from where it was looked for, and the standard error.

        In cycles per record; the error is that of one frequency in white noise.
        """
        near, pieces = self.near(beta), self._gains_of_pieces(beta)
        gains = pieces.sum(axis=0)
        top = int(np.argmax(gains))
        order = np.argsort(near)
        at = int(np.flatnonzero(order == top)[0])
        bend = 0.0
        if 0 < at < len(order) - 1:
            left, mid, right = gains[order[at - 1 : at + 2]]
            bend = 0.5 * (left - right) / min(left - 2 * mid + right, -1e-12)
        # A piece is the shorter for the frequency.
        strength = max(float(pieces[:, top] @ self.share**2), float(np.min(self.share)) ** 2)
        error = math.sqrt(3.0) / (math.pi * math.sqrt(2.0 * strength))
        return (float(near[top]) + bend) / _PADDING, error

    def phases(self, beta: float) -> tuple[float, float]:
        """Return how far the phase of sections is from a line, rms in rad, and its chance."""
        turned = self.sums * np.exp(-2j * np.pi * beta * self.late_s)
        m = turned.shape[1]
        size = _PADDING * m
        at = self.near(beta)[int(np.argmax(self._gains(beta)))]
        turned = turned * np.exp(-2j * np.pi * at / size * np.arange(m))
        square, freedom, total, weights = 0.0, 0, 0.0, 0.0
        for row, level in zip(turned, self.level / self.share, strict=True):
            part = np.array([one.sum() for one in np.array_split(row, _SECTIONS)])
            gain = np.abs(part) ** 2 / (level / _SECTIONS)
            use = gain > _SECTIONS
            if use.sum() < 4:
                continue
            x = np.arange(_SECTIONS)[use].astype(np.float64)
            phase = np.unwrap(np.angle(part[use]))
            sigma = np.sqrt(0.5 / gain[use])
            rest = phase - np.polyval(np.polyfit(x, phase, 1, w=1.0 / sigma), x)
            square += float(np.sum((rest / np.hypot(sigma, 0.05)) ** 2))
            freedom += len(x) - 2
            total += float(np.sum(rest**2))
            weights += len(x)
        if not freedom:
            return 0.0, 1.0
        return math.sqrt(total / weights), float(chdtrc(freedom, square))


def _transform_at(
    x: NDArray[np.complex128], bins: NDArray[np.int64], size: int
) -> NDArray[np.complex128]:
    """Return some neighbouring bins of the transforms of rows that are padded to a size.

    As a convolution with a chirp (Bluestein, IEEE Trans. Audio Electroacoust. 18, 1970, p. 451):
    where the size has a large prime factor, as most have, several times as quick as all bins are.

    Examples
    --------
    >>> x, bins = np.random.default_rng(1).normal(size=(1, 643)) + 0j, np.r_[0:10, -9:0]
    >>> np.allclose(_transform_at(x, bins, 4 * 643), np.fft.fft(x, 4 * 643)[:, bins])
    True
    """
    m, low, high = x.shape[1], int(bins.min()), int(bins.max())
    before, apart = _chirps(m, low, high, size)
    length = apart.shape[-1]
    spectrum = fft(x * before, length) * apart
    return np.asarray(_chirp(bins, size) * ifft(spectrum)[:, bins - low + m - 1], np.complex128)


@lru_cache(maxsize=1)  # a line is looked for at the same bins for one frequency after the other
def _chirps(
    m: int, low: int, high: int, size: int
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return what m samples are multiplied by, and the transform that they are convolved with."""
    apart = _chirp(np.arange(low - m + 1, high + 1), size).conj()
    return _chirp(np.arange(m), size), np.asarray(fft(apart, next_fast_len(len(apart))))


def _chirp(j: NDArray[np.int64], size: int) -> NDArray[np.complex128]:
    # Small angles are exact.
    return np.asarray(np.exp(-1j * np.pi / size * (j * j % (2 * size))), np.complex128)


def origin_of(
    values: Array,
    numbers: Array,
    rate_hz: float,
    frequency: tuple[float, float, float],
    wander: ClockWander | None = None,
    *,
    width_hz: float = 0.0,
    rate_ppm: float | None = None,
    cutoff_hz: float | None = None,
    pieces: NDArray[np.int64] | None = None,
    offered_hz: Sequence[float] = (),
    amplitude: tuple[float, float, str] | None = None,
) -> LineOrigin:
    """Tell where a line comes from.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
        Rows of the axes that have the line.
    numbers : ndarray, shape (n,)
        Numbers of the samples that the rows are centred on.
    rate_hz : float
        True sample rate, or the best estimate of it.
    frequency : (float, float, float)
        Of the line as it is seen, with its interval, in Hz.
    wander : ClockWander, optional
        Of the sensor's clock.
    width_hz : float
        Bandwidth within which the line drifts.
    rate_ppm : float, optional
        Standard error of the rate; None where it was not measured.
    cutoff_hz : float, optional
        -3 dB frequency of the low-pass of the axis.
    pieces : ndarray, shape (n,), optional
        Number of the piece of each row, where it is not known how many samples lie between two.
    offered_hz : sequence of float
        Nominal sample rates that the part offers.
    amplitude : (float, float, str), optional
        Interval of the amplitude as it is seen, and its unit.
    """
    seen, low, high = frequency
    error = max((high - low) / (2 * TWO_SIDED_95), 1e-6 * seen)
    wander_ppm = None if wander is None else wander.relative_ppm
    line = reduced(values, numbers, rate_hz, seen, max(high - low, width_hz), wander, pieces)
    source: Source = "unknown"
    margin, chosen = 0.0, None
    places = [k * rate_hz + sign * seen for k in range(FOLDS + 1) for sign in (1, -1)]
    betas = [k * rate_hz + seen for k in range(-FOLDS, FOLDS + 1)]
    left = sorted(one for one in places if one > 0)
    gain = 0.0
    if line is not None:
        gain = line.gain(0.0)
        source, margin, remain = _most_likely_source(line, betas, wander is not None)
        if source == "external":
            left = sorted(abs(one) for one in remain)
            chosen = left[0] if len(left) == 1 else None
            gain = line.gain(remain[0])
        elif source == "internal":
            left, chosen = [], seen
        if chosen is not None:
            beta = 0.0 if source == "internal" else remain[0]
            offset, spread = line.offset(beta)
            length_s = float(numbers[-1] - numbers[0] + 1) / rate_hz
            # Folded downwards, a line moves the other way.
            chosen += (-offset if beta < 0 else offset) / length_s
            error = spread / length_s
            if wander is not None:
                # A drifting clock has no other mean rate than that of the line it is held against.
                chosen *= wander.rate_hz / rate_hz
    ends: tuple[float | None, float | None] = (None, None)
    if chosen is not None:
        k = round((chosen - seen) / rate_hz if chosen >= seen else 0)
        k = max(k, round((chosen + seen) / rate_hz)) if chosen > rate_hz / 2 else 0
        half = TWO_SIDED_95 * math.hypot(
            error, (k + seen / rate_hz) * rate_hz * 1e-6 * (rate_ppm or 0.0)
        )
        ends = (chosen - half, chosen + half)
    known = () if source == "free-running" else _known(seen, error, rate_hz, rate_ppm, source, left)
    passed = None
    if chosen is not None and cutoff_hz and source == "external":
        ratio = chosen / cutoff_hz
        passed = (1 / math.sqrt(1 + ratio**4), 1 / math.sqrt(1 + ratio**2))
    few = () if source == "internal" else tuple(left[:8])
    found = LineOrigin(source, chosen, *ends, few, margin, wander_ppm, known, passed, words="")
    if passed is not None and amplitude is not None:
        found = replace(found, amplitude=(amplitude[0] / passed[1], amplitude[1] / passed[0]))
    if chosen is None and len(numbers):
        length_s = float(numbers[-1] - numbers[0] + 1) / rate_hz
        open_source = source == "unknown"
        to_do = another_rate(
            seen,
            rate_hz,
            left,
            offered_hz,
            gain / length_s,
            width_hz=max(width_hz, high - low),
            or_internal=open_source,
        )
        found = replace(found, experiment=to_do)
    return _worded(found, seen, rate_hz, rate_ppm, amplitude[2] if amplitude else "")


def without_trend(values: Array) -> Array:
    """Return rows of one axis, shape (n,), without the straight line that fits them best.

    Examples
    --------
    >>> without_trend(np.array([1.0, 2.0, 6.0])).round(6)
    array([ 0.5, -1. ,  0.5])
    """
    x = np.linspace(-1.0, 1.0, len(values))
    centred = values - values.mean()
    return np.asarray(centred - (x @ centred) / (x @ x) * x)


def reduced(
    values: Array,
    numbers: Array,
    rate_hz: float,
    seen: float,
    width_hz: float,
    wander: ClockWander | None,
    pieces: NDArray[np.int64] | None = None,
) -> LineSums | None:
    """Return the sums of a line; None where the record is too short for any phase."""
    n = len(values)
    length = float(numbers[-1] - numbers[0]) + 1.0 if n else 0.0
    blocks = min(n // 4, max(_BLOCKS, int(20 * width_hz * length / rate_hz)))
    if blocks < _FEWEST_BLOCKS or not 0 < seen < rate_hz:
        return None
    # Blocks of equal time, so that a gap is a block that holds little.
    place = np.minimum((blocks * (numbers - numbers[0]) / length).astype(np.int64), blocks - 1)
    turn = np.exp(-2j * np.pi * np.remainder(seen / rate_hz * numbers, 1.0))
    sums = np.empty((values.shape[1], blocks), np.complex128)
    for row, column in zip(sums, values.T, strict=True):
        mixed = without_trend(column) * turn
        row[:] = np.bincount(place, mixed.real, blocks) + 1j * np.bincount(
            place, mixed.imag, blocks
        )
    centre = numbers[0] + (np.arange(blocks) + 0.5) * length / blocks
    late = np.zeros(blocks) if wander is None else wander.at(centre - numbers[0])
    power = np.abs(np.fft.fft(sums, axis=1)) ** 2
    cycles = length / rate_hz
    reach = math.ceil(2.0 + 0.75 * width_hz * cycles)
    aside = np.ones(blocks, bool)
    aside[: 2 * reach] = aside[-2 * reach :] = False
    if aside.sum() < blocks // 4:
        return None
    level = np.median(power[:, aside], axis=1) / math.log(2)
    spread = 0.0 if wander is None else 0.5e-6 * wander.relative_ppm * cycles
    if not level.all():
        return None
    share = np.ones(len(level))
    if pieces is not None:
        sums, share = _in_pieces(sums, place, pieces)
        level = np.repeat(level, len(share) // len(level)) * share
    error_s = 0.0 if wander is None else wander.error_s
    return LineSums(sums, level, share, late, _PADDING * reach, spread, error_s)


def _in_pieces(
    sums: NDArray[np.complex128], place: NDArray[np.int64], pieces: NDArray[np.int64]
) -> tuple[NDArray[np.complex128], Array]:
    """Return the sums of every piece of every axis, nought elsewhere, and its part of the record.

    A block that belongs to two pieces is given to the larger part of it; short pieces are left out.
    """
    names, count = np.unique(pieces, return_counts=True)
    names = names[count >= len(pieces) / _MOST_PIECES]
    if not len(names):
        names = np.unique(pieces)[np.argmax(count)][None]
    blocks = sums.shape[1]
    held = np.array([np.bincount(place[pieces == one], minlength=blocks) for one in names])
    own = (held.argmax(axis=0) == np.arange(len(names))[:, None]) & (held > 0)
    parts = (sums[:, None, :] * own).reshape(-1, blocks)
    return parts, np.tile(held.sum(axis=1) / len(pieces), len(sums))


def _most_likely_source(
    line: LineSums, betas: Sequence[float], is_measured: bool
) -> tuple[Source, float, tuple[float, ...]]:
    """Return the source, by how much it was told, and what its frequency may be."""
    inside = line.gain(0.0)
    gains = {beta: line.gain(beta) for beta in betas} if is_measured else {}
    beta, best = max(gains.items(), key=lambda one: one[1], default=(0.0, inside))
    spread = float(np.std(line.late_s))
    if is_measured and spread > 0:
        top = max(best, inside)
        at = beta if best >= inside else 0.0
        unsure = 1 / (2 * np.pi * spread * math.sqrt(2 * max(top, 1.0)))
        free = max(line.gain(at + step * unsure) for step in range(-8, 9))
        systematic = line.systematic(max(abs(beta), abs(unsure))) * top
        allowed = _SURE_OF_SOURCE + systematic
        apart, chance = line.phases(at)
        steady = free - top <= allowed and not (chance < _INCOHERENT_P and apart > _INCOHERENT_RAD)
        if steady and inside - best > allowed:
            return "internal", inside - best, ()
        if steady and best - inside > allowed:
            within = _SURE_OF_FREQUENCY + systematic
            remain = tuple(b for b, gain in gains.items() if gain > best - within)
            return "external", best - inside, remain
    apart, chance = line.phases(0.0)
    follows = best - inside > _SURE_OF_SOURCE
    if chance < _INCOHERENT_P and apart > _INCOHERENT_RAD and not (is_measured and follows):
        return "free-running", -math.log(max(chance, 1e-300)), ()
    return "unknown", 0.0, ()


def _known(
    seen: float,
    error: float,
    rate_hz: float,
    rate_ppm: float | None,
    source: Source,
    left: Sequence[float],
) -> tuple[KnownSource, ...]:
    """Return common frequencies that agree; none of an unmeasured rate, where any of them might."""
    found = []
    if source != "external":
        for parts in range(2, _FRACTIONS + 1):
            for k in range(1, parts // 2 + 1):
                if math.gcd(k, parts) == 1 and abs(k / parts * rate_hz - seen) <= 2 * error:
                    chance = _FRACTIONS**2 / 4 * 4 * error / (rate_hz / 2)
                    at = k / parts * rate_hz
                    name = f"{k if k > 1 else ''}fs/{parts}"
                    found.append(KnownSource(name, at, at, chance))
    if rate_ppm is None or source == "internal":
        return tuple(one for one in found if one.by_chance < _LIKELY_CHANCE)
    names = [
        (f"mains {f:g} Hz" + (f" x {h}" if h > 1 else ""), h * f, _MAINS)
        for f in (50.0, 60.0)
        for h in range(1, _OVERTONES + 1)
    ] + [(f"USB frames {h:g} kHz", 1000.0 * h, _USB) for h in (1, 8)]
    halves = {
        name: 2 * math.hypot(error, f * rate_ppm * 1e-6) + f * tolerance
        for name, f, tolerance in names
    }
    chance = sum(min(1.0, 4 * half / rate_hz) for half in halves.values())
    for name, f, _ in names:
        possible = not left or any(abs(one - f) <= halves[name] for one in left)
        if possible and abs(fold(f, rate_hz) - seen) <= halves[name]:
            found.append(KnownSource(name, f, fold(f, rate_hz), chance))
    return tuple(found)


def _worded(
    found: LineOrigin, seen: float, rate_hz: float, rate_ppm: float | None, unit: str
) -> LineOrigin:
    """Return it with its words."""
    ppm = f"{number(found.wander_ppm, 2)} ppm" if found.wander_ppm is not None else ""
    brief = ""
    match found.source:
        case "internal":
            brief = "locked to the sensor's clock"
            text = f"{brief}, at {number(seen / rate_hz, 5)} fs"
        case "free-running":
            brief = "not locked to the sensor's clock"
            text = "external or mechanical: it does not keep phase with the sensor's clock"
        case "external" if found.frequency_hz is not None:
            true = number(found.frequency_hz, 5)
            is_alias = found.frequency_hz > rate_hz / 2
            brief = f"alias of {true} Hz" if is_alias else "external"
            text = f"external, alias of {true} Hz" if is_alias else f"external, at {true} Hz"
        case "external":
            brief = "external"
            text = "external; true frequency not determined by this record"
        case _:
            why = (
                "the sample rate was not measured"
                if rate_ppm is None
                else f"the sample rate changed by {ppm}"
                if ppm
                else "no change of the sample rate was measured"
            )
            text = f"whether it is internal or external is not determined by this record ({why})"
    if found.attenuation is not None and found.frequency_hz is not None:
        low, high = found.attenuation
        if found.frequency_hz > rate_hz / 2:
            text += f", attenuated to {number(100 * low, 2)} to {number(100 * high, 2)} %"
            if found.amplitude is not None and unit in DEVIATION:
                least, most = (number(DEVIATION[unit].factor * one, 2) for one in found.amplitude)
                text += f", true amplitude {least} to {most} {symbols(DEVIATION[unit].unit)}"
    if found.known:
        names = " or ".join(one.name for one in found.known)
        text += f"; agrees with {names} (expected by chance: {number(found.known[0].by_chance, 2)})"
    return replace(found, words=text, brief=brief)
