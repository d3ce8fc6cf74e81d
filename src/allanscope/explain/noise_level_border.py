r"""The row at which noise becomes louder or quieter.

Of squares :math:`x_i^2` whose variance is :math:`v_0` before a border and :math:`v_1` from it on,
the log-likelihood of the border is a running sum,

.. math:: \ell(t) = \tfrac12 \sum_{i < t} \left[\ln \frac{v_1}{v_0}
          - x_i^2 \left(\frac{1}{v_0} - \frac{1}{v_1}\right)\right],

and where every row is as likely beforehand the border is in the rows that hold 95 % of its
exponential (Smith, *Biometrika* 62, 407, 1975). Nothing here is a parabola: how far one may be off
depends on the contrast alone, not on the number of rows. Loud noise is quiet in many a row: the
likeliest border is where the first large row is, mostly too late, so the median is told.

Of a level that is known from few rows, n of them of sum s, every one is as likely in its logarithm:
integrated over it the likelihood is that of :math:`\Gamma(n / 2) (s / 2)^{-n / 2}`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from allanscope.explain.effect import Estimate

__all__ = [
    "confidence_of_loglik",
    "instant_of",
    "loglik_of_level",
    "rows_of_border",
    "rows_of_loglik",
]

Array = NDArray[np.float64]

_OUT = 0.025
"""Probability on each side of the interval."""


def rows_of_border(
    squares: Array, before: float, after: float, weight: float = 1.0
) -> tuple[float, float, float]:
    """Return the border in rows from the first one: median and ends of its interval.

    A border of 3 is the instant of row 3. It lies between two rows, anywhere with equal chance.

    Parameters
    ----------
    squares : ndarray, shape (m,)
    before, after : float
        Their mean on the two sides.
    weight : float
        Degrees of freedom of one square: less than 1 where tails are heavier than a Gaussian's.

    Examples
    --------
    >>> border = rows_of_border(np.array([1.0, 0.5, 1.5, 90.0, 110.0]), 1.0, 100.0)
    >>> [round(row, 2) for row in border]
    [2.38, 0.99, 2.97]
    """
    gained = np.log(after / before) - squares * (1 / before - 1 / after)
    return rows_of_loglik(0.5 * weight * np.concatenate([[0.0], np.cumsum(gained)]))


def loglik_of_level(count: Array, total: Array, weight: float = 1.0) -> Array:
    """Return the log-likelihood of squares of one level that is not known, to a constant.

    Parameters
    ----------
    count, total : ndarray, shape (m,)
        How many there are of each, and their sum.
    weight : float
        As of `rows_of_border`.
    """
    half = 0.5 * weight * count
    return np.asarray(gammaln(half) - half * np.log(0.5 * weight * total))


def rows_of_loglik(loglik: Array) -> tuple[float, float, float]:
    """Return the same as `rows_of_border` of the log-likelihoods of borders at row 0, 1, ..."""
    below, rows = confidence_of_loglik(loglik)
    median, low, high = np.interp(np.array([0.5, _OUT, 1 - _OUT]), below, rows)
    return float(median), float(low), float(high)


def confidence_of_loglik(loglik: Array) -> tuple[Array, Array]:
    """Return the confidence that the border is before some rows, and these, shape (m + 1,)."""
    below = np.concatenate([[0.0], np.cumsum(np.exp(loglik - loglik.max()))])
    return below / below[-1], np.maximum(np.arange(-1.0, len(loglik)), 0.0)


def instant_of(rows: tuple[float, float, float], rate_hz: float, start_s: float = 0.0) -> Estimate:
    """Return the instant of a border in s, from rows."""
    median, low, high = (start_s + row / rate_hz for row in rows)
    return Estimate(median, low, high, "s")
