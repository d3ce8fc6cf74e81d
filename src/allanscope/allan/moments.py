"""Sums of values and of their squares whose difference keeps its digits.

The variance of n values w is ``(sum w^2 - (sum w)^2 / n) / (n - 1)``. Where the mean is 10^8 times
the deviation, the two have their first 16 digits in common, and doubles hold no more. Two things
help: each sum is the sum of two doubles, 106 bits, and values are summed less a common step near
their mean, which is put back exactly::

    sum (w + c)    =  sum w  +  n c
    sum (w + c)^2  =  sum w^2  +  c (2 sum w + n c)

Putting a step back is all there is to do: for batches of the kernel (`cascade.c`), for a run with
another anchor (`shifted`), and, with minus the mean for a step, to get the variance.

Sums and products of doubles with the error that they leave are Knuth's and Dekker's (T. J. Dekker
1971, A floating-point technique for extending the available precision).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["sample_variance", "shifted", "two_sum"]

Floats = NDArray[np.float64]
Pair = tuple[Any, Any]
"""A number, or an array of them, as the sum of two doubles, the second being the small one."""

_SPLIT = 134217729.0
"""2^27 + 1 parts a double into two halves of 26 bits."""


def two_sum(a: Any, b: Any) -> Pair:
    """Return a + b rounded, and what the rounding took.

    Examples
    --------
    >>> two_sum(1e16, 1.0)
    (1e+16, 1.0)
    """
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


def _two_product(a: Any, b: Any) -> Pair:
    """Return a b rounded, and what the rounding took."""
    product = a * b
    wide_a, wide_b = _SPLIT * a, _SPLIT * b
    high_a, high_b = wide_a - (wide_a - a), wide_b - (wide_b - b)
    low_a, low_b = a - high_a, b - high_b
    low = ((high_a * high_b - product) + high_a * low_b + low_a * high_b) + low_a * low_b
    return product, low


def shifted(number: Any, first: Pair, second: Pair, step: Any) -> tuple[Pair, Pair]:
    """Return sum and sum of squares of `number` values after `step` was added to each."""
    more = _two_product(number, step)
    twice = _added((2.0 * first[0], 2.0 * first[1]), more)
    high, low = _two_product(step, twice[0])
    return _added(first, more), _added(second, (high, low + step * twice[1]))


def sample_variance(number: Floats, first: Pair, second: Pair) -> Floats:
    """Return the sample variance of `number` values; NaN for one.

    Examples
    --------
    Of 2^60 - 1, 2^60 and 2^60 + 1, none of which is known apart from the others in doubles:

    >>> mean = 2.0**60
    >>> zero = (0.0, 0.0), (2.0, 0.0)
    >>> float(sample_variance(3.0, *shifted(3.0, *zero, mean)))
    1.0
    """
    about, squares = shifted(number, first, second, -(first[0] + first[1]) / number)
    rest = squares[0] + (squares[1] - (about[0] + about[1]) ** 2 / number)
    return np.asarray(np.maximum(rest, 0.0) / np.where(number > 1, number - 1, np.nan))


def _added(a: Pair, b: Pair) -> Pair:
    high, low = two_sum(a[0], b[0])
    return two_sum(high, low + (a[1] + b[1]))
