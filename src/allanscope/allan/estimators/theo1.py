"""THEO1: a deviation that reaches three quarters of the run."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.estimators.base import Estimator, register
from allanscope.compiled import njit

__all__ = ["Theo1", "theo1_variance"]


@register
class Theo1(Estimator):
    """Theoretical variance no. 1 in its raw form, at tau = 0.75 m.

    ``THEO1(0.75 m) = 1/(0.75 m^2) < sum_{v=1}^{m/2} (x[i] - x[i+v] + x[i+m] - x[i+m-v])^2 / v >``
    for even m, over all windows of m + 1 phases (D. Howe and T. Peppler 2003; NIST SP 1065 eq. 30;
    DT0064 THEO1). It compares rates at all distances within a window and so has a value, with
    several degrees of freedom, where the Allan variance has long run out. For white FM its
    expectation is AVAR at 0.75 m; for other noise it is biased: see `TheoBR`.

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
    trust_fraction: ClassVar[float] = 0.75
    min_terms: ClassVar[int] = 1
    even: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of windows."""
        return theo1_variance(phase, m)

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom by the fits of Howe and Peppler."""
        return theo1_edf(alpha, m, n)

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


# Adding squares in any order is harmless, and lets the compiler add four at a time.
@njit(cache=True, nogil=True, fastmath={"reassoc"})
def _weighted_squares(x: NDArray[np.float64], m: int, stride: int) -> float:
    half = m // 2
    weight = 1.0 / np.arange(1, half + 1)
    backward = x[::-1].copy()
    total = 0.0
    for i in range(0, x.size - m, stride):
        ends = x[i] + x[i + m]
        left = x[i + 1 : i + 1 + half]
        right = backward[x.size - m - i : x.size - m - i + half]
        squares = 0.0
        for v in range(half):
            term = ends - left[v] - right[v]
            squares += weight[v] * (term * term)
        total += squares
    return total


def theo1_edf(alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
    """Return the published degrees of freedom of THEO1 (arguments broadcast)."""
    alpha, m, n = np.broadcast_arrays(alpha, m, n)
    tau, count = 0.75 * m, n + 1.0
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
