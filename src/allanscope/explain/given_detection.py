r"""The size of an effect, given that it was detected.

An effect near the limit is seen in those records in which noise makes it larger, so the size that
fits best is too large on average: for one that is seen half of the time by about a fifth. Let
:math:`z` be the true size and :math:`\hat z` the estimate, both in standard errors, and :math:`t`
the value that had to be exceeded, :math:`t^2 / 2` being the penalty in nats. The likelihood of what
can be seen is that of the estimate divided by the probability that it is seen,

.. math:: L(z) \propto \frac{\exp(-(\hat z - z)^2 / 2)}{\Phi(z - t)},

the normal truncated at :math:`t`. The estimate is the size at which

.. math:: P(\hat Z \ge \hat z \mid \hat Z > t; z) = \frac{\Phi(z - \hat z)}{\Phi(z - t)}

is 1/2, too large as often as too small, and the interval is where it lies between 0.025 and 0.975,
which covers exactly (Weinstein, Fithian and Benjamini, *Selection adjusted confidence intervals*,
JASA 108, 2013; Zhong and Prentice, Biostatistics 9, 2008). Far above the limit both are those
without a selection.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import log_ndtr

from allanscope.explain.effect import Estimate

__all__ = ["conditional_rank", "given_detection"]

_FARTHEST = 40.0
"""Standard errors above the estimate of a size that is ruled out."""
_SURE = 8.0
"""Standard errors above the limit from which the selection changes nothing."""


def given_detection(size: Estimate, penalty: float) -> Estimate:
    """Return the size of a signal with its interval, given that its gain exceeded a penalty.

    Parameters
    ----------
    size : Estimate
        As fitted, with its 95 % interval.
    penalty : float
        Nats that the gain had to exceed.

    Examples
    --------
    A step of 5 standard errors that had to gain 10 nats, 4.5 standard errors:

    >>> found = given_detection(Estimate.of(5.0, 1.0, "mdps"), 10.0)
    >>> round(found.value, 1), round(found.lower, 1), round(found.upper, 1)
    (4.0, 0.0, 6.8)

    One of 20 stays what it is:

    >>> round(given_detection(Estimate.of(20.0, 1.0, "mdps"), 10.0).value, 6)
    20.0
    """
    observed = abs(size.value) / size.error
    limit = min(np.sqrt(2.0 * max(penalty, 0.0)), observed)
    if not observed - limit < _SURE:
        return size

    lower, value, upper = (
        size.error * _size_at(rank, observed, limit) for rank in (0.025, 0.5, 0.975)
    )
    if size.value < 0:
        value, lower, upper = -value, -upper, -lower
    return Estimate(value, lower, upper, size.unit)


def conditional_rank(z: float, observed: float, limit: float) -> float:
    """Return the probability of at least what was observed, given that the limit was exceeded.

    All three in standard errors. Uniform over repeated records at the true size.
    """
    return float(np.exp(log_ndtr(z - observed) - log_ndtr(z - limit)))


def _size_at(rank: float, observed: float, limit: float) -> float:
    """Return the size at which what was observed has a rank; 0 where none is as small."""

    def excess(z: float) -> float:
        return conditional_rank(z, observed, limit) - rank

    return 0.0 if excess(0.0) >= 0 else float(brentq(excess, 0.0, observed + _FARTHEST))
