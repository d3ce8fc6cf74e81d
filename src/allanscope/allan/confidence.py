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
from allanscope.allan.estimators import Sums, estimator_named
from allanscope.allan.noise_type import NAMES

__all__ = ["BiasCorrection", "HadamardFactor", "assemble", "chi_square_limits"]

HadamardFactor = Literal["sp1065", "dt0064"]
BiasCorrection = bool | Literal["all"]

_NAMES = np.array([NAMES[alpha] for alpha in range(2, -5, -1)])


def assemble(
    kind: str,
    sums: Sums,
    rate: float,
    level: float = 0.95,
    alpha: ArrayLike | None = None,
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
    alpha : array_like of int, broadcastable to ``sums.variance``, optional
        Power law at each tau, from `allanscope.allan.noise_type.identify`. Without it the limits
        are those of white FM and the noise is ``""``.
    bias_corrected : bool or 'all'
        Divide MTOT, TTOT and HTOT by their published bias; with ``"all"`` TOTDEV and THEO1 too,
        which programs show raw. The limits are for the truth in any case: where the value is known
        to lie off it, they span both (those of raw THEO1 are for its own expectation).
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
    law = np.broadcast_to(0 if alpha is None else np.asarray(alpha, np.int64), sums.variance.shape)
    known = np.maximum(law, estimator.lowest_alpha)
    refused = (sums.terms < estimator.min_terms) | ~np.isfinite(sums.variance)
    raw = np.where(refused, np.nan, sums.variance)
    raw = raw * _unit_factor(estimator.hadamard, hadamard_factor)
    if estimator.time:
        raw = raw / rate**2
    pieces, length = _stretches(sums)
    expectation = estimator.expectation(known, m, length)
    correction = estimator.correction(known, m, length) if bias_corrected else np.ones(1)
    if bias_corrected == "all":
        left = estimator.uncorrected_bias(known, m, length)
        correction, expectation = correction * left, np.where(left == 1.0, expectation, left)
    elif not isinstance(bias_corrected, bool | np.bool_):
        raise ValueError(f"unknown bias_corrected {bias_corrected!r}; choose True, False or 'all'")
    deviation, unbiased = np.sqrt(raw / correction), np.sqrt(raw / expectation)
    edf = np.maximum(pieces * estimator.edf(known, m, length, sums.stride), 1.0)
    edf = np.where(refused, np.nan, edf)
    lower, _ = chi_square_limits(np.minimum(deviation, unbiased), edf, level)
    _, upper = chi_square_limits(np.maximum(deviation, unbiased), edf, level)
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
        noise=np.where(refused | (alpha is None), "", _NAMES[2 - law]),
        level=level,
        trusted=tau <= estimator.trust_fraction * n,
    )


def _stretches(sums: Sums) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the number of unbroken stretches that have a term at each m, and their mean length.

    Separate stretches are independent, so their degrees of freedom add up; those of one run of the
    total length would be up to three times as many.
    """
    if sums.segments is None or sums.covered is None:
        return np.ones_like(sums.m), np.full_like(sums.m, sums.n)
    return sums.segments, sums.covered // sums.segments


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
    from scipy.special import gammaincinv

    if not 0.0 < level < 1.0:
        raise ValueError(f"level must lie between 0 and 1, got {level!r}")
    edf = np.asarray(edf, np.float64)
    tail = (1.0 - level) / 2.0
    smallest = 2.0 * gammaincinv(edf / 2.0, tail)
    largest = 2.0 * gammaincinv(edf / 2.0, 1.0 - tail)
    deviation = np.asarray(deviation, np.float64)
    return deviation * np.sqrt(edf / largest), deviation * np.sqrt(edf / smallest)


def _unit_factor(hadamard: bool, factor: str) -> float:
    if factor not in ("sp1065", "dt0064"):
        raise ValueError(f"unknown Hadamard factor {factor!r}; choose sp1065 (1/6) or dt0064 (1/2)")
    return 3.0 if hadamard and factor == "dt0064" else 1.0
