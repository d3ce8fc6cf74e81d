r"""Short gaps filled with noise that is like its neighbourhood, so that one series goes through.

A record with every eighth row missing has no stretch that is long enough for a spectrum. Filling a
gap with the mean or with a straight line would join the stretches and colour the spectrum: what is
filled in has too little noise. Here the missing rows are drawn from their distribution under the
rows that are there (conditional simulation): with an autoregressive model of innovation variance
:math:`\sigma^2` and coefficients :math:`\alpha_0 = 1, \alpha_1 \ldots \alpha_p` the precision
matrix of the series is banded,

.. math:: Q_{ij} = \sigma^{-2} \sum_k \alpha_k \alpha_{k + |i - j|},

and the missing rows m given the others o are Gaussian with precision :math:`Q_{mm}` and mean
:math:`-Q_{mm}^{-1} Q_{mo} x_o`: white noise is filled with white noise, a line goes on, what a
low-pass smoothed stays smooth. The model is fitted to the filled series, and both are repeated
until they agree (data augmentation, Tanner and Wong, JASA 82, 1987). What is slower than the model
reaches is a running mean of the measured rows, and a burst is filled with noise of its own size.

The draw has a fixed seed: the same record gives the same numbers. Filled rows hold no information;
`worth_of` says how much less a variance is known for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import cho_solve_banded, cholesky_banded, solve_banded
from scipy.ndimage import uniform_filter1d

from allanscope.history import Record

__all__ = ["bridge_gaps", "steps_of", "worth_of"]

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

_LONGEST_S, _LONGEST_ROWS = 1.0, 300
"""Gaps up to both are bridged; one row is bridged at any rate."""
_MOST = 0.25
"""Share of filled rows above which nothing is bridged: the series would be mostly model."""
_FEWEST = 64
"""Rows from which a spectrum can be told."""
_ORDER, _ROWS_PER_COEFFICIENT = 64, 20
"""Coefficients of the autoregressive model of the noise, and rows that each of them needs."""
_LEVEL, _SCALE = 401, 257
"""Rows over which the level and the size of the noise are taken."""
_CHANCE = 2.0
"""Scatter of the size over that of white noise, which slow noise makes."""
_ROUNDS, _LEFT = 8, 1e-7
"""Most rounds of fitting and filling, and what they may leave: each takes off as much of what the
round before was wrong by as of the series was measured."""
_RIDGE = 1e-9
"""Relative to the variance: keeps a series of lines alone from being predicted exactly."""


def bridge_gaps(record: Record) -> Record:
    """Return a record whose short gaps are filled, as its `filled` tells.

    A gap is short up to 1 s and 300 rows. Longer ones, and those of which nobody knows how many
    rows they lack, still separate segments. Where more than a quarter of the rows would be filling,
    or nothing is missing, the record is returned as it is.

    Parameters
    ----------
    record : Record
        Rows of all axes.

    Examples
    --------
    >>> rows = np.delete(np.arange(1000), np.arange(7, 1000, 8))
    >>> values = np.random.default_rng(1).standard_normal((len(rows), 1))
    >>> pieces = np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1)
    >>> bounds = np.array([(piece[0], piece[-1] + 1) for piece in pieces])
    >>> nan = np.full(len(rows), np.nan)
    >>> record = Record(100.0, 1, ("gx",), values, (1.0,), nan, rows / 100.0, bounds)
    >>> bridged = bridge_gaps(record)
    >>> len(record.segments), len(bridged.segments), int(bridged.filled.sum())
    (125, 1, 124)
    >>> bool(np.array_equal(bridged.values[~bridged.filled], values))
    True
    """
    if len(record.segments) < 2:
        return record  # nothing is missing in one piece
    if len(record.values) < _FEWEST or not np.all(np.isfinite(record.values)):
        return record
    steps, short = steps_of(record)
    lost = int((steps[short] - 1).sum())
    if not lost or lost > _MOST * (len(record.values) + lost):
        return record
    # On both sides of a gap that stays, rows count as neighbours: a draw near it may be off a bit.
    row = np.concatenate([[0], np.cumsum(np.where(short, steps, 1))])
    size = int(row[-1]) + 1
    missing = np.ones(size, bool)
    missing[row] = False
    values = np.zeros((size, record.values.shape[1]))
    values[row] = record.values
    filled = missing.copy()
    if record.filled is not None:
        filled[row] = record.filled
    temperature = np.full(size, np.nan)
    temperature[row] = record.temperature_c
    first = record.segments[:, 0]
    first = row[first[(first == 0) | ~short[np.maximum(first, 1) - 1]]]
    return replace(
        record,
        values=_filled(values, np.flatnonzero(missing), missing),
        temperature_c=temperature,
        start_s=np.interp(np.arange(size), row, record.start_s),
        segments=np.column_stack([first, np.append(first[1:], size)]),
        filled=filled,
    )


def steps_of(record: Record) -> tuple[Rows, NDArray[np.bool_]]:
    """Return the time from each row to the next in rows, and which are short gaps."""
    steps = np.diff(np.round((record.start_s - record.start_s[0]) * record.rate_hz)).astype(
        np.int64
    )
    longest = max(1, min(_LONGEST_ROWS, int(_LONGEST_S * record.rate_hz)))
    return steps, (steps > 1) & (steps <= longest + 1)


def worth_of(record: Record) -> float:
    """Return the degrees of freedom of the rows, as a share of how many they are.

    Of n rows of white noise a share p is measured: their variance is known to 2 / (p n), and the
    draw of the others adds 2 (1 - p) / n.
    """
    if record.filled is None or not len(record.filled):
        return 1.0
    absent = float(record.filled.mean())
    return 1.0 / (1.0 / (1.0 - absent) + absent)


def _filled(values: Array, gaps: Rows, missing: NDArray[np.bool_]) -> Array:
    """Return the table with its missing rows drawn, shape (n, axes)."""
    present = (~missing).astype(np.float64)
    centre = values[~missing].mean(axis=0)
    level = _local_mean(values - centre, present, _LEVEL) + centre
    rest = np.where(missing[:, np.newaxis], 0.0, values - level)
    size = _size_of(rest, present)
    moving = np.ptp(values[~missing], axis=0) > 0
    rest = np.where(moving & (size > 0), rest / np.where(size > 0, size, 1.0), 0.0)
    standard = np.random.default_rng(0).standard_normal((len(gaps), values.shape[1]))
    columns = np.flatnonzero(moving)
    share = float(missing.mean())
    for _ in range(min(_ROUNDS, math.ceil(math.log(_LEFT) / math.log(share)))):
        models = [_Autoregression.of(rest[:, column]) for column in columns]
        draws = standard[:, columns] @ _root_of_correlation(rest[:, columns], models, ~missing)
        for model, column, draw in zip(models, columns, draws.T, strict=True):
            rest[gaps, column] = model.drawn(np.where(missing, 0.0, rest[:, column]), gaps, draw)
    out = values.copy()
    out[gaps] = np.where(moving, level[gaps] + size[gaps] * rest[gaps], values[~missing][0])
    return out


def _local_mean(values: Array, present: Array, width: int) -> Array:
    """Return the running mean over the rows that are present."""
    width = min(width, len(present) | 1)
    share = uniform_filter1d(present, width, mode="constant")
    total = uniform_filter1d(values * present[:, np.newaxis], width, axis=0, mode="constant")
    return np.asarray(total / np.maximum(share, 0.5 / width)[:, np.newaxis])


def _size_of(rest: Array, present: Array) -> Array:
    """Return the standard deviation around every row, shape (n, axes).

    That of all rows, as far as it changes no more than by chance (empirical Bayes on its
    logarithm): chance that went into the filling would look like a change of the noise.
    """
    power = _local_mean(rest**2, present, _SCALE)
    floor = 1e-6 * (rest**2).sum(axis=0) / present.sum()
    power = np.log(np.maximum(power, np.maximum(floor, 1e-300)))
    typical = np.log(np.maximum((rest**2).sum(axis=0) / present.sum(), 1e-300))
    by_chance = _CHANCE * 2 / (_SCALE * present.mean())
    middle = np.median(power, axis=0)
    beyond = np.maximum(np.mean((power - middle) ** 2, axis=0) - by_chance, 0.0)
    share = beyond / (beyond + by_chance)
    return np.asarray(np.exp(0.5 * (typical + share * (power - typical))))


@dataclass(frozen=True)
class _Autoregression:
    """Coefficients alpha_0 = 1 ... alpha_p, and the standard deviation of the innovations."""

    alpha: Array
    sigma: float

    @classmethod
    def of(cls, samples: Array) -> _Autoregression:
        """Fit one to a series by its autocovariance (Levinson and Durbin).

        The order is that of the least BIC: what is white is filled with white noise. A higher one
        would repeat in the filling what is chance in the measured rows, and double it.
        """
        n = len(samples)
        order = min(_ORDER, n // _ROWS_PER_COEFFICIENT)
        length = next_fast_len(n + order, real=True)
        lagged = irfft(np.abs(rfft(samples, length)) ** 2, length)[: order + 1] / n
        if not lagged[0] > 0:
            return cls(np.ones(1), 0.0)
        alpha, variance = np.ones(1), float(lagged[0]) * (1 + _RIDGE)
        best, least = cls(alpha, float(np.sqrt(variance))), n * float(np.log(variance))
        for k in range(1, order + 1):
            reflection = -float(alpha @ lagged[k:0:-1]) / variance
            alpha = np.append(alpha, 0.0) + reflection * np.append(alpha, 0.0)[::-1]
            variance *= 1 - reflection**2
            if not variance > _RIDGE * lagged[0]:
                break
            bic = n * float(np.log(variance)) + k * float(np.log(n))
            if bic < least:
                best, least = cls(alpha, float(np.sqrt(variance))), bic
        return best

    def innovations(self, samples: Array) -> Array:
        """Return what of each sample those before it do not predict."""
        return _convolved(samples, self.alpha)[: len(samples)]

    def drawn(self, samples: Array, gaps: Rows, standard: Array) -> Array:
        """Return a draw of the missing rows given the others.

        Parameters
        ----------
        samples : ndarray, shape (n,)
            With 0 where they are missing.
        gaps : ndarray, shape (m,)
            Which these are.
        standard : ndarray, shape (m,)
            Independent normal numbers.
        """
        order = len(self.alpha) - 1
        precision = np.correlate(self.alpha, self.alpha, "full")[order:]
        both_ways = np.concatenate([precision[:0:-1], precision])
        pull = -_convolved(samples, both_ways)[order : order + len(samples)][gaps]
        m = len(gaps)
        rows = []
        for k in range(min(m, order + 1)):
            apart = gaps[k:] - gaps[: m - k]
            if k and apart.min() > order:
                break
            near = np.where(apart <= order, precision[np.minimum(apart, order)], 0.0)
            rows.append(np.concatenate([near, np.zeros(k)]))
        lower = cholesky_banded(np.array(rows), lower=True)
        mean = cho_solve_banded((lower, True), pull)
        band = len(rows) - 1
        upper = np.zeros_like(lower)
        for k in range(band + 1):
            upper[band - k, k:] = lower[k, : m - k]
        return np.asarray(mean + self.sigma * solve_banded((0, band), upper, standard))


def _root_of_correlation(
    rest: Array, models: list[_Autoregression], present: NDArray[np.bool_]
) -> Array:
    """Return what makes independent numbers as correlated as the innovations of the axes are.

    A row is missing on all axes at once: filled independently, a share of their coupling would go.
    """
    table = np.column_stack(
        [m.innovations(rest[:, k])[present] for k, m in enumerate(models)]
        or [np.empty((len(rest), 0))]
    )
    size = np.sqrt(np.mean(table**2, axis=0))
    table = table / np.where(size > 0, size, 1.0)
    eigenvalues, vectors = np.linalg.eigh(table.T @ table / max(1, len(table)))
    return np.asarray((vectors * np.sqrt(np.maximum(eigenvalues, 0.0))) @ vectors.T)


def _convolved(samples: Array, taps: Array) -> Array:
    """Return the full convolution; `scipy.signal`, which has one, takes half a second to load."""
    size = len(samples) + len(taps) - 1
    length = next_fast_len(size, real=True)
    return np.asarray(irfft(rfft(samples, length) * rfft(taps, length), length)[:size])
