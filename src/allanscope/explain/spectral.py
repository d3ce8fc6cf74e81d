r"""The whitening domain: noise as variances of DCT ordinates, fitted by Whittle likelihood.

The orthonormal DCT-II of a series makes white noise plus a random walk exactly diagonal, flicker
and Gauss-Markov noise nearly so. Ordinate k (k = 1 .. n-1, f_k = k rate / 2n) has the variance

.. math:: \lambda_k = N^2 f_s |H|^2 + \frac{B^2 c_k}{s_k} + \frac{K^2}{f_s s_k^2}
          + \sum_j \sigma_j^2 g_j(f_k) + q^2/12, \qquad s_k = 2 \sin(\pi k / 2n)

which is linear in the variances. They are found by Fisher scoring on log-spaced bins (a bin of n_b
ordinates is chi-square with n_b degrees of freedom), each step a non-negative least squares
(`nonnegative_scoring`): a fraction of a millisecond a fit, so that every candidate effect can
afford a joint refit of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.grid import Grid
from allanscope.explain.nonnegative_scoring import maximise
from allanscope.explain.once import once

__all__ = ["Design", "Spectrum", "Term", "binned_power", "fit_spectrum", "response"]

Array = NDArray[np.float64]

_POINTS = 2048
"""Frequencies over which a response is averaged."""
_SIMPSON = np.array([1, 4, 2, 4, 1]) / 12


@dataclass(frozen=True)
class Term:
    """A stationary process of an effect in the spectrum of one axis.

    Attributes
    ----------
    kind : str
        Effect it belongs to.
    role : {'adds', 'shapes', 'excludes'}
        Adds ``sigma^2 shape(f)`` to the spectrum; multiplies the white part (a filter: all textbook
        terms) with ``shape(f)``; or takes the frequencies where ``shape(f)`` is 0 out of the fit.
    nonlinear : tuple of float
        Parameters of the shape.
    shape : callable
        ``shape(frequency, rate_hz, nonlinear)``: variance of an ordinate of the process with unit
        variance, or the factor.
    narrow : bool
        True when the shape changes within a bin.
    """

    kind: str
    role: str
    nonlinear: tuple[float, ...]
    shape: Callable[[Array, float, tuple[float, ...]], Array]
    narrow: bool = False

    def at_bins(self, grid: Grid) -> Array:
        """Evaluate the shape for every bin: its mean, or at the centre where that is as good."""
        return _at_bins(self, grid)

    def at(self, grid: Grid, frequency: Array) -> Array:
        """Evaluate the shape."""
        return self.shape(frequency, grid.rate_hz, self.nonlinear)


@lru_cache(maxsize=64)
def _at_bins(term: Term, grid: Grid) -> Array:
    if term.narrow:
        return grid.bin_means(term.at(grid, grid.frequency))
    if term.role != "shapes":
        return term.at(grid, grid.centre)
    # Towards Nyquist a filter falls by orders of magnitude within a bin: Simpson's rule.
    low = grid.frequency[grid.edges]
    high = grid.frequency[np.append(grid.edges[1:] - 1, grid.n - 2)]
    share = np.linspace(0, 1, len(_SIMPSON))[:, np.newaxis]
    values = term.at(grid, (low + share * (high - low)).ravel()).reshape(len(_SIMPSON), -1)
    return np.asarray(_SIMPSON @ values)


@dataclass(frozen=True)
class Spectrum:
    """A fitted noise spectrum.

    Attributes
    ----------
    variances : dict
        ``N``, ``B``, ``K`` (and ``Q``) squared, then ``sigma^2`` of every adding term by position.
    loglik : float
        Whittle log-likelihood at the maximum.
    """

    grid: Grid
    base: str
    terms: tuple[Term, ...]
    floor: float
    variances: Array
    loglik: float
    information: Array = field(repr=False)

    def first(self, m: int) -> Array:
        """Variances of the first m ordinates."""
        frequency = self.grid.frequency[:m]
        return self._sum({w: unit[:m] for w, unit in self.grid.textbook_all.items()}, frequency)

    def at(self, frequency: Array) -> Array:
        """Variance of a DCT ordinate at given frequencies (two-sided density times the rate)."""
        return self._sum(self.grid.textbook(self.base, frequency), frequency)

    def _sum(self, units: dict[str, Array], frequency: Array) -> Array:
        total = np.full_like(frequency, self.floor)
        for letter, variance in zip(self.base, self.variances, strict=False):
            total += variance * units[letter] * response(
                _shaping(letter, self.terms), self.grid.rate_hz,
                lambda term: term.at(self.grid, frequency),
            )  # fmt: skip
        adding = [t for t in self.terms if t.role == "adds"]
        for term, variance in zip(adding, self.variances[len(self.base) :], strict=True):
            total += variance * term.at(self.grid, frequency)
        return total

    @once
    def ordinates(self) -> Array:
        """Variance of every ordinate, shape (n - 1,)."""
        return self._sum(self.grid.textbook_all, self.grid.frequency)

    @once
    def kept(self) -> NDArray[np.bool_]:
        """Ordinates that take part in the fit."""
        return _kept(self.grid, _excluding(self.terms))

    @once
    def covariance(self) -> Array:
        """Covariance of the variances from the Fisher information."""
        return np.asarray(np.linalg.pinv(self.information, hermitian=True))

    def variance_of(self, letter: str) -> float:
        """Return the fitted N^2, B^2, K^2 or Q^2."""
        return float(self.variances[self.base.index(letter)]) if letter in self.base else 0.0

    def sigma_of(self, term: Term) -> tuple[float, float]:
        """Return the standard deviation of an adding term and its standard error."""
        adding = [t for t in self.terms if t.role == "adds"]
        index = len(self.base) + adding.index(term)
        sigma = float(np.sqrt(self.variances[index]))
        error = float(np.sqrt(max(self.covariance[index, index], 0.0)))
        return sigma, error / (2 * max(sigma, 1e-300))

    @property
    def design(self) -> Design:
        """The columns that were fitted."""
        return _design(self.grid, self.base, self.terms)

    def loglik_of(self, power: Array) -> float:
        """Log-likelihood of other binned power (mean square ordinates) under this spectrum."""
        design = self.design
        return _loglik(
            power, design.count, design.fixed(self.floor) + design.basis @ self.variances
        )


@dataclass(frozen=True)
class Design:
    """The fit as linear least squares: columns of unit variance, and ordinates in each bin."""

    basis: Array
    count: Array

    def fixed(self, floor: float) -> Array:
        """Return what is in every bin whatever is fitted."""
        return np.full(len(self.count), floor)


def _shaping(letter: str, terms: tuple[Term, ...]) -> list[Term]:
    """Return the factors on a textbook term: a filter acts on all, repeated rows on N alone."""
    return [t for t in terms if t.role == "shapes" and (letter == "N" or t.kind == "band_limit")]


def response(terms: Iterable[Term], rate: float, at: Callable[[Term], Array]) -> Array:
    r"""Return the factor of filters and repeats on a spectrum.

    Filters multiply. Rows that are held with probability d after a filter do not: of a process with
    the spectrum S and the variance :math:`\gamma` they are

    .. math:: P S + (\gamma - \gamma_P) L, \quad
              P = \frac{(1 - d)^2}{1 - 2 d \cos\omega + d^2}, \quad L = \frac{1 + d}{1 - d} P

    with :math:`\gamma_P` the variance of :math:`P S`: what is held makes white noise of its own,
    which no filter before it can take away. Of white noise that is L, the factor of `held`.

    Parameters
    ----------
    at : callable
        Value of a term at the frequencies in question.
    """
    factor: Array = np.ones(1)
    repeats = []
    filters = []
    for term in terms:
        if term.kind == "repeated_samples" and len(term.nonlinear) == 1:
            repeats.append(term)
        else:
            filters.append(term)
            factor = factor * at(term)
    if not repeats:
        return factor
    (held,) = repeats
    d = held.nonlinear[0]
    own = at(held)
    return np.asarray(factor * own * (1 - d) / (1 + d) + _taken(tuple(filters), held, rate) * own)


@lru_cache(maxsize=256)
def _taken(filters: tuple[Term, ...], held: Term, rate: float) -> float:
    """Variance that holding takes from white noise behind filters, and makes white again."""
    f = (np.arange(_POINTS, dtype=np.float64) + 0.5) * (rate / 2 / _POINTS)
    d = held.nonlinear[0]
    power: Array = 1 - held.shape(f, rate, held.nonlinear) * (1 - d) / (1 + d)
    for term in filters:
        power = power * term.shape(f, rate, term.nonlinear)
    return float(power.mean())


def _excluding(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    return tuple(t for t in terms if t.role == "excludes")


@lru_cache(maxsize=16)
def _kept(grid: Grid, excluding: tuple[Term, ...]) -> NDArray[np.bool_]:
    kept = np.ones(grid.n - 1, bool)
    for term in excluding:
        kept &= term.at(grid, grid.frequency) > 0
    return kept


@lru_cache(maxsize=64)
def _count(grid: Grid, excluding: tuple[Term, ...]) -> Array:
    """Ordinates of every bin that take part in the fit."""
    if not excluding:
        return grid.count
    return np.add.reduceat(_kept(grid, excluding).astype(np.float64), grid.edges)


def _design(grid: Grid, base: str, terms: tuple[Term, ...]) -> Design:
    columns = []
    for letter in base:
        factor = response(_shaping(letter, terms), grid.rate_hz, lambda t: t.at_bins(grid))
        columns.append(grid.textbook_bins[letter] * factor)
    columns += [t.at_bins(grid) for t in terms if t.role == "adds"]
    return Design(np.array(columns).T, _count(grid, _excluding(terms)))


def binned_power(grid: Grid, squares: Array, terms: tuple[Term, ...]) -> Array:
    """Mean square of the ordinates of every bin that take part in the fit."""
    excluding = _excluding(terms)
    if not excluding:
        return grid.bin_means(squares)
    total = np.add.reduceat(squares * _kept(grid, excluding), grid.edges)
    return np.asarray(total / np.maximum(_count(grid, excluding), 1.0))


def _loglik(power: Array, count: Array, variance: Array) -> float:
    return float(-0.5 * np.sum(count * (np.log(variance) + power / variance)))


def fit_spectrum(
    grid: Grid,
    power: Array,
    *,
    base: str = "NBK",
    terms: tuple[Term, ...] = (),
    floor: float = 0.0,
    start: Array | None = None,
) -> Spectrum:
    """Fit the variances to binned power by maximum Whittle likelihood, none negative.

    Parameters
    ----------
    power : ndarray, shape (bins,)
        Mean square of the ordinates in every bin (see `binned_power`).
    base : str
        Letters of the textbook terms.
    floor : float
        Known white variance per row that no filter shapes: the rounding to the step.
    """
    design = _design(grid, base, terms)
    theta, loglik, variance = maximise(design.basis.T, power, design.count, floor, start)
    scaled = design.basis.T * (np.sqrt(design.count / 2) / variance)
    return Spectrum(grid, base, terms, floor, theta, loglik, scaled @ scaled.T)
