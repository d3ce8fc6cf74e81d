"""Plain variances at long tau, from the rows of the archive: more terms than the cascade has.

Above m = 64 the cascade starts a term at every 2^L-th sample only, 32 to 63 of them in one
averaging time. The archive has 4096 rows or more of any run that is as long, so beyond a 128th of
the run its rows are finer than the rungs; up to 8192 samples they are the samples. There each term
that the rows admit is summed when a result is asked for: some ten microseconds a tau and axis.

Phase and its running sum are exact at the borders of rows. The second running sum, which only PDEV
needs, lacks what the third moment Q of each row adds. It follows from the sums u and v that a row
has, by least squares over its s samples::

    Q = sum_k k^2/2 y,   v = sum_k k y,   u = sum_k y      k samples before the end of the row
    Q ~ (s - 1)/2 (v - (s - 2)/6 u)

exact for white noise but for a part that is uncorrelated with both, (s/m)^2 of PVAR and less.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.archive import Archive
from allanscope.allan.estimators import Sums, estimator_named
from allanscope.allan.estimators.base import mean_square_third

__all__ = ["KINDS", "running_sums", "with_rows"]

Floats = NDArray[np.float64]
Segment = tuple[Floats, Floats, Floats]
"""Phase and its two running sums at the borders of the rows of a segment."""

KINDS = ("ostdev", "oadev", "ohdev", "mdev", "pdev", "totdev")
"""Estimators whose terms overlap; the others have all of them in the cascade. So has OSTDEV of
several segments, which alone compares them: their rows count from anchors of their own."""


def with_rows(
    kind: str, sums: Sums, archive: Archive, running: Callable[[], list[list[Segment]]]
) -> Sums:
    """Return the sums of a cascade, those taken from the archive whose terms are closer there.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    sums : Sums
        As from `Cascade.variances`, of the same samples. Which taus there are is left to it.
    archive : Archive
        Its stride is a power of two, as are those of the cascade.
    running : callable
        Returns the `running_sums` of each axis, which all kinds share.
    """
    estimator = estimator_named(kind)
    enough = sums.terms.min(axis=0, initial=np.iinfo(np.int64).max) >= estimator.min_terms
    fine = np.flatnonzero((sums.stride > archive.stride) & enough)
    broken = kind == "ostdev" and np.count_nonzero(np.diff([*archive.starts, archive.used])) > 1
    if fine.size == 0 or broken or sums.segments is None or sums.covered is None:
        return sums
    variance, terms = sums.variance.copy(), sums.terms.copy()
    stride, segments, covered = sums.stride.copy(), sums.segments.copy(), sums.covered.copy()
    rows = sums.m[fine] // archive.stride
    for axis, phases in enumerate(running()):
        for t, k in zip(fine.tolist(), rows.tolist(), strict=True):
            variance[axis, t], *counts = _pooled(kind, phases, k, archive.stride)
            terms[axis, t], segments[t], covered[t] = counts
    stride[fine] = archive.stride
    return replace(
        sums, variance=variance, terms=terms, stride=stride, segments=segments, covered=covered
    )


def running_sums(archive: Archive, axis: int) -> list[Segment]:
    """Return the running sums of each segment of an axis, from samples less its mean.

    No term sees the mean, and without it the sums stay small.
    """
    s = archive.stride
    found = []
    for u, v in archive.segments(axis):
        mean = float(u.mean()) / s if u.size else 0.0
        du, dv = u - s * mean, v - s * (s - 1.0) / 2.0 * mean
        third = (s - 1.0) / 2.0 * (dv - (s - 2.0) / 6.0 * du)
        x = np.append(0.0, du.cumsum())
        z = np.append(0.0, (s * x[:-1] + dv).cumsum())
        q = np.append(0.0, (s * z[:-1] + s * s / 2.0 * x[:-1] + third).cumsum())
        found.append((x, z, q))
    return found


def _pooled(kind: str, phases: list[Segment], k: int, stride: int) -> tuple[float, int, int, int]:
    """Return variance, terms, and the segments that have any with their samples, at k rows."""
    total, terms, segments, covered = 0.0, 0, 0, 0
    for phase in phases:
        variance, count = _variance(kind, phase, k, stride)
        if count:
            total, terms = total + variance * count, terms + count
            segments, covered = segments + 1, covered + (phase[0].size - 1) * stride
    return total / terms, terms, segments, covered


def _variance(kind: str, phase: Segment, k: int, stride: int) -> tuple[float, int]:
    """Return a variance for tau0 of one sample and its terms, at m of k rows."""
    x, z, q = phase
    m = float(k * stride)
    if stride == 1 or kind not in ("mdev", "pdev"):
        variance, terms = estimator_named(kind).exact(x, k)
        return variance / stride**2, terms
    if kind == "mdev":
        mean, terms = mean_square_third(z, k, 1)
        return mean / (2.0 * m**4), terms
    terms = max(x.size - 2 * k - 1, 0)  # one fewer than there are, as in `Pdev`
    slopes = m / 2.0 * (z[2 * k :] - z[: -2 * k]) - (q[2 * k :] - 2.0 * q[k:-k] + q[: -2 * k])
    return (72.0 * float(slopes[1:] @ slopes[1:]) / terms / m**6 if terms else 0.0), terms
