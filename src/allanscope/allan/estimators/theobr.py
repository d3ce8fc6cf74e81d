"""THEOBR: THEO1 with its bias removed by the record itself."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import calibrated_edf
from allanscope.allan.estimators.base import REGISTRY, register
from allanscope.allan.estimators.theo1 import BIAS, Theo1, theo1_variance
from allanscope.allan.noise_type import NoiseTypes
from allanscope.compiled import Pointer, kernel

__all__ = ["TheoBR", "theobr_ratio"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_RATIO_EDF = 150.0
"""Degrees of freedom of the ratio: 110 to 330 for FM noise, by simulation, at any run length."""

_SHORTEST = 0.03
"""Part of the run from which on limits hold where noises meet."""
_PHASE_NOISES, _LITTLE = (2, 1), 0.1
"""Their alpha, and what THEO1 may have of them, in parts of the variance that it is to tell."""
_MOST_RATIOS = 64
"""Tau of which the ratio, and the expected one, is the mean."""
_WINDOWS_PER_TAU = 32


@register
class TheoBR(Theo1):
    """Bias-removed THEO1: scaled so that it meets AVAR where both are well known.

    ``TheoBR = k THEO1`` with k the mean of ``OAVAR(9 + 3i) / THEO1(12 + 4i)``, two variances at the
    same tau, over i = 0 ... N/30 - 3 (J. Taylor and D. Howe 2010: THEOBR; NIST SP 1065; DT0064:
    Theo1BR), N being the number of phases. The shortest run that has a k is of 90 phases. Stable32
    averages up to N/6 - 3 when it runs over all tau: to half of the run, where AVAR is not known.

    Examples
    --------
    >>> rng = np.random.default_rng(4)
    >>> x = np.append(0.0, rng.standard_normal(2000).cumsum())
    >>> round(theobr_ratio(x), 2)
    1.06

    The variance at m = 40 as the run grows to 88, 89, 200, 400 and 800 samples:

    >>> [round(TheoBR().exact(x[: n + 1], 40)[0], 3) for n in (88, 89, 200, 400, 800)]
    [nan, 0.01, 0.03, 0.037, 0.037]
    """

    name: ClassVar[str] = "theobr"
    variance_name: ClassVar[str] = "THEOBR"
    trust_fraction: ClassVar[float] = 0.25

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of windows."""
        variance, windows = theo1_variance(phase, m)
        ratio = theobr_ratio(phase)
        return (ratio * variance, windows) if np.isfinite(ratio) else (np.nan, 0)

    def curve(self, phase: NDArray[np.float64], factors: Iterable[int]) -> list[tuple[float, int]]:
        """Return `exact` for each m, with the ratio evaluated once."""
        ratio = theobr_ratio(phase)
        if not np.isfinite(ratio):
            return [(np.nan, 0) for _ in factors]
        raw = [theo1_variance(phase, m) for m in factors]
        return [(ratio * variance, windows) for variance, windows in raw]

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom by simulation, the scatter of the ratio included.

        In windows shorter than those of simulation it is taken as independent of THEO1; and in
        phase noise, which alone has a ratio that scatters less, but beside a slower noise has not.
        """
        apart = 1.0 / (1.0 / super().edf(alpha, m, n, stride) + 1.0 / _RATIO_EDF)
        simulated = calibrated_edf("theobr", alpha, m, n, apart)
        return np.where(np.asarray(alpha) > 0, np.minimum(simulated, apart), simulated)

    def trusts(self, noise: NoiseTypes, tau: ArrayLike, n: int) -> NDArray[np.bool_]:
        """Return whether the limits hold: not in phase noise, whose bias no one ratio removes.

        Nor at short tau, where the ratio is that of other noise than there is: 80 to 99 %. Beyond a
        quarter of the run they hold in 91 to 98 % where a random walk begins; DT0064 trusts it to
        three quarters.
        """
        times = np.asarray(tau, np.float64)
        share = noise.shares(self.family, times)
        window = np.maximum(times / self.tau_factor, 1.0)
        each = [self.passed(alpha, window, n) for alpha in _PHASE_NOISES]
        fast = sum(share[..., i] * each[i] for i in range(len(each)))
        slow = (noise.alpha <= 0) & (fast <= _LITTLE)
        return super().trusts(noise, tau, n) & (times >= _SHORTEST * n) & slow

    def uncorrected_bias(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return 1: the record itself has removed the bias."""
        return np.ones(np.broadcast_shapes(np.shape(alpha), np.shape(m), np.shape(n)))

    def expectation(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return what one ratio for all tau leaves of the bias, which depends on tau."""
        alpha, m, n = np.broadcast_arrays(alpha, m, n)
        a, b, c = BIAS[:, 2 - alpha]
        end = np.maximum(n / 10.0, 10.0)
        mean_power = (end ** (1 - c) - 9.0 ** (1 - c)) / ((1 - c) * (end - 9.0))
        ratio: NDArray[np.float64] = (a + b * mean_power) / (a + b / (0.75 * m) ** c)
        return ratio

    def passed(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> Floats:
        """Return what THEO1 passes of one noise: the ratio multiplies all noises of a record."""
        return REGISTRY["theo1"].uncorrected_bias(alpha, m, n)

    def of_mixture(
        self, noise: NoiseTypes, m: Ints, n: Ints, stride: ArrayLike
    ) -> tuple[Floats, Floats, Floats]:
        """Return degrees of freedom, what one ratio leaves of the bias of several noises, and 1.

        The ratio is a mean over tau, at each of which the noises have other shares.
        """
        raw = REGISTRY["theo1"].of_mixture(noise, m, n, stride)[2]
        whole = int(np.max(n))
        last = max((whole + 1) // 30 - 3, 0)
        window = 12 + 4 * np.unique(np.linspace(0, last, _MOST_RATIOS).round().astype(np.int64))
        every = noise.at(0.75 * window, self.tau(m, whole))
        ratios = REGISTRY["theo1"].of_mixture(every, window, np.full_like(window, whole), 1)[2]
        edf, _, left = super().of_mixture(noise, m, n, stride)
        return edf, raw * np.mean(1.0 / ratios, axis=-1, keepdims=True), left

    def needed(self, m: int) -> int:
        """Return how many rate samples make one window and one ratio."""
        return max(super().needed(m), 89)


_ratios = kernel(
    "theobr_ratios",
    *(Pointer(np.float64, 1),) * 3,
    *(int, Pointer(np.int64, 1), int, int),
    Pointer(np.float64, 1, written=True),
)


def theobr_ratio(phase: NDArray[np.float64]) -> float:
    """Return what THEO1 is multiplied by to have its bias removed; NaN below 90 phases.

    By definition up to 2000 phases. Beyond, THEO1 windows start at every m/32-th sample only, and
    the ratio is averaged over 64 tau instead of all: the ratios of neighbouring tau are nearly the
    same number, and their effort would grow as the cube of the record. The root of the mean moves
    by 0.1 % rms in FM noise, where it is known to 4 %, and by 0.4 % in phase noise.
    """
    count = phase.size // 30 - 2
    if count < 1:
        return np.nan
    x = np.ascontiguousarray(phase, np.float64)
    few = min(count, _MOST_RATIOS)
    steps = ((np.arange(few) + 0.5) * count / few).astype(np.int64)  # middles of equal parts
    per_tau = x.size if few == count else _WINDOWS_PER_TAU
    weight = 1.0 / np.arange(1, 7 + 2 * int(steps[-1]))
    ratios = np.empty(steps.size)
    backward = x[::-1].copy()
    _ratios(x, backward, weight, x.size, steps, steps.size, per_tau, ratios)
    return float(np.mean(ratios))
