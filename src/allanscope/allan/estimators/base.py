"""What every estimator of the Allan family has in common, its two plain families, and the table.

An estimator turns the phase ``x`` of one axis into a variance at one averaging factor ``m``. Phase
is the running sum of the rates with ``x[0] = 0``, one value more than there are rates, in units of
data times samples (tau0 = 1)::

    x[i] = y[0] + ... + y[i - 1],     w[i] = (x[i + m] - x[i]) / m    mean of m rates

Adding an estimator means adding a file to this folder: a subclass of `Estimator` under `register`.
Most terms are a difference of the phase (`DifferenceEstimator`); the ordinary variance is one of
plain averages (`AverageEstimator`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import (
    calibrated_scale,
    difference_autocovariance,
    difference_edf,
    difference_overlap,
)
from allanscope.allan.noise_type import ALPHAS, Family, NoiseTypes, lagged_phase
from allanscope.compiled import Pointer, kernel

__all__ = [
    "REGISTRY",
    "AverageEstimator",
    "DifferenceEstimator",
    "Estimator",
    "Sums",
    "estimator_named",
    "mean_square_second",
    "mean_square_third",
    "register",
]

_MOST_POSITIONS = 256
_UNEQUAL = 1.25
"""Degrees of freedom of limits over those of the scatter, by `interval_coverage`."""


@dataclass(frozen=True, slots=True)
class Sums:
    """Variances and how many squares went into each: all that confidence needs.

    Attributes
    ----------
    m : ndarray of int64, shape (k,)
        Averaging factors in samples, ascending.
    variance : ndarray of float64, shape (k,) or (axes, k)
        Variances, (unit of the data)^2; the time variances (TVAR, TTOTVAR) in (unit x samples)^2.
        NaN where there is none.
    terms : ndarray of int64, same shape as `variance`
        Number of squared terms in each mean.
    stride : ndarray of int64, shape (k,)
        Step between successive terms in samples: 1 for full overlap, m for none, 2^L in level L of
        the cascade.
    n : int
        Number of rate samples in the run.
    segments, covered : ndarray of int64, shape (k,), optional
        Where the run has gaps: how many of its unbroken stretches have a term at each m, and how
        many samples they have together.
    """

    m: NDArray[np.int64]
    variance: NDArray[np.float64]
    terms: NDArray[np.int64]
    stride: NDArray[np.int64]
    n: int
    segments: NDArray[np.int64] | None = None
    covered: NDArray[np.int64] | None = None


class Estimator(ABC):
    """One variance of the Allan family, on one axis and one averaging factor at a time.

    Attributes
    ----------
    name : str
        Name of the deviation, e.g. ``"oadev"``: the key in `REGISTRY`.
    variance_name : str
        Name of its square in DT0064, e.g. ``"OAVAR"``.
    tau_factor : float
        tau = tau_factor * m / rate; 0.75 for the Theo family, else 1.
    trust_fraction : float
        Part of the run up to which the limits hold: tau <= trust_fraction * duration. That of
        DT0064, or less where noises that meet have the limits hold in fewer than 91 %.
    min_terms : int
        Fewest terms with which a value is given at all.
    lowest_alpha : int
        Steepest power law for which the variance converges; steeper ones are treated as this one.
    even : bool
        True when m must be even.
    time : bool
        True when the deviation is in (unit of the data) x s.
    hadamard : bool
        True when the variance has a factor of 1/6 that DT0064 gives as 1/2.
    family : {'avar', 'mvar', 'hvar'}
        Variance that it is an estimate of: it says how much each of several noises has in it.
    reflects : bool
        True when each unbroken stretch is reflected at its ends, for a bias that is the larger the
        shorter the stretch.
    calibrated_as : str
        Estimator whose limits are calibrated by simulation; ``""`` for its own name.
    derived_from : str
        Estimator of which this one is a multiple by `factor`, or ``""``.
    """

    name: ClassVar[str]
    variance_name: ClassVar[str]
    tau_factor: ClassVar[float] = 1.0
    trust_fraction: ClassVar[float] = 0.1
    min_terms: ClassVar[int] = 2
    lowest_alpha: ClassVar[int] = -2
    even: ClassVar[bool] = False
    time: ClassVar[bool] = False
    hadamard: ClassVar[bool] = False
    family: ClassVar[Family] = "avar"
    reflects: ClassVar[bool] = False
    calibrated_as: ClassVar[str] = ""
    derived_from: ClassVar[str] = ""

    @abstractmethod
    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of terms, by definition and from every term there is.

        Parameters
        ----------
        phase : ndarray of float64, shape (n + 1,)
            Phase of one axis, tau0 = 1.
        m : int
            Averaging factor.

        Returns
        -------
        variance : float
            As in `Sums`; NaN when there is no term.
        terms : int
            Number of terms, 0 when the record is too short.
        """

    def curve(self, phase: NDArray[np.float64], factors: Iterable[int]) -> list[tuple[float, int]]:
        """Return `exact` for each of several ascending m, sharing work where there is any."""
        return [self.exact(phase, m) for m in factors]

    @abstractmethod
    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the equivalent degrees of freedom (arguments broadcast).

        Parameters
        ----------
        alpha : array_like of int
            Exponent of the power law of the rate, S_y ~ f^alpha: 2 white PM ... -4.
        m, n, stride : array_like of int
            As in `Sums`.
        """

    @abstractmethod
    def needed(self, m: int) -> int:
        """Return how many rate samples give `min_terms` terms at averaging factor `m`."""

    def admits(self, m: int, n: int) -> bool:
        """Return whether `m` is an averaging factor of this estimator in a run of `n` samples."""
        return m >= 1 and not (self.even and m % 2)

    def tau(self, m: ArrayLike, n: int) -> NDArray[np.float64]:
        """Return the averaging time in samples that goes with `m` in a run of `n` samples."""
        return self.tau_factor * np.asarray(m, np.float64)

    def exact_stride(self, m: int) -> int:
        """Return the step between the terms of `exact`: 1, or m for those that do not overlap."""
        return 1

    def limit_scale(
        self, noise: NoiseTypes, m: NDArray[np.int64], n: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return what the degrees of freedom are multiplied by for limits of an unbroken run.

        Parameters
        ----------
        noise, m, n
            As for `of_mixture`.
        """
        name = self.calibrated_as or self.name
        shares = noise.shares(self.family, self.tau(m, int(np.max(n))))
        present, law = self._present(shares)
        scale = calibrated_scale(name, law[:, np.newaxis], m, n).T
        return np.asarray((shares[..., present] * scale).sum(axis=-1))

    def _present(self, share: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return which noises have any share, shape (..., 7), and their power laws, each (j,)."""
        present = np.flatnonzero(share.any(axis=tuple(range(share.ndim - 1))))
        return present, np.maximum(np.array(ALPHAS)[present], self.lowest_alpha)

    def trusts(self, noise: NoiseTypes, tau: ArrayLike, n: int) -> NDArray[np.bool_]:
        """Return whether limits hold the truth at `tau` samples of a run of `n`, shape (k,).

        `noise` is that at `tau`, which few ask for: see `TheoBR`; then the shape is that of its
        labels.
        """
        return np.asarray(tau) <= self.trust_fraction * n

    def factor(self, m: ArrayLike) -> NDArray[np.float64]:
        """Return this variance / the variance of `derived_from`, for tau0 = 1."""
        return np.ones(np.shape(m))

    def correction(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return what a corrected variance is divided by: the customary, published bias."""
        return np.ones(np.broadcast_shapes(np.shape(alpha), np.shape(m), np.shape(n)))

    def uncorrected_bias(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return raw / true variance that `correction` leaves in, as is customary: see `Totdev`."""
        return np.ones(np.broadcast_shapes(np.shape(alpha), np.shape(m), np.shape(n)))

    def expectation(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return raw / true variance as well as it is known; the limits allow for it."""
        return np.ones(np.broadcast_shapes(np.shape(alpha), np.shape(m), np.shape(n)))

    def passed(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return raw / true variance of one noise, up to what all noises of a record share.

        Raw THEO1 is its own expectation, and passes of each noise what its bias says.
        """
        expected = self.expectation(alpha, m, n)
        return np.where(expected == 1.0, self.uncorrected_bias(alpha, m, n), expected)

    def of_mixture(
        self, noise: NoiseTypes, m: NDArray[np.int64], n: NDArray[np.int64], stride: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return degrees of freedom, expectation and left-in bias for several noises at once.

        Parameters
        ----------
        noise : NoiseTypes
            Labels and levels.
        m, n, stride : array_like of int, shape (k,)
            As in `edf`.

        Returns
        -------
        edf, expectation, bias : ndarray, shape (k,) or (axes, k)
            `expectation` as the method of that name, `bias` as `uncorrected_bias`.

        Notes
        -----
        Expectations add up; degrees of freedom as in `_pooled`.
        """
        tau = self.tau(m, int(np.max(n)))
        shares = noise.shares(self.family, tau)
        present, known = self._present(shares)
        share, law = shares[..., present], known[:, np.newaxis]
        edf = np.maximum(self.edf(law, m, n, stride), 1.0).T
        ratio, left = self.expectation(law, m, n).T, self.uncorrected_bias(law, m, n).T
        weight = share * self.passed(law, m, n).T
        raw = weight / weight.sum(axis=-1, keepdims=True)
        at = np.maximum(tau.round().astype(np.int64), 1)
        alike = _likeness(self.family, known, edf, raw, at, n, stride)
        return _pooled(edf, raw, alike), (share * ratio).sum(axis=-1), (share * left).sum(axis=-1)


def _pooled(
    edf: NDArray[np.float64], share: NDArray[np.float64], alike: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the degrees of freedom of a sum of noises, each with a share of it, both (..., j).

    Variances of a variance add up with the products of all pairs, of which each counts as much as
    its noises are `alike`, shape (..., j, j): see `_likeness`.
    """
    scatter = share / np.sqrt(edf)
    return np.asarray(1.0 / np.einsum("...i,...j,...ij->...", scatter, scatter, alike))


def _likeness(
    family: Family,
    alphas: NDArray[np.int64],
    edf: NDArray[np.float64],
    share: NDArray[np.float64],
    m: NDArray[np.int64],
    n: NDArray[np.int64],
    stride: ArrayLike,
) -> NDArray[np.float64]:
    """Return how much of their scatter the terms of two noises have in common, shape (..., j, j).

    ``c_ij / sqrt(c_ii c_jj)`` of `difference_overlap`: exactly, of the plain overlapping variance
    of the family; totals and the Theo family see the same noises through windows much like its own.
    Flicker PM and white FM have nearly 1, white FM and a random run a third.

    Beside phase noise the share of a slower one is badly known, and its scatter many times as
    large: there no pair counts less than the fourth root of the ratio of their degrees of freedom.

    Parameters
    ----------
    family : {'avar', 'mvar', 'hvar'}
        Variance.
    alphas : ndarray of int64, shape (j,)
        Power laws.
    edf : ndarray, shape (k, j)
        Degrees of freedom of each.
    share : ndarray, shape (k, j) or (axes, k, j)
        Their shares; of pairs with next to none nothing is asked.
    m, n, stride : ndarray of int64, shape (k,)
        As in `Sums`, m at tau; beyond a quarter of the run that at a quarter.
    """
    order, modified = (3 if family == "hvar" else 2), family == "mvar"
    step = np.broadcast_to(np.asarray(stride, np.int64), m.shape)
    near = np.where(m > _EVERY_FACTOR, np.exp2(np.round(_PER_OCTAVE * np.log2(m)) / _PER_OCTAVE), m)
    near = np.maximum(np.minimum(near.round().astype(np.int64), n // 4), 1)
    step = np.where(step >= m, near, np.minimum(step, near))
    alike = np.ones((*share.shape, len(alphas)))
    long = n >= _FEWEST_LONG
    one, other = np.tril_indices(len(alphas))
    law = alphas[:, np.newaxis]
    pairs = difference_overlap(
        law[one], law[other], near[long], n[long], step[long], order, modified=modified
    )
    alone = pairs[one == other]
    for i, j, both in zip(one.tolist(), other.tolist(), pairs, strict=True):
        if i == j:
            continue
        together = both / np.sqrt(alone[i] * alone[j])
        if max(alphas[i], alphas[j]) > 0:
            ratio = edf[long, i] / edf[long, j]
            together = np.maximum(together, np.minimum(ratio, 1.0 / ratio) ** 0.25)
        counts = share[..., long, i] * share[..., long, j] > _SMALL_SHARES
        alike[..., long, i, j] = alike[..., long, j, i] = np.where(counts, together, 1.0)
    return alike


_EVERY_FACTOR, _PER_OCTAVE = 32, 8
"""What noises have in common changes slowly with m: beyond 32 it is that of the nearest of eight in
an octave."""
_SMALL_SHARES = 1e-3
_FEWEST_LONG = 16


REGISTRY: dict[str, Estimator] = {}
"""Every estimator by name, filled when `allanscope.allan.estimators` is imported."""

E = TypeVar("E", bound=type[Estimator])


def register(cls: E) -> E:
    """Enter an estimator in `REGISTRY` under its name."""
    REGISTRY[cls.name] = cls()
    return cls


def estimator_named(name: str) -> Estimator:
    """Return an estimator by name; ValueError, with all names, when there is none."""
    try:
        return REGISTRY[name]
    except (KeyError, TypeError):
        choices = " ".join(sorted(REGISTRY))
        raise ValueError(f"unknown estimator {name!r}; choose one of {choices}") from None


class DifferenceEstimator(Estimator):
    """Mean square of a difference of the phase at lag m, over ``2 m^2`` or ``6 m^2``.

    Attributes
    ----------
    order : {2, 3}
        2 for the Allan family, blind to an offset of the rate; 3 for Hadamard, blind to a drift.
    overlap : bool
        True when terms start at every sample, False when only at every m-th.
    """

    order: ClassVar[int] = 2
    overlap: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of terms."""
        stride = self.exact_stride(m)
        if self.order == 2:
            mean, terms = mean_square_second(phase, m, stride)
            return mean / (2.0 * m**2), terms
        mean, terms = mean_square_third(phase, m, stride)
        return mean / (6.0 * m**2), terms

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the equivalent degrees of freedom after Greenhall and Riley."""
        return difference_edf(alpha, m, n, stride, order=self.order)

    def needed(self, m: int) -> int:
        """Return how many rate samples give `min_terms` terms."""
        return self.order * m + (self.min_terms - 1) * self.exact_stride(m)

    def exact_stride(self, m: int) -> int:
        """Return the step between terms."""
        return 1 if self.overlap else m


# Compiled, because an array expression would walk through memory four times for each tau.


_SUM = (Pointer(np.float64, 1), int, int, int)
_second = kernel("squares_of_second", *_SUM, returns=float)
_third = kernel("squares_of_third", *_SUM, returns=float)


def mean_square_second(x: NDArray[np.float64], m: int, stride: int) -> tuple[float, int]:
    """Return the mean of ``(x[i] - 2 x[i+m] + x[i+2m])^2``, i = 0, stride, ..., and its terms."""
    terms = len(range(0, x.size - 2 * m, stride))
    total = _second(np.ascontiguousarray(x, np.float64), x.size, m, stride)
    return (total / terms if terms else np.nan), terms


def mean_square_third(x: NDArray[np.float64], m: int, stride: int) -> tuple[float, int]:
    """Return the mean of ``(x[i] - 3 x[i+m] + 3 x[i+2m] - x[i+3m])^2`` likewise."""
    terms = len(range(0, x.size - 3 * m, stride))
    total = _third(np.ascontiguousarray(x, np.float64), x.size, m, stride)
    return (total / terms if terms else np.nan), terms


class AverageEstimator(Estimator):
    """Sample variance of the means ``w`` of m rates: ``sum (w - mean(w))^2 / (terms - 1)``.

    Attributes
    ----------
    overlap : bool
        True when means start at every sample, False when only at every m-th.

    Notes
    -----
    For flicker and steeper noise it has no limit: it grows with the run, as its mean wanders.
    """

    overlap: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of means."""
        means = (phase[m:] - phase[:-m])[:: self.exact_stride(m)] / m
        if means.size < 2:
            return np.nan, means.size
        means = means - means.mean()
        return float(means @ means) / (means.size - 1), means.size

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom, less what the mean of the run takes."""
        alpha, m, n, stride = np.broadcast_arrays(alpha, m, n, stride)
        spans = n / m
        stationary = difference_edf(np.maximum(alpha, 0), m, n, stride, order=1)
        edf = np.array(stationary * (1.0 - 1.0 / np.maximum(spans, 1.0)))
        slow = (alpha < 0) & (spans >= 2)
        quarters = np.round(4.0 * np.log2(spans[slow])).astype(np.int64)
        asked = zip(alpha[slow].tolist(), quarters.tolist(), strict=True)
        edf[slow] = [_wandering_edf(*one) for one in asked]
        return edf

    def of_mixture(
        self, noise: NoiseTypes, m: NDArray[np.int64], n: NDArray[np.int64], stride: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return them with the shares that the noises have in this variance, not in AVAR.

        Slow noise has a share that only the run limits. Of it the variance is a few squares of
        unequal size, and 95 % limits hold with a quarter more than its degrees of freedom.
        """
        whole = int(np.max(n))
        steps = np.broadcast_to(np.asarray(stride, np.int64), m.shape)
        share = noise.shares_of(_unit_spread(m, whole, steps), m.size)
        present, known = self._present(share)
        share, law = share[..., present], known[:, np.newaxis]
        unequal = np.where(law < 0, _UNEQUAL, 1.0)
        edf = (unequal * np.maximum(self.edf(law, m, n, stride), 1.0)).T
        pooled = _pooled(edf, share, _likeness(self.family, known, edf, share, m, n, stride))
        return pooled, np.ones(pooled.shape), np.ones(pooled.shape)

    def trusts(self, noise: NoiseTypes, tau: ArrayLike, n: int) -> NDArray[np.bool_]:
        """Return False: a random walk that the record hardly shows makes most of this variance.

        In white FM beside one, of one AVAR at a 16th of the run, the limits hold in 70 to 86 %.
        """
        return np.zeros(np.broadcast_shapes(np.shape(noise.alpha), np.shape(tau)), np.bool_)

    def needed(self, m: int) -> int:
        """Return how many rate samples give `min_terms` means."""
        return m + (self.min_terms - 1) * self.exact_stride(m)

    def exact_stride(self, m: int) -> int:
        """Return the step between means."""
        return 1 if self.overlap else m


def _unit_spread(m: NDArray[np.int64], n: int, stride: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the expected standard variance of white PM to random walk FM of unit level, (k, 5).

    The mean over all pairs of means, the squared difference of two that lie d samples apart being
    a second difference of the phase; of many pairs over some positions.
    """
    count = np.maximum((n - m) // stride + 1, 2)
    spread = np.linspace(1, count - 1, _MOST_POSITIONS, axis=-1).round()
    every = np.arange(1.0, _MOST_POSITIONS + 1)
    index = np.where(count[:, np.newaxis] > _MOST_POSITIONS, spread, every)
    weight = np.maximum(count[:, np.newaxis] - index, 0.0)
    span, apart = m[:, np.newaxis], index * stride[:, np.newaxis]
    still, away = lagged_phase(np.zeros(1)), lagged_phase(m.astype(np.float64))
    here, before, after = map(lagged_phase, (apart, np.abs(apart - span), apart + span))
    squares = 2.0 * (2.0 * (still - away)[..., np.newaxis] - 2.0 * here + before + after)
    mean = (squares * (weight / weight.sum(axis=-1, keepdims=True))).sum(axis=-1)
    return np.asarray((mean / (2.0 * m.astype(np.float64) ** 2)).T)


@lru_cache(maxsize=1024)
def _wandering_edf(alpha: int, quarter_octaves: int) -> float:
    """Return ``tr(C)^2 / tr(C^2)``, C being the covariance of the means less their own mean.

    For such noise the slowest part of the run makes most of the variance, so a few hundred
    positions stand for all of them, and the number of degrees is small however long the run. It
    changes slowly with n / m, hence the steps of a quarter octave.
    """
    lag = np.linspace(0.0, 2.0 ** (quarter_octaves / 4.0) - 1.0, _MOST_POSITIONS)
    place = np.arange(_MOST_POSITIONS)
    apart = np.abs(place[:, np.newaxis] - place)
    covariance = difference_autocovariance(lag, np.inf, alpha, 1)[apart]
    rows = covariance.mean(axis=0)
    covariance = covariance - rows - rows[:, np.newaxis] + rows.mean()
    return float(np.trace(covariance) ** 2 / np.sum(covariance**2))
