"""A deviation curve of an array, from every term there is.

Three steps: the samples become a phase, the estimator turns it into a variance at each averaging
factor, and the noise type found at each makes limits of it. A stream does the same with
`AllanBank`, from running sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.confidence import HadamardFactor, assemble
from allanscope.allan.deviation import Deviation
from allanscope.allan.estimators import REGISTRY, Estimator, Sums, estimator_named
from allanscope.allan.noise_type import at_factors, identify
from allanscope.allan.phase import DataKind, to_phase

__all__ = ["Taus", "deviation", "power_law"]

Taus = Literal["octave", "all"] | int | Sequence[float] | NDArray[np.float64]


def deviation(
    data: ArrayLike,
    rate: float,
    kind: str = "oadev",
    taus: Taus = "octave",
    data_kind: DataKind = "rate",
    exact: bool = True,
    *,
    level: float = 0.95,
    bias_corrected: bool = True,
    hadamard_factor: HadamardFactor = "sp1065",
) -> Deviation:
    """Return a deviation of the Allan family with its limits, for one axis.

    Parameters
    ----------
    data : array_like of int or float, shape (n,)
        Rates, e.g. in dps; or with ``data_kind="phase"`` n + 1 values of their integral in dps s.
    rate : float
        Sample rate in Hz.
    kind : str
        stdev ostdev adev oadev mdev tdev hdev ohdev totdev mtotdev ttotdev htotdev theo1 theobr
        theoh pdev.
    taus : {'octave', 'all'}, int or sequence of float
        Powers of two; every factor; so many in each octave; or averaging times in s, each a whole
        number m of samples. For the Theo family m is the even window, and the tau that comes back
        is 0.75 m / rate.
    data_kind : {'rate', 'phase'}
        What the data are. Rates taken for phase are the commonest mistake: the curve then falls by
        one power of tau more.
    exact : bool
        False to go through `AllanBank`, whose terms are thinned at long tau: faster by far for long
        records, and to a fraction of the limits the same. Needs octave-wise taus.
    level : float
        Two-sided confidence of the limits.
    bias_corrected : bool
        False for raw MTOT, TTOT and HTOT.
    hadamard_factor : {'sp1065', 'dt0064'}
        1/6 or 1/2 in front of Hadamard's squared differences.

    Returns
    -------
    Deviation
        Arrays of shape (k,).

    Raises
    ------
    ValueError
        For an unknown name, a rate that is not positive, a sample that is not finite, a tau that is
        no whole factor, or a run too short; the message says which.

    Examples
    --------
    >>> curve = deviation([1, 2, 4, 3, 3, 1, 1, 2], rate=10.0)
    >>> curve.tau.tolist(), curve.deviation.round(3).tolist()
    ([0.1, 0.2], [0.886, 1.025])
    """
    estimator = estimator_named(kind)
    phase = to_phase(data, rate, data_kind)
    n = phase.size - 1
    factors = choose_factors(estimator, taus, n, rate)
    if not exact:
        return _streamed(
            phase,
            rate,
            kind,
            taus,
            level,
            bias_corrected=bias_corrected,
            hadamard_factor=hadamard_factor,
        )
    results = estimator.curve(phase, factors.tolist())
    sums = Sums(
        m=factors,
        variance=np.array([variance for variance, _ in results]),
        terms=np.array([terms for _, terms in results], np.int64),
        stride=np.array([estimator.exact_stride(m) for m in factors.tolist()], np.int64),
        n=n,
    )
    alpha = power_law(phase, estimator.tau(factors, n))
    return assemble(
        kind,
        sums,
        rate,
        level,
        alpha,
        bias_corrected=bias_corrected,
        hadamard_factor=hadamard_factor,
    )


def power_law(phase: NDArray[np.float64], tau: ArrayLike) -> NDArray[np.int64]:
    """Return the noise type of a record at each averaging time in samples, as alpha.

    Parameters
    ----------
    phase : ndarray of float64, shape (n + 1,)
        As from `to_phase`.
    tau : array_like, shape (k,)
        Averaging times in samples.

    Returns
    -------
    ndarray of int64, shape (k,)
        2 (white PM) to -4, see `allanscope.allan.noise_type.identify`.
    """
    n = phase.size - 1
    phase = _without_drift(phase)
    m = 2 ** np.arange(max(int(np.log2(n / 16)), 0) + 1)
    avar = [REGISTRY["oadev"].exact(phase, k)[0] for k in m.tolist()]
    mvar = [REGISTRY["mdev"].exact(phase, k)[0] for k in m.tolist()]
    # The other two are asked for at m = 1 only.
    stdvar, hvar = np.full((2, m.size), np.nan)
    stdvar[0] = REGISTRY["ostdev"].exact(phase, 1)[0]
    hvar[0] = REGISTRY["ohdev"].exact(phase, 1)[0]
    alpha = identify(m, n, stdvar=stdvar, avar=avar, hvar=hvar, mvar=mvar)
    return at_factors(tau, m, alpha)


def _without_drift(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take off the slope of the rate, which is no noise: from the means of the two halves."""
    n = phase.size - 1
    half = n // 2
    rise = (phase[n] - phase[n - half]) - (phase[half] - phase[0])
    i = np.arange(n + 1, dtype=np.float64)
    return phase - float(rise) / (half * (n - half)) * (i * (i - n) / 2.0)


def _streamed(
    phase: NDArray[np.float64],
    rate: float,
    kind: str,
    taus: Taus,
    level: float,
    *,
    bias_corrected: bool,
    hadamard_factor: HadamardFactor,
) -> Deviation:
    from allanscope.allan.bank import AllanBank

    per_octave = 1 if isinstance(taus, str) and taus == "octave" else taus
    if not isinstance(per_octave, int | np.integer):
        raise ValueError("a bank keeps its own taus: exact=False needs octave or a number for taus")
    bank = AllanBank(rate, axes=1, per_octave=int(per_octave))
    bank.update(np.diff(phase))
    curve = bank.deviation(
        kind, level, bias_corrected=bias_corrected, hadamard_factor=hadamard_factor
    )
    return curve.axis(0)


def choose_factors(estimator: Estimator, taus: Taus, n: int, rate: float) -> NDArray[np.int64]:
    """Return the averaging factors that `taus` asks for and a run of `n` samples can give.

    Parameters
    ----------
    estimator : Estimator
        It sets which factors exist and how much data each one needs.
    taus : {'octave', 'all'}, int or sequence of float
        Powers of two; every factor; so many in each octave; or m / rate in s, for the Theo family
        too, whose own averaging time is three quarters of that.
    n : int
        Number of rate samples.
    rate : float
        Sample rate in Hz.

    Returns
    -------
    ndarray of int64, ascending

    Raises
    ------
    ValueError
        When `taus` is none of these, when a time in s is not a whole factor or needs a longer run,
        or when the run is too short for any factor.

    Examples
    --------
    >>> from allanscope.allan.estimators import REGISTRY
    >>> choose_factors(REGISTRY["oadev"], "octave", 100, 10.0)
    array([ 1,  2,  4,  8, 16, 32])
    >>> choose_factors(REGISTRY["theo1"], [2.0, 4.0], 100, 10.0)
    array([20, 40])
    """
    if isinstance(taus, str):
        if taus == "octave":
            return _available(estimator, _spaced(1, n), n)
        if taus == "all":
            return _available(estimator, np.arange(1, n + 1), n)
        raise ValueError(f"unknown taus {taus!r}; choose octave, all, a number or times in s")
    if np.ndim(taus) == 0:
        if not isinstance(taus, int | np.integer) or isinstance(taus, bool) or taus < 1:
            raise ValueError(
                f"taus as a number is how many in each octave, got {taus!r}; "
                "give averaging times in s as a sequence"
            )
        return _available(estimator, _spaced(int(taus), n), n)
    return _from_seconds(estimator, np.asarray(taus, np.float64).ravel(), n, rate)


def _spaced(per_octave: int, n: int) -> NDArray[np.int64]:
    steps = np.arange(int(np.log2(n) * per_octave) + 1)
    return np.unique(np.round(2.0 ** (steps / per_octave)).astype(np.int64))


def _available(estimator: Estimator, candidates: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    if estimator.even and estimator.admits(2, n):
        candidates = np.unique(2 * ((candidates + 1) // 2))
    factors = [
        m for m in candidates.tolist() if estimator.admits(m, n) and estimator.needed(m) <= n
    ]
    if not factors:
        least = estimator.needed(2 if estimator.even else 1)
        raise ValueError(f"{estimator.name} needs at least {least} samples, got {n}")
    return np.array(factors, np.int64)


def _from_seconds(
    estimator: Estimator, seconds: NDArray[np.float64], n: int, rate: float
) -> NDArray[np.int64]:
    if seconds.size == 0:
        raise ValueError("taus is empty")
    return np.unique([_factor(estimator, float(tau), n, rate) for tau in seconds])


def _factor(estimator: Estimator, tau: float, n: int, rate: float) -> int:
    if not (np.isfinite(tau) and tau > 0):
        raise ValueError(f"tau must be positive and finite, got {tau!r} s")
    exact = tau * rate
    m = round(exact)
    if abs(exact - m) > 1e-9 * exact + 1e-6:
        raise ValueError(
            f"tau {tau:g} s is {exact:g} samples at {rate:g} Hz; "
            f"{estimator.name} needs a whole number of them"
        )
    if not estimator.admits(m, n):
        raise ValueError(
            f"{estimator.name} has no window of {m} samples (tau {tau:g} s at {rate:g} Hz) in {n} "
            "samples; windows of the Theo family are even"
        )
    if estimator.needed(m) > n:
        more = estimator.needed(m) - n
        raise ValueError(
            f"{estimator.name} at tau {tau:g} s needs {more} samples ({more / rate:g} s) more "
            f"than the {n} there are"
        )
    return m
