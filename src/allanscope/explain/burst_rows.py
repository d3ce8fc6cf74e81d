r"""Where a record rings too softly for any row to be loud: footsteps, a tap on the desk.

A knock sets something ringing, :math:`e^{-t/\tau} \cos(\omega t + \varphi)` from one row on. Its
energy is that of many rows, at one frequency, and a matched filter collects it,

.. math:: z(t, \omega) = \sum_j x_{t+j} \, e^{-j/\tau} \, e^{-i \omega j},

at the frequencies of a discrete Fourier transform, for a ladder of decay times, at times that are
close enough to lose little; where it is large, at every row. The rows are whitened first, by linear
prediction, and cut at three deviations, so that no bad sample rings. In Gaussian noise
:math:`r = |z|^2` over its mean is exponential: it is what a ringing of the likeliest amplitude and
phase gains, in nats.

The mean must not be that of quieter noise. It is measured at each frequency (a line is no burst),
and compared with what is beside: the other frequencies at that time (noise that is louder for a
moment is so at all of them), and the seconds around (a tone that swells). Of noise that is measured
with m degrees of freedom r has an F distribution, and what it gains is :math:`m \ln (1 + r / m)`;
where the loudness of the record hardly changes elsewhere, m is large.

A level that changes is strongest at low frequencies, has no swings, and is explained as well by two
instants at which it changes: a ringing must be more than that. A row that is sent twice is no
measurement: behind a low-pass, where the rows before tell the next one closely, it is a kick that
the prediction error filter draws out. So a ringing must be more than errors of the repeated rows,
too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.fft import rfft
from scipy.linalg import solve_toeplitz
from scipy.ndimage import median_filter

from allanscope.compiled import Pointer, kernel
from allanscope.lazy import once
from allanscope.median import median
from allanscope.quantities import MAD_TO_SIGMA

__all__ = ["Burst", "find_bursts"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ALPHA = 1e-3
"""Chance of a burst in a record that has none."""
_CUT, _ORDER = 3.0, 16
"""Deviations at which a row is cut, and rows that predict the next one."""
_WINDOW, _HOPS = 4, 2
"""Length of the filter in decay times, and places that are looked at in one of them."""
_SHORTEST_ROWS, _LONGEST_S = 16, 0.8
"""Decay times: the shortest in rows, the longest in s."""
_SWINGS, _TOP = 6, 4
"""In the filter, at the least, and ordinates below the Nyquist frequency that are not looked at."""
_FEWEST = 12
"""Windows side by side that a record has at the least: of fewer no mean is known."""
_CLOSER, _FINER = 0.5, 60.0
"""Share of the limit from which every row is looked at, and by how many times that is more
alternatives: of 160 records of six axes in noise 3 gained more than a limit with 2."""
_DECAYS, _ROWS = (0.5, 0.71, 1.0, 1.41, 2.0), 16
"""Decays and rows in one at which it is looked at more closely."""
_FINE = 1.4
"""Power at every row over that at rows that are a sixteenth of a decay apart, at the most: it was
up to 1.26 in 538 places, with and without a ringing."""
_POINTS = 4096
"""Places of which a median is taken."""
_AT_ONCE = 1 << 16
"""Numbers that are transformed at once: what is made of them stays in the cache."""
_SMOOTH, _LINE = 9, 3.0
"""Ordinates over which the noise is even, and standard errors by which a line exceeds it."""
_FLAT = 0.85
"""Geometric over arithmetic mean of the power over frequency, at the least: below, whitening has
left lines that wander and ring by themselves (constant lines and low-passes stay above 0.9)."""
_BESIDE = 5
"""Ordinates on each side of a ringing that hold some of it."""
_AROUND = 8
"""Windows before and after in which the noise is measured as well."""
_FREEDOM = 3.0
"""Ordinates that are one degree of freedom: filters overlap, and a median knows half as much."""
_QUIETEST = 0.75
"""Share of the frequencies by which a time is as loud as it is: a ringing is in the others."""
_VARIES, _EVEN = 0.045, 1e-3
"""Relative variance of that loudness over windows in white noise, and what is none beyond it."""
_LOUDER, _LOUDEST = 3.0, 10.0
"""Standard errors from which it is louder there than in the record; times at which it is cut."""
_LEVELS, _BY_LEVELS = 10.0, 0.3
"""Nats that two changes of the level gain by chance; share of the gain that they may explain."""
_UNCUT = 0.5
"""Share of what cut rows show that uncut rows must show as well."""
_BY_REPEATS = 0.5
"""Share of the gain that errors of repeated rows may explain: of codes so few that a third of the
rows are equal by chance, they explain a third of a ringing."""
_FITTED = 2.5
"""Nats that noise adds to the gain: amplitude, phase, start, decay and frequency are fitted."""
_NEAR = 4
"""Half ordinates beside the best of which the peak is taken."""
_SINGULAR = 1e-6
"""Of two changes at nearly one time the sizes cannot be told apart."""
_PIECES = 128
"""Places at which the level is let change."""


_EIGHT = 8
"""Pieces that are transformed side by side."""
_NUMBERS = Pointer(np.float32, 1)
_ROOM = Pointer(np.float32, 1, written=True)
_powers = kernel(
    "powers_of_pieces",
    *(_NUMBERS, Pointer(np.int64, 1), int, int, _NUMBERS, Pointer(np.float32, 2), _ROOM),
    Pointer(np.float32, 2, written=True),
)
_largest = kernel(
    "largest_powers",
    *(_NUMBERS, int, int, int, _NUMBERS, Pointer(np.float32, 2), _ROOM),
    *(Pointer(np.float64, 1), int, int, Pointer(np.float64, 1, written=True)),
)


@dataclass(frozen=True)
class Burst:
    """One burst on one axis.

    Attributes
    ----------
    first, decay : int
        Row with which it begins, and decay time in rows.
    gain, log_alternatives : float
        Nats that it gains, and the log of how many places, frequencies and decays were looked at.
    onset : tuple of float
        When it begins, in rows: median and ends of the 95 % interval.
    peak : tuple of float
        Largest swing, in the unit of the rows, and its standard error.
    """

    first: int
    decay: int
    gain: float
    log_alternatives: float
    onset: tuple[float, float, float]
    peak: tuple[float, float]

    @property
    def stop(self) -> int:
        """Row at which it is over, but for a twentieth."""
        return self.first + 3 * self.decay


def find_bursts(
    x: Array, rate_hz: float, axes: int = 1, repeated: Flags | None = None
) -> tuple[list[Burst], float]:
    """Return the bursts of one axis, and the log of everything that was looked at.

    What is found at several decay times is there several times.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Rows about their level.
    axes : int
        Axes that are searched.
    repeated : ndarray of bool, shape (n,), optional
        Rows that may be the row before, sent again.
    """
    decays, decay = [], _SHORTEST_ROWS
    while decay <= _LONGEST_S * rate_hz and len(x) >= _FEWEST * _WINDOW * decay:
        decays.append(decay)
        decay *= 2
    looked_at = float(np.log(_FINER * axes * max(sum(_cells(len(x), d) for d in decays), 1)))
    rows = _Rows.of(x, repeated) if decays else None
    if rows is None:
        return [], looked_at
    found, loudness = [], None
    for decay in decays:
        bank = _Bank(rows, decay)
        if bank.flatness < _FLAT:
            break  # what wanders shows the more, the finer the frequencies are
        best = bank.largest()
        loudness = _of_windows(bank.loudness()) if loudness is None else loudness
        for place in _loud_places(best, _CLOSER * (looked_at - np.log(ALPHA))):
            burst = _at(bank, place * bank.hop, loudness, looked_at)
            if burst is not None:
                found.append(burst)
    return found, looked_at


def _cells(n: int, decay: int) -> int:
    """Return how many places and frequencies there are in n rows."""
    return _HOPS * n // decay * (_WINDOW * decay // 2 + 1 - _SWINGS - _TOP)


def _loud_places(best: Array, limit: float) -> list[int]:
    """Return the places that are louder than those beside them."""
    reach = 2 * _HOPS
    return [
        place
        for place in np.flatnonzero(best > limit).tolist()
        if best[place] >= best[max(0, place - reach) : place + reach + 1].max()
    ]


@dataclass(frozen=True)
class _Rows:
    """Whitened rows in deviations, cut, where they come from, and the prediction error filter.

    With them the numbers of the rows that are repeated.
    """

    white: NDArray[np.float32]
    source: Array
    filter: Array
    repeated: NDArray[np.int64]

    @classmethod
    def of(cls, x: Array, repeated: Flags | None = None) -> _Rows | None:
        """Whiten rows by linear prediction; None where nothing moves."""
        scale = MAD_TO_SIGMA * median(np.abs(x))
        if scale <= 0:
            return None
        cut = np.clip(x / scale, -_CUT, _CUT)
        covariance = np.array(
            [np.einsum("i,i", cut[lag:], cut[: len(cut) - lag]) for lag in range(_ORDER + 1)]
        )
        covariance[0] *= 1 + 1e-6  # values have a step
        predicted = solve_toeplitz(covariance[:-1], covariance[1:])
        errors = np.concatenate([[1.0], -predicted])
        white = np.convolve(cut, errors)[: len(cut)]
        white[:_ORDER] = 0.0  # predicted from rows that there are not
        own = MAD_TO_SIGMA * median(np.abs(white))
        if own <= 0:
            return None
        errors /= own * scale
        numbers = np.flatnonzero(np.zeros(0, bool) if repeated is None else repeated)
        white = np.clip(white / own, -_CUT, _CUT).astype(np.float32)
        return cls(white, x, errors, numbers)

    @once
    def uncut(self) -> Array:
        """Whitened rows that were not cut; of most axes none is asked for."""
        uncut = np.convolve(self.source, self.filter)[: len(self.source)]
        uncut[:_ORDER] = 0.0
        return uncut

    def passed(self, ordinate: float, size: int) -> float:
        """Return by what a swing was multiplied."""
        turn = np.exp(-2j * np.pi * ordinate / size * np.arange(len(self.filter)))
        return float(abs(np.sum(self.filter * turn)))


class _Bank:
    """Filters of one decay time over rows.

    Attributes
    ----------
    decay, size, hop : int
        Decay time, length of the filter, and distance of places, in rows.
    rows : ndarray, shape (starts, size)
        What is filtered.
    places : int
        Those that are looked at first.
    mean : ndarray, shape (size // 2 + 1,)
        Power in noise.
    flatness : float
        Of that power over frequency: 1 in white noise.
    """

    def __init__(self, source: _Rows, decay: int) -> None:
        self.source, self.decay = source, decay
        self.size, self.hop = _WINDOW * decay, decay // _HOPS
        self.form = np.exp(-np.arange(self.size) / decay)
        self.rows = sliding_window_view(source.white, self.size)
        self.windows = len(source.white) / self.size
        self.places = len(self.rows[:: self.hop])
        apart = max(1, self.places // _POINTS)
        power = self.power(np.arange(0, self.places, apart) * self.hop)
        mean = _medians(power) / np.log(2)
        even = median_filter(mean, _SMOOTH, mode="nearest")
        inner = np.maximum(even[_SWINGS:-_TOP], 1e-30)
        self.flatness = float(np.exp(np.mean(np.log(inner))) / inner.mean())
        self.mean = np.where(mean > even * (1 + _LINE / np.sqrt(self.windows)), mean, even)

    def power(self, starts: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the power of rows from some starts on, shape (size // 2 + 1, starts)."""
        found = np.empty((self.size // 2 + 1, len(starts)), np.float32)
        _powers(self.source.white, starts, len(starts), *self._transform(), found)
        return found

    def _transform(self) -> tuple[int, NDArray[np.float32], *tuple[NDArray[np.float32], ...]]:
        """Return what a transform takes: its size, form and waves, and room."""
        room = np.empty(2 * _EIGHT * self.size, np.float32)
        return self.size, self.form.astype(np.float32), _waves(self.size), room

    def largest(self) -> Array:
        """Return the largest relative power at all places."""
        best = np.empty(self.places)
        inner = _SWINGS, len(self.mean) - _TOP
        _largest(
            self.source.white, self.hop, self.places, *self._transform(), self.mean, *inner, best
        )
        return best

    def loudness(self) -> Array:
        """Return how loud it is at all places."""
        loudness, at_once = np.empty(self.places), max(1, _AT_ONCE // self.size)
        for k in range(0, self.places, at_once):
            some = slice(k, k + at_once)
            power = self.power(np.arange(self.places)[some] * self.hop)[_SWINGS:-_TOP]
            loudness[some] = _loudness(np.ascontiguousarray(power.T) / self.mean[_SWINGS:-_TOP])
        return loudness

    def closer(self, starts: NDArray[np.int64], decays: Array) -> Array:
        """Return the relative power, shape (starts, decays, size + 1).

        Ordinates are at half the distance.
        """
        forms = np.exp(-np.arange(self.size) / decays[:, np.newaxis])
        energy = np.sum(forms**2, axis=1)[:, np.newaxis]
        mean = np.interp(np.arange(self.size + 1) / 2, np.arange(len(self.mean)), self.mean)
        noise = mean * energy / np.sum(self.form**2)
        relative = np.empty((len(starts), len(decays), self.size + 1))
        at_once = max(1, _AT_ONCE // forms.size)
        for k in range(0, len(starts), at_once):
            some = slice(k, k + at_once)
            z = rfft(self.rows[starts[some], np.newaxis] * forms, 2 * self.size, axis=2)
            np.divide(z.real**2 + z.imag**2, noise, out=relative[some])
        return relative


@lru_cache(maxsize=16)
def _waves(size: int) -> NDArray[np.float32]:
    """Return cosine and sine of so many parts of a turn, by pairs."""
    turns = np.arange(size) * (2 * np.pi / size)
    return np.ascontiguousarray(np.stack([np.cos(turns), np.sin(turns)], axis=1), np.float32)


def _medians(power: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the medians of rows, as `numpy.median` does: one partition instead of two."""
    half = power.shape[1] // 2
    power.partition(half, axis=1)
    upper = power[:, half]
    if power.shape[1] % 2:
        return upper
    return np.asarray(np.mean([power[:, :half].max(axis=1), upper], axis=0))


def _loudness(relative: Array) -> Array:
    """Return how loud it is at every place, by the quietest frequencies; 1 on average."""
    kept = max(1, int(_QUIETEST * relative.shape[1]))
    lowest = np.partition(relative, kept - 1, axis=1)[:, :kept]
    return np.asarray(lowest.mean(axis=1) / (1 + (1 / _QUIETEST - 1) * np.log(1 - _QUIETEST)))


def _of_windows(loudness: Array) -> Array:
    """Return the means over windows."""
    places = _WINDOW * _HOPS
    return np.asarray(loudness[: len(loudness) // places * places].reshape(-1, places).mean(axis=1))


def _evenness(loudness: Array, first: int, stop: int) -> float:
    """Return with how many degrees of freedom the loudness is known from that of other windows."""
    size = _WINDOW * _SHORTEST_ROWS
    away = np.concatenate([loudness[: max(0, first // size - 1)], loudness[stop // size + 2 :]])
    if len(away) < 2:
        return 0.0
    changes = np.minimum(away, _LOUDEST) / away.mean() - 1
    varies = float(np.mean(changes**2)) - _VARIES
    return float(1 / max(varies + _VARIES * np.sqrt(2 / len(away)), _EVEN))


def _at(bank: _Bank, centre: int, loudness: Array, looked_at: float) -> Burst | None:
    """Return what rings near a row; None where that is noise, a level that changes, or repeats."""
    limit = looked_at - float(np.log(ALPHA))
    decays = bank.decay * np.array(_DECAYS)
    reach, step = bank.decay, max(1, bank.decay // _ROWS)
    for _ in range(2):  # at some rows, and then at every one near the best
        first, last = max(0, centre - reach), min(len(bank.rows), centre + reach + 1)
        starts = np.arange(first, last, step)
        inner = bank.closer(starts, decays)[:, :, 2 * _SWINGS : -2 * _TOP]
        s, d, k = (int(i) for i in np.unravel_index(int(np.argmax(inner)), inner.shape))
        centre, reach, step = int(starts[s]), 8 * step, max(1, step // 8)
        most = float(inner[s, d, k])
        if _FINE * most < limit:
            return None  # no gain exceeds the power
    ordinate = (k + 2 * _SWINGS) / 2
    uncut = _uncut(bank, centre, decays[d], ordinate)
    if abs(uncut) ** 2 < _UNCUT * most:
        return None
    gain = min(
        _beside(bank, inner[s, d], k, _evenness(loudness, centre, centre + bank.size)),
        _around(bank, centre, k // 2 + _SWINGS, most),
    )
    if not gain > limit:
        return None
    if _by_levels(bank, centre) - _LEVELS > _BY_LEVELS * abs(uncut) ** 2:
        return None
    if _by_repeats(bank, centre) > _BY_REPEATS * abs(uncut) ** 2:
        return None
    # Every start, decay and frequency has its part in when it began, and how strong it is.
    weight = np.exp(inner - most)
    weight /= weight.sum()
    below = np.concatenate([[0.0], np.cumsum(weight.sum(axis=(1, 2)))])
    edges = np.concatenate([[starts[0] - step], starts]).astype(float)
    low, median, high = np.interp([0.025, 0.5, 0.975], below, edges).tolist()
    near = np.arange(max(k - _NEAR, 0), min(k + _NEAR + 1, inner.shape[2]))
    peak = _peak(bank, starts, decays, (near + 2 * _SWINGS) / 2)
    return Burst(int(np.ceil(median)), bank.decay, gain, looked_at, (median, low, high), peak)


def _peak(
    bank: _Bank, starts: NDArray[np.int64], decays: Array, ordinates: Array
) -> tuple[float, float]:
    """Return the largest swing of what rings, and its standard error.

    Every start, decay and frequency is fitted to rows that are not cut as the prediction error
    filter passes it: of the first rows nothing is predicted, they are damped less than a line is.
    """
    rows = sliding_window_view(bank.source.uncut, bank.size)[starts]
    after = np.arange(bank.size)
    gains, peaks = [], []
    for decay in decays.tolist():
        for ordinate in ordinates.tolist():
            rings = np.exp((2j * np.pi * ordinate / bank.size - 1 / decay) * after)
            passed = np.convolve(rings, bank.source.filter)[: bank.size]
            pair = np.array([passed.real, -passed.imag])
            score = pair @ rows.T
            fitted = np.linalg.solve(pair @ pair.T, score)
            gains.append(np.sum(fitted * score, axis=0) / 2)
            amplitude = fitted[0] + 1j * fitted[1]
            peaks.append(np.abs((amplitude[:, np.newaxis] * rings).real).max(axis=1))
    gain, size = np.array(gains), np.array(peaks)
    most = float(gain.max())
    size = size * np.sqrt(np.maximum(1 - _FITTED / np.maximum(gain, 1.0), 0.0))
    weight = np.exp(gain - most)
    weight /= weight.sum()
    mean = float(np.sum(weight * size))
    return mean, float(np.sqrt(np.sum(weight * (size - mean) ** 2) + mean**2 / (2 * most)))


def _gain(relative: float, freedom: float, loudness: float) -> float:
    return float(freedom * np.log1p(relative / (freedom * loudness)))


def _beside(bank: _Bank, relative: Array, best: int, evenness: float) -> float:
    """Return what it gains over noise as loud as other frequencies are at the time."""
    others = np.delete(relative, slice(max(0, best - 2 * _BESIDE), best + 2 * _BESIDE + 1))
    known = len(others) / 2 / (2 * _FREEDOM)
    there = float(np.median(others)) / np.log(2) if len(others) else 1.0
    if there > 1 + _LOUDER / np.sqrt(max(known, 1e-9)):
        evenness = 0.0  # it is louder, however even the rest
    total = known + evenness
    loudness = max((known * there + evenness) / total, 1.0)
    return _gain(relative[best], 1 / (1 / total + 1 / (_FREEDOM * bank.windows)), loudness)


def _around(bank: _Bank, first: int, ordinate: int, relative: float) -> float:
    """Return what it gains over noise as loud as the seconds around are at its frequency.

    A line that wanders by an ordinate leaves the notch that the whitening has for it, and rings.
    """
    away = np.arange(2 * bank.size, _AROUND * bank.size, bank.hop)
    starts = np.concatenate([first - away + bank.size, first + away])
    starts = starts[(starts >= 0) & (starts < len(bank.rows))]
    known = len(starts) / (_WINDOW * _HOPS) * 1.5
    if not len(starts):
        return np.inf
    near = np.arange(ordinate - 1, ordinate + 2)
    passed = np.array([bank.source.passed(k, bank.size) for k in near.tolist()])
    power = bank.power(starts)[near].mean(axis=1) * (passed[1] / passed) ** 2
    there, line = float(power[1]) / bank.mean[ordinate], float(power.max()) / bank.mean[ordinate]
    there = line if line > _LINE else there
    even = _FREEDOM * bank.windows if there < 1 + _LOUDER / np.sqrt(known) else 0.0
    loudness = (known * max(there, 1.0) + even) / (known + even)
    return _gain(relative, known + even, loudness)


def _uncut(bank: _Bank, first: int, decay: float, ordinate: float) -> complex:
    """Return what a filter of energy 1 collects of rows that are not cut."""
    rows = bank.source.uncut[first : first + bank.size]
    form = np.exp(-(2j * np.pi * ordinate / bank.size + 1 / decay) * np.arange(len(rows)))
    return complex(rows @ form / np.sqrt(np.sum(np.abs(form) ** 2)))


def _by_levels(bank: _Bank, first: int) -> float:
    """Return what a level gains that changes twice near a burst."""
    rows = bank.source.uncut[max(0, first - bank.decay) : first + 2 * bank.decay]
    at = np.arange(0, len(rows), max(1, len(rows) // _PIECES))
    change = np.cumsum(bank.source.filter)
    after = np.arange(len(rows)) - at[:, np.newaxis]
    steps = np.where(after < 0, 0.0, change[np.clip(after, 0, len(change) - 1)])
    inner, found = steps @ steps.T, steps @ rows
    own, square = np.diag(inner)[:, np.newaxis], found[:, np.newaxis] ** 2
    explained = square * own.T + square.T * own - 2 * np.outer(found, found) * inner
    free = own * own.T - inner**2
    two = np.where(free > _SINGULAR * own * own.T, explained / np.maximum(free, 1e-300), 0.0)
    return float(two.max()) / 2


def _by_repeats(bank: _Bank, first: int) -> float:
    """Return what errors of the repeated rows near a burst gain, beyond what they do by chance."""
    source, length = bank.source, len(bank.source.filter)
    begin, end = max(0, first - length), first + bank.size
    at = source.repeated[slice(*np.searchsorted(source.repeated, (begin, end)))]
    if not len(at):
        return 0.0
    rows = source.uncut[begin:end]
    lag = np.arange(begin, begin + len(rows))[:, np.newaxis] - at
    kicks = np.where((lag >= 0) & (lag < length), source.filter[np.clip(lag, 0, length - 1)], 0.0)
    left = rows - kicks @ np.linalg.lstsq(kicks, rows, rcond=None)[0]
    return float(rows @ rows - left @ left - len(at)) / 2
