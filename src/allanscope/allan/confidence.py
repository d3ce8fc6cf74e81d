"""From variances to deviations that say how far they can be trusted.

For Gaussian noise a variance estimate V with ``edf`` equivalent degrees of freedom is distributed
like ``sigma^2 chi2(edf) / edf``. Its two-sided limits at a given level are therefore (NIST SP 1065
eq. 45)::

    lower^2 = V edf / quantile((1 + level) / 2),    upper^2 = V edf / quantile((1 - level) / 2)

They are not symmetric: with one degree of freedom and 95 % the truth may be 32 times the estimate.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.deviation import Deviation
from allanscope.allan.estimators import Estimator, Sums, estimator_named
from allanscope.allan.noise_type import NAMES, NoiseTypes, alpha_named, one_noise

__all__ = [
    "BiasCorrection",
    "HadamardFactor",
    "assemble",
    "chi_square_limits",
    "degrees_of_freedom",
    "enclosing_limits",
]

HadamardFactor = Literal["sp1065", "dt0064"]
BiasCorrection = bool | Literal["all"]

_NEVER = 1e-300
"""Probability that is as good as none, of which there still is a quantile."""

_NAMES = np.array([NAMES[alpha] for alpha in range(2, -5, -1)])


def assemble(
    kind: str,
    sums: Sums,
    rate: float,
    level: float = 0.95,
    noise: NoiseTypes | None = None,
    *,
    bias_corrected: BiasCorrection = True,
    hadamard_factor: HadamardFactor = "sp1065",
) -> Deviation:
    """Turn variances into a `Deviation` with chi-square limits.

    Parameters
    ----------
    kind : str
        Estimator name in `REGISTRY`.
    sums : Sums
        Variances with tau0 = 1 in (unit of the data)^2 (tdev, ttotdev: (unit x samples)^2).
    rate : float
        Sample rate in Hz.
    level : float
        Two-sided confidence of the limits.
    noise : NoiseTypes, optional
        Label at each tau, which chooses the customary bias, and levels, on which degrees of freedom
        and expectations rest. Without it the limits are those of white FM and the noise is ``""``.
    bias_corrected : bool or 'all'
        Divide MTOT, TTOT and HTOT by their published bias, and TOTDEV of a run with gaps; with
        ``"all"`` every TOTDEV and THEO1 too, which programs show raw. The limits are for the truth
        in any case: where the value is known to lie off it, its two tails are shared out so that
        they enclose it all the same (those of raw THEO1 are for its own expectation).
    hadamard_factor : {'sp1065', 'dt0064'}
        1/6 or 1/2 in front of the squared third difference: the latter makes hdev, ohdev and
        htotdev sqrt(3) larger.

    Returns
    -------
    Deviation
        On the taus of `sums`; NaN (refused) where there are fewer terms than ``min_terms``.

    Raises
    ------
    ValueError
        For an unknown estimator or factor, a rate that is not positive, a level outside (0, 1).
    """
    estimator = estimator_named(kind)
    if not (math.isfinite(rate) and rate > 0):
        raise ValueError(f"rate must be positive and finite, got {rate!r} Hz")
    m, n = sums.m, sums.n
    known = noise or one_noise("WFM")
    law = np.broadcast_to(known.alpha, sums.variance.shape)
    refused = (sums.terms < estimator.min_terms) | ~np.isfinite(sums.variance)
    raw = np.where(refused, np.nan, sums.variance)
    raw = raw * _unit_factor(estimator.hadamard, hadamard_factor)
    if estimator.time:
        raw = raw / rate**2
    pieces, length = _stretches(sums)
    edf, expectation, left = estimator.of_mixture(known, m, length, sums.stride)
    steepest = np.maximum(law, estimator.lowest_alpha)
    correction = estimator.correction(steepest, m, length) if bias_corrected else np.ones(1)
    if bias_corrected == "all":
        correction, expectation = correction * left, np.where(left == 1.0, expectation, left)
    elif not isinstance(bias_corrected, bool | np.bool_):
        raise ValueError(f"unknown bias_corrected {bias_corrected!r}; choose True, False or 'all'")
    elif bias_corrected and estimator.reflects and np.any(pieces > 1):
        # Between gaps the bias is that of the stretches, while the value scatters as in the run.
        correction = correction * left
    deviation, unbiased = np.sqrt(raw / correction), np.sqrt(raw / expectation)
    # The squares of several stretches are many, and add up to a chi-square.
    scale = 1.0 + (estimator.limit_scale(known, m, length) - 1.0) / pieces
    edf = np.where(refused, np.nan, np.maximum(pieces * edf * scale, 1.0))
    lower, upper = enclosing_limits(deviation, unbiased, edf, level)
    tau = estimator.tau(m, n)
    return Deviation(
        kind=kind,
        tau=tau / rate,
        m=m,
        deviation=deviation,
        lower=lower,
        upper=upper,
        edf=edf,
        terms=sums.terms,
        noise=np.where(refused | (noise is None), "", _NAMES[2 - law]),
        level=level,
        trusted=estimator.trusts(known, tau, n) & _is_covered(estimator, tau, pieces, length, n),
    )


def _is_covered(
    estimator: Estimator,
    tau: NDArray[np.float64],
    pieces: NDArray[np.int64],
    length: NDArray[np.int64],
    n: int,
) -> NDArray[np.bool_]:
    """Return whether the stretches that have a term at all are most of a run, or long themselves.

    Between many gaps the last terms come from a few stretches: those are then the run. Where each
    stretch is reflected, each is.
    """
    covered = pieces * length
    enough = (2 * covered >= n) | (tau <= estimator.trust_fraction * covered)
    run = length if estimator.reflects else n
    return np.asarray(enough & (tau <= estimator.trust_fraction * run))


def _stretches(sums: Sums) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the number of unbroken stretches that have a term at each m, and their mean length.

    Separate stretches are independent, so their degrees of freedom add up; those of one run of the
    total length would be up to three times as many.
    """
    if sums.segments is None or sums.covered is None:
        return np.ones_like(sums.m), np.full_like(sums.m, sums.n)
    return sums.segments, sums.covered // sums.segments


def degrees_of_freedom(kind: str, noise: str, m: ArrayLike, n: int) -> NDArray[np.float64]:
    """Return the equivalent degrees of freedom of an estimator with every term there is.

    Parameters
    ----------
    kind : str
        Estimator.
    noise : str
        Noise type, ``WPM`` to ``RRFM``; the steepest that the estimator converges for where it is
        steeper.
    m : array_like of int, shape (k,)
        Averaging factors.
    n : int
        Number of rate samples.

    Raises
    ------
    ValueError
        For an unknown estimator or noise type.

    Examples
    --------
    >>> degrees_of_freedom("totdev", "WFM", [10, 100], 1000).round().tolist()
    [148.0, 15.0]
    """
    estimator = estimator_named(kind)
    factors = np.atleast_1d(np.asarray(m, np.int64))
    alpha = max(alpha_named(noise), estimator.lowest_alpha)
    stride = np.array([estimator.exact_stride(k) for k in factors.tolist()])
    return np.maximum(estimator.edf(alpha, factors, np.full_like(factors, n), stride), 1.0)


def chi_square_limits(
    deviation: ArrayLike, edf: ArrayLike, level: float = 0.95
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return lower and upper limit of a deviation with `edf` degrees of freedom.

    Parameters
    ----------
    deviation, edf : array_like
        They broadcast; NaN gives NaN.
    level : float
        Probability that the truth lies between the limits.

    Examples
    --------
    >>> lower, upper = chi_square_limits(1.0, [1.0, 10.0, 1000.0])
    >>> lower.round(3).tolist(), upper.round(3).tolist()
    ([0.446, 0.699, 0.958], [31.91, 1.755, 1.046])
    """
    tail = np.float64(_tail(level))
    return _limits(deviation, edf, tail, tail)


def enclosing_limits(
    deviation: NDArray[np.float64],
    unbiased: NDArray[np.float64],
    edf: NDArray[np.float64],
    level: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return limits of the truth that lie about `unbiased` and enclose `deviation`.

    Where half of what is left out would leave out the value too, the limit on that side is the
    value, and the other one leaves out all that this does not.
    """
    from scipy.special import gammainc, gammaincc

    tail = _tail(level)
    with np.errstate(divide="ignore", invalid="ignore"):
        at_value = edf / 2.0 * (unbiased / deviation) ** 2
    at_value = np.where(deviation > 0, at_value, edf / 2.0)
    below = np.minimum(gammaincc(edf / 2.0, at_value), tail)
    above = np.minimum(gammainc(edf / 2.0, at_value), tail)
    under = np.where(above < tail, 2.0 * tail - above, np.maximum(below, _NEVER))
    over = np.where(below < tail, 2.0 * tail - below, np.maximum(above, _NEVER))
    lower, upper = _limits(unbiased, edf, under, over)
    return np.minimum(lower, deviation), np.maximum(upper, deviation)


def _tail(level: float) -> float:
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must lie between 0 and 1, got {level!r}")
    return (1.0 - level) / 2.0


def _limits(
    deviation: ArrayLike,
    edf: ArrayLike,
    below: NDArray[np.float64] | np.float64,
    above: NDArray[np.float64] | np.float64,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return limits that the truth is below and above with the probabilities given."""
    from scipy.special import gammainccinv, gammaincinv

    edf, deviation = np.asarray(edf, np.float64), np.asarray(deviation, np.float64)
    largest = 2.0 * gammainccinv(edf / 2.0, below)
    smallest = 2.0 * gammaincinv(edf / 2.0, above)
    return deviation * np.sqrt(edf / largest), deviation * np.sqrt(edf / smallest)


def _unit_factor(hadamard: bool, factor: str) -> float:
    if factor not in ("sp1065", "dt0064"):
        raise ValueError(f"unknown Hadamard factor {factor!r}; choose sp1065 (1/6) or dt0064 (1/2)")
    return 3.0 if hadamard and factor == "dt0064" else 1.0
