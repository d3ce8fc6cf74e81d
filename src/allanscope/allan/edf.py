"""Equivalent degrees of freedom: how many independent squares an overlapping variance is worth.

A variance is a mean of M squares ``z_i^2`` of a filtered phase. Neighbouring z overlap, hence are
correlated, and for Gaussian noise the mean is spread like a chi-square of

    edf = 2 E[V]^2 / Var[V] = M / sum_{|j| < M} (1 - |j|/M) rho_j^2

degrees of freedom, rho_j being the autocorrelation of z at a lag of j strides. C. Greenhall and
W. Riley, "Uncertainty of stability variances based on finite differences" (PTTI 2003), give rho in
closed form for every power law. They sum at most 100 lags and tabulate the rest, for strides of 1
or m. Here the lags are summed for any stride, one by one where rho is sharp and in growing blocks
where it is smooth, so one formula serves the full overlap of an array and the thinned terms of the
cascade. The sums do not depend on the length of the run and are kept: a growing run pays look-ups.

Power-law phase is not stationary, but a high enough difference of it is, and its covariance is the
same difference of a simple function of the lag alone (their equations 7 to 9). With the lag ``t``
in units of tau:

    s_w(t) = |t|^(3 - alpha), times log|t| for odd alpha      the noise, integrated
    s_x(t) = F^2 [2 s_w(t) - s_w(t - 1/F) - s_w(t + 1/F)]     the phase, averaged over tau / F
    s_z(t) = central difference of order 2 d of s_x           the term of the variance

F is m for a plain variance (the phase is averaged over one sample) and 1 for a modified one.

A sensor's phase is a running sum of samples and no average of a continuous one. For m below ten or
so that matters, so the plain variances take the covariance of discrete power-law
noise, S(f) ~ |2 sin(pi f)|^alpha, which is a closed form of the lag j in samples. With
``h(j) = 1 + 1/3 + ... + 1/(2j - 1)`` it is, up to what differences remove::

    flicker PM -h(j), white FM -j, flicker FM (j^2/2 - 1/8) h(j), random walk FM j^3 - j,
    flicker walk -(j^2 - 1/4) (j^2 - 9/4) h(j), random run -j (j^2 - 1) (j^2 - 4)
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.noise_type import alpha_named

__all__ = [
    "LagSums",
    "calibrated_edf",
    "calibrated_scale",
    "difference_autocovariance",
    "difference_edf",
    "difference_overlap",
    "phase_autocovariance",
    "sampled_autocovariance",
    "small_factor_loss",
    "sum_lags",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_ONE_BY_ONE = 1024
"""Up to this many lags every one is summed."""
_SUMMED_ALONE = 512
"""Up to this averaging factor the lags of each are summed."""
_FEW_TERMS = 256
"""So many terms are summed as they are."""
_GRID = 16
"""Averaging factors in each octave above, between which degrees of freedom are interpolated."""
_BINOMIAL = {1: (2.0, -1.0), 2: (6.0, -4.0, 1.0), 3: (20.0, -15.0, 6.0, -1.0)}

_FAR = 1000.0
"""Lag in units of tau / F from which on s_x of flicker PM is its limit, to save digits."""


@dataclass(frozen=True, slots=True)
class LagSums:
    """Squared autocorrelations of one filter, summed once so that any number of terms is a look-up.

    Attributes
    ----------
    edge : ndarray, shape (b + 1,)
        Lags up to which (exclusive) the sums reach, in strides.
    squares, moments : ndarray, shape (b + 1,)
        Sums of rho_j^2 and of j rho_j^2 over 1 <= j < edge; of two noises, of their product.
    """

    edge: Floats
    squares: Floats
    moments: Floats

    def edf(self, terms: float) -> float:
        """Return the degrees of freedom of a mean of `terms` squares; 0.0 for none."""
        return 1.0 / self.inverse(terms) if terms >= 1 else 0.0

    def inverse(self, terms: float) -> float:
        """Return 1 / edf of one noise, for `terms` >= 1; of two it may be negative."""
        if terms >= self.edge[-1]:
            squares, moments = self.squares[-1], self.moments[-1]
        else:
            squares = np.interp(terms, self.edge, self.squares)
            moments = np.interp(terms, self.edge, self.moments)
        return float((1.0 + 2.0 * (squares - moments / terms)) / terms)


def sum_lags(rho: Callable[[Floats], Floats], span: float, reach: float) -> LagSums:
    """Sum the squares of an autocorrelation over all lags up to `reach` tau.

    Parameters
    ----------
    rho : callable
        Autocorrelation at lags in units of tau.
    span : float
        Lags in one tau: m / stride.
    reach : float
        Lag in units of tau beyond which nothing counts.
    """
    edge, width, centre = _blocks(span, reach)
    return _summed_up(edge, centre, width * rho(centre / span) ** 2)


def _summed_up(edge: Floats, centre: Floats, square: Floats) -> LagSums:
    """Return the sums of squares, one for each block."""
    squares, moments = square.cumsum(), (centre * square).cumsum()
    return LagSums(edge, np.append(0.0, squares), np.append(0.0, moments))


@lru_cache(maxsize=1024)
def _blocks(span: float, reach: float) -> tuple[Floats, Floats, Floats]:
    """Return the lags at which blocks begin and the last one ends, widths and middles of them.

    White and flicker PM have a spike at every whole tau, of the width of one sample. A block grows
    with its distance from the nearest whole tau, an eighth of it, which leaves an error below 1e-3.
    """
    count = int(np.ceil(reach * span))
    if count <= _ONE_BY_ONE:
        edge = np.arange(1.0, count + 2.0)
    else:
        away = [1.0]
        while away[-1] < span / 2:
            away.append(away[-1] + np.ceil(away[-1] / 8))
        half = np.array([0.0, *away[:-1]])
        knots = [
            np.concatenate([k * span + half, (k + 1) * span - half[::-1]])
            for k in range(int(np.ceil(reach)))
        ]
        edge = np.unique(np.concatenate(knots).round())
        edge = edge[(edge >= 1) & (edge <= count + 1)]
    width = np.diff(edge)
    return edge, width, edge[:-1] + (width - 1) / 2


def difference_edf(
    alpha: ArrayLike,
    m: ArrayLike,
    n: ArrayLike,
    stride: ArrayLike,
    order: int,
    *,
    modified: bool = False,
    sampled: bool = True,
) -> Floats:
    """Return the degrees of freedom of a variance made of differences of the phase.

    Parameters
    ----------
    alpha : array_like of int
        Power law of the rate; ``alpha + 2 order > 1`` or the variance does not exist.
    m : array_like of int
        Averaging factor.
    n : array_like of int
        Number of rate samples (one less than phases).
    stride : array_like of int
        Step between terms in samples.
    order : {1, 2, 3}
        1 first difference, 2 Allan, 3 Hadamard.
    modified : bool
        True when the phase is averaged over m first (MVAR, TVAR).
    sampled : bool
        Noise of a running sum of samples; False for Greenhall and Riley's phase, which is averaged
        over one sample: at m = 1 that promises a fifth too much for white FM.

    Examples
    --------
    Full overlap doubles what white FM is worth; terms at every fourth of tau nearly keep it:

    >>> difference_edf(0, 16, 4096, [16, 4, 1], order=2).round().tolist()
    [170.0, 354.0, 380.0]
    """
    alpha, m, n, stride = np.broadcast_arrays(alpha, m, n, stride)
    if np.any(alpha + 2 * order <= 1):
        raise ValueError(f"a difference of order {order} does not converge for alpha {alpha.min()}")
    length = m * order + (m if modified else 1)
    terms = 1 + (n + 1 - length) // stride
    edf, at = np.zeros(m.shape), terms >= 1

    def summed(law: Ints, factor: Floats, step: Ints, count: Floats) -> Floats:
        return 1.0 / _overlap(law, law, factor, step, count, order, modified, sampled)

    edf[at] = _by_neighbours(summed, m[at], stride[at], terms[at], alpha[at])
    return edf


def difference_overlap(
    alpha: ArrayLike,
    beta: ArrayLike,
    m: ArrayLike,
    n: ArrayLike,
    stride: ArrayLike,
    order: int,
    *,
    modified: bool = False,
) -> Floats:
    """Return what a pair of noises adds to 1 / edf of their sum, over the product of their shares.

    Of a sum of independent noises the autocorrelation is the mean of theirs by their shares ``p``
    of the variance, so ``1/edf = sum_ij p_i p_j c_ij`` with::

        c_ij = sum_{|k| < M} (1 - |k|/M) rho_i(k) rho_j(k) / M

    which is 1 / edf of one noise for i = j. White noise and a random run, whose terms are
    correlated with opposite signs, scatter less together than either alone.

    Parameters
    ----------
    alpha, beta : array_like of int
        Power laws of the rate.
    m, n, stride, order, modified
        As for `difference_edf`.

    Examples
    --------
    >>> both = difference_overlap([0, -4], [[0], [-4]], 64, 1024, 1, order=3)
    >>> alone = 1.0 / difference_edf([0, -4], 64, 1024, 1, 3)
    >>> (np.diag(both) / alone).round(6).tolist(), round(float(1.0 / np.mean(both)))
    ([1.0, 1.0], 20)
    """
    alpha, beta, m, n, stride = np.broadcast_arrays(alpha, beta, m, n, stride)
    length = m * order + (m if modified else 1)
    terms = np.maximum(1 + (n + 1 - length) // stride, 1)
    fast, slow = np.maximum(alpha, beta).ravel(), np.minimum(alpha, beta).ravel()

    def summed(first: Ints, second: Ints, factor: Floats, step: Ints, count: Floats) -> Floats:
        both = _overlap(first, second, factor, step, count, order, modified, sampled=True)
        return both * count

    found = _by_neighbours(
        summed, m.ravel(), stride.ravel(), terms.ravel(), fast, slow, straight=True
    )
    return np.asarray(found.reshape(m.shape) / terms)


def _overlap(
    alpha: Ints,
    beta: Ints,
    m: Floats,
    stride: Ints,
    terms: Floats,
    order: int,
    modified: bool,
    sampled: bool,
) -> Floats:
    """Return c_ij of pairs of noises, each at an averaging factor; 1 / edf of one."""
    laws = tuple(sorted({*alpha.tolist(), *beta.tolist()}))
    # So many lags count at most, of which the sums do not depend on the length of the run.
    reach = np.where(terms > np.ceil((order + 1) * m / stride), np.inf, terms)
    asked = list(zip(*(one.tolist() for one in (m, stride, reach)), strict=True))
    number = {one: i for i, one in enumerate(dict.fromkeys(asked))}
    which = np.array([number[one] for one in asked], np.int64)
    sums = [_sums_of_lags(*one, laws, order, modified, sampled) for one in number]
    of_pairs = np.array(sums).reshape(len(sums), 2, len(laws), len(laws))
    first, second = np.searchsorted(laws, [alpha, beta])
    total, moment = of_pairs[which, :, first, second].T
    return np.asarray((1.0 + 2.0 * (total - moment / terms)) / terms)


@lru_cache(maxsize=1 << 12)  # estimators of one family, and records of any length, ask the same
def _sums_of_lags(
    m: float,
    stride: int,
    reach: float,
    laws: tuple[int, ...],
    order: int,
    modified: bool,
    sampled: bool,
) -> Floats:
    """Return the sums of `LagSums` up to a lag, of each pair of noises, shape (2, laws, laws)."""
    span = m / stride
    averaged = modified and not (sampled and m == 1)
    edge, width, centre = _blocks(span, order + 1)
    width = width * np.clip((reach - edge[:-1]) / width, 0.0, 1.0)
    rho = np.array(
        [
            _correlation(
                law,
                span,
                _filter_width(law, int(m), span, averaged),
                order,
                sampled and not averaged,
            )
            for law in laws
        ]
    )
    # No product of matrices: how that adds up, to the last digit, depends on how many noises there
    # are, and on the processor.
    products = width * (rho[:, np.newaxis] * rho)
    return np.stack([products.sum(axis=-1), (centre * products).sum(axis=-1)])


def _by_neighbours(
    summed: Callable[..., Floats],
    m: Ints,
    stride: Ints,
    terms: Ints,
    *laws: Ints,
    straight: bool = False,
) -> Floats:
    """Return `summed` of laws at m, stride and so many terms; of large m from neighbours of it.

    With as many terms in a tau the degrees of freedom hardly depend on m, or (white PM) grow as it
    does: a straight line in the logarithms, or with `straight` in that of m alone. Every m of a
    record of 10^5 samples would take minutes.
    """
    near = m.astype(np.float64)
    far = np.flatnonzero((stride == 1) & (m > _SUMMED_ALONE) & (terms >= _FEW_TERMS))
    place = np.floor(_GRID * np.log2(m[far]))
    low, high = (np.round(2.0 ** ((place + k) / _GRID)) for k in (0, 1))
    between = (m[far] != low) & (m[far] != high)
    far, low, high = far[between], low[between], high[between]
    near[far] = low
    found = summed(*laws, near, stride, terms * near / m)
    if far.size:
        of_far = (law[far] for law in laws)
        first, last = found[far], summed(*of_far, high, stride[far], terms[far] * high / m[far])
        share = np.log(m[far] / low) / np.log(high / low)
        line = (1.0 - share) * first + share * last
        found[far] = line if straight else first ** (1.0 - share) * last**share
    return found


def calibrated_edf(
    kind: str, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, theory: ArrayLike
) -> Floats:
    """Return degrees of freedom by simulation where there are any, else those of theory.

    Parameters
    ----------
    kind : str
        Estimator.
    alpha, m, n : array_like of int
        As in `difference_edf`.
    theory : array_like
        Degrees of freedom by equations, which hold with more windows n / m than the table has.

    Notes
    -----
    Interpolated in the logarithms of n / m and n. Runs longer than the longest simulated have its
    degrees of freedom for alpha <= 0, which then depend on n / m alone, and more in proportion for
    phase noise. `benchmarks/calibrate_limits.py` writes the table.
    """
    alpha, m, n, theory = np.broadcast_arrays(alpha, m, n, np.asarray(theory, np.float64))
    edf = np.array(theory, np.float64)
    tables = _calibration()["edf"].get(kind, {})
    for name in tables:
        at = (alpha == alpha_named(name)) & (m > 1)
        if at.any():
            edf[at] = _interpolated(kind, name, m[at], n[at], edf[at])
    return edf


def calibrated_scale(kind: str, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> Floats:
    """Return the multiple of the degrees of freedom with which 95 % limits hold, by simulation.

    Parameters
    ----------
    kind, alpha, m, n
        As for `calibrated_edf`.

    Returns
    -------
    ndarray
        1 with more windows than were simulated, and where there is no table.

    Notes
    -----
    Near the end of the run a variance is a sum of a few squares of unequal size, and no chi-square
    of the degrees of freedom that its scatter has: its tails are lighter.
    """
    alpha, m, n = np.broadcast_arrays(alpha, m, n)
    scale = np.ones(m.shape)
    for name, table in _calibration()["scale"].get(kind, {}).items():
        at = (alpha == alpha_named(name)) & (m > 1) & (n / m <= table["windows"][-1])
        if at.any():
            scale[at] = 2.0 ** _between("scale", kind, name, n[at] / m[at], n[at])[0]
    return scale


@lru_cache(maxsize=1)
def _calibration() -> dict[str, dict[str, dict[str, dict[str, list[Any]]]]]:
    text = (Path(__file__).parent / "edf_calibration.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


@lru_cache(maxsize=256)
def _logarithms(column: str, kind: str, name: str) -> tuple[Floats, Floats, list[Floats]]:
    """Return the binary logarithms of windows, of lengths, and of a table at each length."""
    table = _calibration()[column][kind][name]
    rows = [np.log2(row) for row in table[column]]
    return np.log2(table["windows"]), np.log2(table["samples"]), rows


def _between(
    column: str, kind: str, name: str, windows: Floats, length: Ints
) -> tuple[Floats, Floats]:
    """Return the binary logarithm of a table there, shape (k,), and at each length of its runs."""
    known, lengths, rows = _logarithms(column, kind, name)
    at = np.log2(windows)
    at_each = np.stack([np.interp(at, known[: len(row)], row) for row in rows])
    place = np.interp(np.log2(length), lengths, np.arange(len(rows)))
    below = np.minimum(place.astype(np.int64), max(len(rows) - 2, 0))
    above = np.minimum(below + 1, len(rows) - 1)
    share, cell = place - below, np.arange(at.size)
    return (1.0 - share) * at_each[below, cell] + share * at_each[above, cell], at_each


def _interpolated(kind: str, name: str, m: Ints, n: Ints, theory: Floats) -> Floats:
    """Return the degrees of freedom of some cells."""
    table, (_, lengths, _) = _calibration()["edf"][kind][name], _logarithms("edf", kind, name)
    found, columns = _between("edf", kind, name, n / m, n)
    length = np.log2(n)
    if alpha_named(name) > 0:
        slope = (columns[-1] - columns[0]) / (lengths[-1] - lengths[0])
        further = columns[-1] + np.maximum(slope, 0.0) * (length - lengths[-1])
        found = np.where(length > lengths[-1], further, found)
    # With more windows than runs of this length were simulated with, theory goes on, but not below
    # what is known.
    most = np.array([table["windows"][len(row) - 1] for row in table["edf"]])
    row = np.maximum(np.searchsorted(lengths, length, side="right") - 1, 0)
    edf = 2.0**found
    return np.where(n / m > most[row], np.maximum(theory, edf), edf)


def small_factor_loss(alpha: ArrayLike, m: ArrayLike, n: ArrayLike, order: int) -> Floats:
    """Return edf at `m` / edf at large m for the same n / m: what coarse sampling costs.

    Published degrees of freedom of TOTVAR hold for large m; this carries them to small m.
    """
    m, n = np.asarray(m), np.asarray(n)
    many = np.maximum(m, 64)
    at_m = difference_edf(alpha, m, n, 1, order)
    at_many = difference_edf(alpha, many, n * (many / m), 1, order)
    return np.where(at_many > 0, at_m / np.where(at_many > 0, at_many, 1.0), 1.0)


def _filter_width(alpha: int, m: int, span: float, modified: bool) -> float:
    """Return F of Greenhall and Riley, or one of the same rho that more m have in common."""
    if modified:
        return 1.0
    if alpha == 2:
        return span
    return np.inf if alpha <= 0 and m > 100 else float(m)


@lru_cache(maxsize=4096)
def _correlation(alpha: int, span: float, width: float, order: int, sampled: bool) -> Floats:
    """Return rho in the middle of each block: that of a noise, which every pair with it needs."""
    lags = np.append(0.0, _blocks(span, order + 1)[2] / span)
    covariance = difference_autocovariance(lags, width, alpha, order, sampled=sampled)
    return np.asarray(covariance[1:] / covariance[0])


def difference_autocovariance(
    lag: Floats, width: float, alpha: int, order: int, *, sampled: bool = False
) -> Floats:
    """Return s_z, up to a factor that depends on alpha and tau only.

    Parameters
    ----------
    lag : ndarray
        Lag in units of tau.
    width : float
        F: m for a plain variance, 1 for a modified one, ``inf`` for the limit of large m (then
        ``alpha <= 0``, and the factor is another one).
    alpha : int
        Power law of the rate, 2 (white PM) to -4.
    order : {1, 2, 3}
        Order of the difference.
    sampled : bool
        As in `difference_edf`.

    Examples
    --------
    Neighbouring Allan terms that share one average of white FM are anticorrelated by one half:

    >>> s = difference_autocovariance(np.array([0.0, 1.0, 2.0]), np.inf, 0, 2)
    >>> (s / s[0]).tolist()
    [1.0, -0.5, 0.0]
    """
    middle, *sides = _BINOMIAL[order]
    phase = sampled_autocovariance if sampled else phase_autocovariance
    shifts = np.arange(-order, order + 1.0)[:, np.newaxis]
    at = phase(lag + shifts, width, alpha)
    total = middle * at[order]
    for k, weight in enumerate(sides, start=1):
        total += weight * (at[order - k] + at[order + k])
    return np.asarray(total)


def phase_autocovariance(lag: Floats, width: float, alpha: int) -> Floats:
    """Return s_x, with arguments as for `difference_autocovariance`."""
    if np.isinf(width):
        if alpha > 0:
            raise ValueError("phase noise needs a bandwidth: give a finite width")
        return _power(lag, alpha + 2)
    step = 1.0 / width
    exact = width**2 * (
        2.0 * _power(lag, alpha) - _power(lag - step, alpha) - _power(lag + step, alpha)
    )
    if alpha != 1 or width < _FAR:
        return exact
    # F^2 times a difference of nearly equal numbers loses every digit for large F: far from the
    # spike at 0 use the second derivative of t^2 log|t| instead.
    far = np.abs(lag) * width > _FAR
    return np.where(far, -(2.0 * np.log(np.where(far, np.abs(lag), 1.0)) + 3.0), exact)


def sampled_autocovariance(lag: Floats, width: float, alpha: int) -> Floats:
    """Return s_x of a running sum of samples, with arguments as for `difference_autocovariance`.

    White PM is as in `phase_autocovariance`.
    """
    if alpha == 2 or np.isinf(width):
        return phase_autocovariance(lag, width, alpha)
    from scipy.special import digamma

    j = np.abs(lag) * width
    growing = j if alpha % 2 == 0 else 0.5 * (digamma(j + 0.5) - digamma(0.5))
    return np.asarray(_POLYNOMIALS[alpha](j**2) * growing)


_POLYNOMIALS: dict[int, Callable[[Floats], Floats | float]] = {
    1: lambda _: -1.0,
    0: lambda _: -1.0,
    -1: lambda square: square / 2.0 - 0.125,
    -2: lambda square: square - 1.0,
    -3: lambda square: -(square - 0.25) * (square - 2.25),
    -4: lambda square: -(square - 1.0) * (square - 4.0),
}
"""Of the square of the lag in samples: factors of the lag itself or of its digamma function."""


def _power(lag: Floats, alpha: int) -> Floats:
    size = np.abs(lag)
    if alpha % 2 == 0:
        return -size if alpha == 2 else size ** (3 - alpha)
    return size ** (3 - alpha) * np.log(np.where(size > 0, size, 1.0))
