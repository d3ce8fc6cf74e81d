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

Of a process :math:`z` is the signed root of twice the nats that a size gains. That is known at
three points, the estimate and the ends of its interval, and 0 where there is nothing.
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr

from allanscope.explain.effect import Estimate
from allanscope.optimise import root_between
from allanscope.quantities import TWO_SIDED_95

__all__ = ["conditional_rank", "given_detection"]

_FARTHEST = 40.0
"""Standard errors above the estimate of a size that is ruled out."""
_SURE = 8.0
"""Standard errors above the limit from which the selection changes nothing."""


def given_detection(
    size: Estimate, penalty: float, gain: float | None = None, nothing: float = 0.0
) -> Estimate:
    """Return a size with its interval, given that its gain exceeded a penalty.

    Parameters
    ----------
    size : Estimate
        As fitted, with its 95 % interval.
    penalty : float
        Nats that the gain had to exceed.
    gain : float, optional
        Nats that it gained; those of a normal estimate without it.
    nothing : float
        Size at which there is no effect.

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
    scale = _Scale(size, gain, nothing)
    observed = scale.observed
    limit = min(np.sqrt(2.0 * max(penalty, 0.0)), observed)
    if not observed - limit < _SURE:
        return size

    lower, value, upper = (
        scale.size_at(_root_at(rank, observed, limit)) for rank in (0.025, 0.5, 0.975)
    )
    return Estimate(value, min(lower, upper), max(lower, upper), size.unit)


class _Scale:
    """Sizes by the root of twice the nats that they gain: a straight line of a normal estimate.

    It goes through nothing, the estimate, and the ends of its interval, which stand for 1.96 on
    each side; the lower one where it is on the side of the estimate.
    """

    def __init__(self, size: Estimate, gain: float | None, nothing: float) -> None:
        assert size.lower is not None
        assert size.upper is not None
        self.sign = 1.0 if size.value >= nothing else -1.0
        ends = sorted(self.sign * (end - nothing) for end in (size.lower, size.upper))
        value = self.sign * (size.value - nothing)
        self.nothing = nothing
        self.observed = value / size.error if gain is None else float(np.sqrt(2.0 * gain))
        roots, sizes = [0.0, self.observed], [0.0, value]
        if ends[0] > 0.0 and self.observed > TWO_SIDED_95:
            roots.insert(1, self.observed - TWO_SIDED_95)
            sizes.insert(1, ends[0])
        roots += [self.observed + TWO_SIDED_95, self.observed + _FARTHEST]
        slope = (ends[1] - value) / TWO_SIDED_95
        self.roots, self.sizes = roots, [*sizes, ends[1], value + slope * _FARTHEST]

    def size_at(self, root: float) -> float:
        """Return the size with a root."""
        return self.nothing + self.sign * float(np.interp(root, self.roots, self.sizes))


def conditional_rank(z: float, observed: float, limit: float) -> float:
    """Return the probability of at least what was observed, given that the limit was exceeded.

    All three in standard errors, or roots of twice the nats that a size gains. Uniform over
    repeated records at the true size.
    """
    return float(np.exp(log_ndtr(z - observed) - log_ndtr(z - limit)))


def _root_at(rank: float, observed: float, limit: float) -> float:
    """Return the root at which what was observed has a rank; 0 where none is as small."""

    def excess(z: float) -> float:
        return conditional_rank(z, observed, limit) - rank

    return 0.0 if excess(0.0) >= 0 else root_between(excess, 0.0, observed + _FARTHEST)
