"""THEO1: a deviation that reaches three quarters of the run.

A long record is thinned to phases picked at every s-th sample (`thinned_theo1_variance`). THEO1 is
a sum over all distances v within a window, of the mean square of

    x[i] - x[i+v] + x[i+m] - x[i+m-v],     weighted by 1/v,   v = 1 ... m/2.

Picked phases give that mean square, the profile g(v), at v = s, 2s, ..., m/2. It is smooth in v, so
the sum over the v between is an integral, with two ends that need care. The last point stands for
half a step only. And below the first there are 1/v in plenty: for white PM g is flat, and leaving
them out loses a third of the deviation. There g is continued as the power of v that its first two
points show, from 0 (white PM) over 1 (white FM) to 2 (random walk).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import calibrated_edf
from allanscope.allan.estimators.base import Estimator, register
from allanscope.compiled import Pointer, kernel

__all__ = ["BIAS", "Theo1", "theo1_variance", "thinned_theo1_variance"]

BIAS = np.array(
    [
        [0.09, 0.14, 1.0, 1.87, 2.70],
        [0.74, 0.82, 0.0, -1.05, -1.53],
        [0.40, 0.30, 0.0, 0.79, 0.85],
    ]
)
"""AVAR / THEO1 = a + b / tau^c for white PM to random walk FM (D. Howe and others 2004)."""

_SUMMED = 64
"""So many terms of a sum of powers are added one by one, the rest is an integral."""


@register
class Theo1(Estimator):
    """Theoretical variance no. 1 in its raw form, at tau = 0.75 m.

    ``THEO1(0.75 m) = 1/(0.75 m^2) < sum_{v=1}^{m/2} (x[i] - x[i+v] + x[i+m] - x[i+m-v])^2 / v >``
    for even m, over all windows of m + 1 phases (D. Howe and T. Peppler 2003; NIST SP 1065 eq. 30;
    DT0064 THEO1). It compares rates at all distances within a window and so has a value, with
    several degrees of freedom, where the Allan variance has long run out. For white FM its
    expectation is AVAR at 0.75 m; for other noise it is biased: see `TheoBR`.

    DT0064 trusts it to three quarters of the run. Beyond a tenth a slower noise that the record
    does not show yet takes its degrees of freedom away: limits then hold in 85 to 95 %.

    SP 1065 recommends m >= 10. Some programs, allantools among them, label it tau = m.

    Examples
    --------
    v = 1 contributes (0 - 1 + 10 - 7)^2, v = 2 half of (0 - 3 + 10 - 3)^2: 12 / (0.75 x 16).

    >>> Theo1().exact(np.array([0.0, 1, 3, 7, 10]), 4)
    (1.0, 1)

    The variance at m = 4 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Theo1().exact(x[: n + 1], 4)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, 1.0, 0.542, 0.736, 0.667, 0.675]
    """

    name: ClassVar[str] = "theo1"
    variance_name: ClassVar[str] = "THEO1"
    tau_factor: ClassVar[float] = 0.75
    trust_fraction: ClassVar[float] = 0.1
    min_terms: ClassVar[int] = 1
    even: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of windows."""
        return theo1_variance(phase, m)

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom by the fits of Howe and Peppler.

        For random-walk FM, where the fit fails at the end of the run, those of simulation.
        """
        return calibrated_edf("theo1", alpha, m, n, theo1_edf(alpha, m, n))

    def uncorrected_bias(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return THEO1 / AVAR at tau = 0.75 m by the published fit."""
        alpha, m, _ = np.broadcast_arrays(alpha, m, n)
        a, b, c = BIAS[:, 2 - alpha]
        ratio: NDArray[np.float64] = 1.0 / (a + b / (0.75 * m) ** c)
        return ratio

    def needed(self, m: int) -> int:
        """Return how many rate samples make one window."""
        return m + self.min_terms - 1


def theo1_variance(phase: NDArray[np.float64], m: int, stride: int = 1) -> tuple[float, int]:
    """Return the raw THEO1 variance at tau = 0.75 m, for tau0 = 1, and its number of windows.

    Parameters
    ----------
    phase : ndarray of float64, shape (n + 1,)
        Phase; one picked from a longer record at every s-th sample will do for m >= 64, with the
        result divided by s^2.
    m : int
        Window, even.
    stride : int
        Step between windows: 1 for all; m/8 keeps 94 % of the degrees of freedom for white FM.
    """
    windows = (phase.size - m - 1) // stride + 1 if phase.size > m else 0
    if windows == 0:
        return np.nan, 0
    return _weighted_squares(phase, m, stride) / (0.75 * windows * float(m) ** 2), windows


_squares = kernel("theo1_squares", *(Pointer(np.float64, 1),) * 3, int, int, int, returns=float)
_add_profile = kernel(
    *("theo1_profile", *(Pointer(np.float64, 1),) * 2, int, int, int),
    Pointer(np.float64, 1, written=True),
)


def _weighted_squares(x: NDArray[np.float64], m: int, stride: int) -> float:
    x = np.ascontiguousarray(x)
    backward = x[::-1].copy()  # so that both phases of a term lie in rising order
    weight = 1.0 / np.arange(1, m // 2 + 1)
    return float(_squares(x, backward, weight, x.size, m, stride))


def theo1_edf(alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
    """Return the published degrees of freedom of THEO1 (arguments broadcast).

    Where the record holds no window, those of the shortest record that does: the published fits
    have a pole there.
    """
    alpha, m, n = np.broadcast_arrays(alpha, m, n)
    tau, count = 0.75 * m, np.maximum(n, m) + 1.0
    wide = 4.4 * count - 1.0
    by_alpha = {
        2: 0.86 * (count + 1) * (count - 4 * tau / 3) / (count - tau) * tau / (tau + 1.14),
        1: (4.798 * count**2 - 6.374 * count * tau + 12.387 * tau)
        / (np.sqrt(tau + 36.6) * (count - tau))
        * tau
        / (tau + 0.3),
        0: ((4.1 * count + 0.8) / tau - (3.1 * count + 6.5) / count) * tau**1.5 / (tau**1.5 + 5.2),
        -1: (2 * count**2 - 1.3 * count * tau - 3.5 * tau)
        / (count * tau)
        * tau**3
        / (tau**3 + 2.3),
        -2: (wide - 1)
        / (2.9 * tau)
        * (wide**2 - 8.6 * tau * wide + 11.4 * tau**2)
        / (wide - 2) ** 2,
    }
    return np.select([alpha == key for key in by_alpha], list(by_alpha.values()))


def thinned_theo1_variance(picked: NDArray[np.float64], k: int, s: int) -> tuple[float, int]:
    """Return an estimate of the raw THEO1 variance at m = k s, and its number of windows.

    Parameters
    ----------
    picked : ndarray of float64, shape (rows + 1,)
        Phase at every s-th sample, tau0 = 1.
    k : int
        Window in picked phases; even, at least 4.
    s : int
        Samples between picked phases.

    Notes
    -----
    Measured against all phases at k = 32 and more (`benchmarks/thinning.py`): deviations are within
    0.1 % on average and 0.5 % rms for white, flicker and random-walk FM; for white and flicker PM,
    where most of the sum lies below the first point, within 2 % and 5 %.

    Examples
    --------
    Random-walk FM, eight samples to a row:

    >>> rates = np.random.default_rng(1).normal(size=8192).cumsum()
    >>> phase = np.append(0.0, rates.cumsum())
    >>> thinned, windows = thinned_theo1_variance(phase[::8], 64, 8)
    >>> round(thinned / theo1_variance(phase, 512)[0], 3)
    1.0
    """
    if picked.size <= k:
        return np.nan, 0
    return thinned_variance_of(theo1_profile(picked, k), s), picked.size - k


def thinned_variance_of(profile: NDArray[np.float64], s: int) -> float:
    """Return `thinned_theo1_variance` where the profile of the picked phases is known."""
    k = 2 * profile.size
    weight = 1.0 / np.arange(1, k // 2 + 1)
    weight[-1] *= 0.5 * (1.0 + 1.0 / s)
    if profile[0] > 0:
        # No growth, as for white PM, also where rows that are a period apart differ by nothing.
        growth = max(float(profile[1] / profile[0]), 1.0)
        power = min(float(np.log2(growth)), 2.0)
        weight[0] = _sum_of_powers(1.5 * s, power - 1.0) / s**power
    return float(weight @ profile) / (0.75 * (k * s) ** 2)


def _sum_of_powers(last: float, exponent: float) -> float:
    """Return the sum of v^exponent over v = 1 ... last, for exponent >= -1."""
    total = float(np.sum(np.arange(1.0, min(np.floor(last), _SUMMED) + 1) ** exponent))
    if last > _SUMMED:
        a, b = _SUMMED + 0.5, last + 0.5
        power = exponent + 1.0
        total += np.log(b / a) if power < 1e-9 else (b**power - a**power) / power
    return total


def theo1_profile(phase: NDArray[np.float64], m: int, stride: int = 1) -> NDArray[np.float64]:
    """Return the mean square over windows at each distance v, shape (m // 2,).

    Weighted with 1/v and added up it is THEO1 (`variance_of`); m must be less than the phases.
    """
    x = np.ascontiguousarray(phase)
    profile, windows = np.zeros(m // 2), len(range(0, x.size - m, stride))
    _add_profile(x, x[::-1].copy(), x.size, m, stride, profile)
    return profile / windows


def variance_of(profile: NDArray[np.float64]) -> float:
    """Return the raw THEO1 variance at tau = 0.75 m, for tau0 = 1, of a profile.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=200).cumsum()
    >>> round(variance_of(theo1_profile(x, 20)) / theo1_variance(x, 20)[0], 12)
    1.0
    """
    weight = 1.0 / np.arange(1, profile.size + 1)
    return float(weight @ profile) / (0.75 * (2.0 * profile.size) ** 2)
