"""How many samples more until a bank has a value at an averaging time.

The answer follows from counts alone, without the samples. A bank has averaging factors of its own:
those of its rungs and, for what is evaluated from the archive, multiples of the archive's stride,
which doubles whenever its room is full. The one nearest to the time that is asked for is meant.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.archive import Archive
from allanscope.allan.cascade import Cascade
from allanscope.allan.curves import Curves, factors_of_rows
from allanscope.allan.estimators import estimator_named
from allanscope.allan.kernels import COLUMNS

__all__ = ["samples_to_value"]

_SHORTEST = math.sqrt(0.5)
"""An averaging time below this part of the shortest one of the bank is none of its own."""


def samples_to_value(
    kind: str, tau: float, curves: Curves, cascade: Cascade, archive: Archive
) -> float:
    """Return how many samples more give every axis a value; inf where none is to come.

    Parameters
    ----------
    kind : str
        Name in `REGISTRY`.
    tau : float
        Averaging time in samples.
    curves : Curves
        Values there are.
    cascade, archive : Cascade, Archive
        What the bank holds. No gap is foreseen.
    """
    if kind != "theoh":
        return _to_part(kind, tau, curves, cascade, archive)[0]
    # Two curves in one, which meet at a tenth of the run, and that grows while one waits.
    n = cascade.samples
    more, m = _to_part("theobr", tau, curves, cascade, archive)
    if 0.75 * m > 0.1 * (n + more):
        return more
    more, m = _to_part("oadev", tau, curves, cascade, archive)
    return max(more, 10 * m - n)


def _to_part(
    kind: str, tau: float, curves: Curves, cascade: Cascade, archive: Archive
) -> tuple[float, int]:
    """Return the samples missing, and the averaging factor that will then be the nearest."""
    estimator = estimator_named(kind)
    window = tau / estimator.tau_factor
    name = estimator.derived_from or kind
    if name in COLUMNS:
        m = _nearest(cascade.factors_near(window), window)
        return (cascade.missing(name, m, estimator.min_terms) if m else math.inf), m
    stride, rows = archive.stride, archive.rows.shape[2]
    closed = np.diff(archive.starts)
    taken = since = (archive.used - archive.starts[-1]) * stride + archive.filled
    while m := stride * _nearest(
        factors_of_rows(estimator, stride, rows, cascade.per_octave), window / stride
    ):
        if stride == archive.stride and _has_value(kind, m, curves):
            return 0, m
        # Now there is one as soon as the open segment has the rows, unless no room is left then.
        # Averaged phases are one fewer than picked ones, once a row is more than a sample.
        needed = estimator.needed(m // stride) + (name == "mtotdev" and stride > 1)
        until = since if (closed >= needed).any() else max(since, needed * stride)
        full = (rows - int(closed.sum()) + 1) * stride
        if until < full:
            # A segment that has the rows and no value is of one level, as may be all to come.
            return (until - taken or math.inf), m
        closed, stride, since = closed // 2, 2 * stride, full
    return math.inf, 0


def _has_value(kind: str, m: int, curves: Curves) -> bool:
    sums = curves.sums(kind)
    there = sums.m == m
    return bool(there.any() and np.isfinite(sums.variance[:, there]).all())


def _nearest(factors: NDArray[np.int64], window: float) -> int:
    """Return the factor nearest to a window by ratio; 0 for a window shorter than all."""
    if window < _SHORTEST * factors[0]:
        return 0
    return int(factors[np.argmin(np.abs(np.log(factors / window)))])
