"""Which guarantee holds, and how the false-alarm probability is spent over a run without end.

A false alarm in at most one of 40 axes, whatever the length of the run: the probability that an
axis *ever* raises one is at most `ALPHA`. An average run length would promise less, one alarm in so
many hours, and a longer night would have more of them. So `ALPHA` is spent: over the kinds of
changes, over the windows that are looked at, and over time, by weights that sum to one. What is
asked of the stream as a whole, its rate, repeats and losses, is paid for by its axes.

- A test of one look at one window (`scan`, `counts`) is an all-or-nothing e-value: 1 / (alpha w) if
  its p-value is at most alpha w, else 0. The weighted sum of all e-values of a run has an
  expectation of at most one whatever the dependence between looks, so that by Markov's inequality
  it ever reaches 1 / alpha with a probability of at most alpha.
- A line (`lines`) is followed by e-processes, one begun at each block (e-detectors of Shin, Ramdas
  and Rinaldo, "E-detectors: a nonparametric framework for sequential change detection", 2024), of
  which a CUSUM is the largest; the one begun at block j may reach 1 / (alpha w_j) by Ville's
  inequality with a probability of at most alpha w_j. How much less that probability is, because
  most begin by falling and one that arrives is far over its limit, is known and is spent as well.

Both rest on the null distribution of a look: a t distribution whose scale is measured on the record
itself at the same span of time, so that flicker, drift and temperature are in it, and whose tails
are as heavy as measured. Where a record changes its nature, that is an event.
"""

from __future__ import annotations

import math

__all__ = ["ALPHA", "log_weight"]

ALPHA = 1.0 / 40.0
"""Probability that an axis raises a false alarm in a run, however long."""

_EXPONENT = 1.5
_BLOCKS = 8 * 3600.0


def log_weight(block: int) -> float:
    """Return the log of the share of `ALPHA` that a block may spend; over all blocks they sum to 1.

    The weight is nearly flat in the first hours and falls as t^-2.5 after the first night. In that
    night, at t about `_BLOCKS`, no function of such a kind leaves more to a block.

    Examples
    --------
    >>> total = sum(math.exp(log_weight(block)) for block in range(400_000))
    >>> 0.97 < total < 1.0
    True
    """
    return math.log(_EXPONENT / _BLOCKS) - (1.0 + _EXPONENT) * math.log1p((block + 1.0) / _BLOCKS)
