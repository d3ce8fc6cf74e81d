"""A deviation curve of an array, from every term there is.

Three steps: the samples become a phase, the estimator turns it into a variance at each averaging
factor, and the noise type found at each makes limits of it. A stream does the same with
`AllanBank`, from running sums; a bank also finds the noise types of an array, so that both ways
give the same ones. NaN is a gap: no term spans it, as behind `AllanBank.gap`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.choices import TAU_SETS
from allanscope.allan.confidence import BiasCorrection, HadamardFactor, assemble
from allanscope.allan.deviation import Deviation
from allanscope.allan.estimators import REGISTRY, Estimator, Sums, estimator_named
from allanscope.allan.estimators.base import AverageEstimator
from allanscope.allan.noise_type import NoiseTypes, one_noise
from allanscope.allan.phase import DataKind, to_phases

if TYPE_CHECKING:
    from allanscope.allan.bank import AllanBank

__all__ = ["Taus", "choose_factors", "deviation", "factors_of", "identify_noise", "noise_types"]

Phases = list[NDArray[np.float64]]

Taus = Literal["octave", "decade", "many", "all"] | int | Sequence[float] | NDArray[np.float64]


_MANY = 24
"""Averaging times in each octave of `many`: 80 in each decade."""


def deviation(
    data: ArrayLike,
    rate: float,
    kind: str = "oadev",
    taus: Taus = "octave",
    data_kind: DataKind = "rate",
    exact: bool = True,
    *,
    level: float = 0.95,
    bias_corrected: BiasCorrection = True,
    hadamard_factor: HadamardFactor = "sp1065",
    noise: str | None = None,
) -> Deviation:
    """Return a deviation of the Allan family with its limits, for one axis.

    Parameters
    ----------
    data : array_like of int or float, shape (n,)
        Rates, e.g. in dps; or with ``data_kind="phase"`` n + 1 values of their integral in dps s.
        NaN is a gap.
    rate : float
        Sample rate in Hz.
    kind : str
        stdev ostdev adev oadev mdev tdev hdev ohdev totdev mtotdev ttotdev htotdev theo1 theobr
        theoh pdev.
    taus : {'octave', 'decade', 'many', 'all'}, int or sequence of float
        Powers of two; 1, 2 and 4 times the powers of ten; 24 in each octave; every factor; so many
        in each octave; or averaging times in s, each a whole number m of samples: one that has no
        value is an error. For the Theo family m is the even window, and the tau that comes back is
        0.75 m / rate.
    data_kind : {'rate', 'phase'}
        What the data are. Rates treated as phase are the commonest mistake: the curve then falls by
        one power of tau more.
    exact : bool
        False to go through `AllanBank`, whose terms are thinned at long tau of runs of more than
        8192 samples: faster by far, and to a fraction of the limits the same. Needs octave-wise
        taus.
    level : float
        Two-sided confidence of the limits.
    bias_corrected : bool or 'all'
        False for raw MTOT, TTOT and HTOT; ``"all"`` to remove the bias of TOTDEV and THEO1 too.
    hadamard_factor : {'sp1065', 'dt0064'}
        1/6 or 1/2 in front of Hadamard's squared differences.
    noise : str, optional
        Power law to take at every tau for limits and bias, ``WPM FPM WFM FFM RWFM FWFM RRFM``,
        instead of finding it out.

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
    phases = to_phases(data, rate, data_kind)
    n = sum(phase.size - 1 for phase in phases)
    factors = choose_factors(estimator, taus, n, rate)
    if not exact:
        return _streamed(
            phases,
            rate,
            kind,
            taus,
            level,
            bias_corrected=bias_corrected,
            hadamard_factor=hadamard_factor,
            noise=noise,
        )
    sums = _sums(estimator, phases, factors, n)
    if len(phases) > 1:
        sums = _with_values(estimator, sums, taus, rate, max(phase.size - 1 for phase in phases))
    tau = estimator.tau(sums.m, n)
    known = noise_types(phases, tau) if noise is None else one_noise(noise)
    return assemble(
        kind,
        sums,
        rate,
        level,
        known,
        bias_corrected=bias_corrected,
        hadamard_factor=hadamard_factor,
    )


def identify_noise(
    data: ArrayLike, rate: float, taus: Taus = "octave", data_kind: DataKind = "rate"
) -> tuple[NDArray[np.float64], NDArray[np.str_]]:
    """Return averaging times in s and the noise type that dominates at each.

    Parameters
    ----------
    data, rate, taus, data_kind
        As for `deviation`.

    Returns
    -------
    tau, noise : ndarray, shape (k,)
        ``WPM FPM WFM FFM RWFM FWFM RRFM``, that of the curve's `Deviation.noise`.

    Examples
    --------
    >>> walk = np.random.default_rng(3).normal(size=2000).cumsum()
    >>> tau, noise = identify_noise(walk, 10.0, [0.1, 0.4])
    >>> noise.tolist()
    ['RWFM', 'RWFM']
    """
    curve = deviation(data, rate, "oadev", taus, data_kind)
    return curve.tau, curve.noise


def factors_of(kind: str, taus: Taus, n: int, rate: float) -> NDArray[np.int64]:
    """Return the averaging factors of an estimator by name; see `choose_factors`."""
    return choose_factors(estimator_named(kind), taus, n, rate)


def noise_types(phases: Phases, tau: ArrayLike) -> NoiseTypes:
    """Return the noise of a record at averaging times in samples.

    Parameters
    ----------
    phases : list of ndarray of float64
        As from `to_phases`.
    tau : array_like, shape (k,)
        Averaging times in samples.

    Returns
    -------
    NoiseTypes
        Of one axis.
    """
    found = _bank(phases, 1.0, 1).noise_types(tau)
    levels, steep = (None if one is None else one[0] for one in (found.levels, found.steep))
    return NoiseTypes(found.alpha[0], levels, steep)


def _bank(phases: Phases, rate: float, per_octave: int) -> AllanBank:
    """Return a bank that has taken the rates of every stretch."""
    from allanscope.allan.bank import AllanBank

    bank = AllanBank(rate, axes=1, per_octave=per_octave)
    for i, phase in enumerate(phases):
        if i:
            bank.gap()
        bank.update(np.diff(phase))
    return bank


def _sums(estimator: Estimator, phases: Phases, factors: NDArray[np.int64], n: int) -> Sums:
    """Return variances and terms of all stretches together."""
    m = factors.tolist()
    stride = np.array([estimator.exact_stride(k) for k in m], np.int64)
    if len(phases) == 1:
        variance, terms = zip(*estimator.curve(phases[0], m), strict=True)
        return Sums(factors, np.array(variance), np.array(terms, np.int64), stride, n)
    pooled = np.array([_pooled(estimator, phases, k, n) for k in m])
    terms, segments, covered = pooled[:, 1:].astype(np.int64).T
    return Sums(factors, pooled[:, 0], terms, stride, n, np.maximum(segments, 1), covered)


def _pooled(estimator: Estimator, phases: Phases, m: int, n: int) -> tuple[float, int, int, int]:
    """Return variance, terms, and the stretches that have any with their samples, at one m."""
    if estimator.name == "theoh":
        # Which of its two parts is meant goes by the whole run, not by the stretch.
        short = bool(estimator.tau(m, n) == m)
        estimator = REGISTRY["oadev" if short else "theobr"]
    if isinstance(estimator, AverageEstimator):
        step = estimator.exact_stride(m)
        found = [(x[m:] - x[:-m])[::step] / m for x in phases if x.size > m]
        means = np.concatenate([*found, []])
        variance = float(np.var(means, ddof=1)) if means.size > 1 else np.nan
        return variance, means.size, len(found), sum(x.size - 1 for x in phases if x.size > m)
    squares, terms, segments, covered = 0.0, 0, 0, 0
    for phase in phases:
        variance, count = estimator.exact(phase, m) if phase.size > m else (np.nan, 0)
        if count and np.isfinite(variance):
            squares, terms = squares + variance * count, terms + count
            segments, covered = segments + 1, covered + phase.size - 1
    return squares / terms if terms else np.nan, terms, segments, covered


def _with_values(estimator: Estimator, sums: Sums, taus: Taus, rate: float, longest: int) -> Sums:
    """Return what has a value on a record with gaps; ValueError for a tau in s that has none."""
    keep = (sums.terms >= estimator.min_terms) & np.isfinite(sums.variance)
    if keep.all():
        return sums
    m = int(sums.m[~keep][0])
    if not (isinstance(taus, str) or np.ndim(taus) == 0) or not keep.any():
        raise ValueError(
            f"{estimator.name} has no value at tau {m / rate:g} s between the gaps: the longest "
            f"stretch has {longest} samples"
        )
    segments, covered = sums.segments, sums.covered
    return replace(
        sums,
        m=sums.m[keep],
        variance=sums.variance[keep],
        terms=sums.terms[keep],
        stride=sums.stride[keep],
        segments=None if segments is None else segments[keep],
        covered=None if covered is None else covered[keep],
    )


def _streamed(
    phases: Phases,
    rate: float,
    kind: str,
    taus: Taus,
    level: float,
    *,
    bias_corrected: BiasCorrection,
    hadamard_factor: HadamardFactor,
    noise: str | None,
) -> Deviation:
    per_octave = 1 if isinstance(taus, str) and taus == "octave" else taus
    if not isinstance(per_octave, int | np.integer):
        raise ValueError("a bank keeps its own taus: exact=False needs octave or a number for taus")
    curve = _bank(phases, rate, int(per_octave)).deviation(
        kind, level, bias_corrected=bias_corrected, hadamard_factor=hadamard_factor, noise=noise
    )
    return curve.axis(0)


def choose_factors(estimator: Estimator, taus: Taus, n: int, rate: float) -> NDArray[np.int64]:
    """Return the averaging factors that `taus` asks for and a run of `n` samples can give.

    Parameters
    ----------
    estimator : Estimator
        It sets which factors exist and how much data each one needs.
    taus : {'octave', 'decade', 'many', 'all'}, int or sequence of float
        As in `deviation`; m / rate in s for the Theo family too, whose own averaging time is three
        quarters of that.
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
        if taus in ("octave", "many"):
            return _available(estimator, _spaced(1 if taus == "octave" else _MANY, n), n)
        if taus == "decade":
            powers = 10 ** np.arange(len(str(n)))
            return _available(estimator, np.outer(powers, [1, 2, 4]).ravel(), n)
        if taus == "all":
            return _available(estimator, np.arange(1, n + 1), n)
        names = ", ".join(TAU_SETS)
        raise ValueError(f"unknown taus {taus!r}; choose {names}, a number or times in s")
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
