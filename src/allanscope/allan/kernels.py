"""The loop through which every sample goes once, for all averaging times of all estimators.

How it works, in plain words
----------------------------
**Three running sums.** From the samples y of one axis, less an anchor (the first sample ever, so
that a large constant does not eat digits), form

    x[i+1] = x[i] + y[i]                 phase
    z[i+1] = z[i] + x[i]                 phase, summed
    q[i+1] = q[i] + z[i] + x[i]/2        phase, summed twice (trapezoids)

With these every estimator is a difference of a few stored values that lie m apart. There is no loop
over the m samples in between, hence a new sample costs the same at m = 1 and at m = 2^28:

    w = x[p] - x[p-m]                                     OSTDEV, STDEV
    d = x[p] - 2 x[p-m] + x[p-2m]                         OADEV, ADEV, TOTDEV
    h = x[p] - 3 x[p-m] + 3 x[p-2m] - x[p-3m]             OHDEV, HDEV
    e = z[p] - 3 z[p-m] + 3 z[p-2m] - z[p-3m]             MDEV, TDEV: sums m neighbouring d
    r = m/2 (z[p] - z[p-2m]) - (q[p] - 2 q[p-m] + q[p-2m])      PDEV: slopes by least squares

**The ladder.** Rung L holds (x, z, q) at every 2^L-th sample only. Rung 0 serves all m < 64; each
rung above serves one octave, 32 <= m / 2^L < 64. The sums that it holds ran at the full rate, so a
term is the same number as on rung 0. Only the starting points of the terms are thinned, to a step
of m/32 or less, where neighbours are almost copies of each other. Each rung does half the work of
the one below: all of them together cost as much as one more rung 0.

**Frames.** A difference does not care about a constant in x, a straight line in z, a parabola in q.
So every rung counts from its own recent origin, and its numbers stay small however long the run:
``(x, z, q)`` moves like (acceleration, velocity, position) of a body, over a stretch of s samples

    q += s z + s^2/2 x + Q,     z += s x + Z,     x += X

where (X, Z, Q) are what the stretch alone contributes. That step carries two entries of a rung into
one of the next. Nor does it care about an offset of the rate, except for w, which has m times the
offset more. So every rung also takes a mean off the samples, its `offset`, found anew whenever the
segment has doubled, and wherever the first sample lay the numbers are as small as the noise allows:

    x += a s,     z += a s (s - 1) / 2,     q += a (s - 1) s (2 s - 1) / 12

is what an offset a adds in s samples. Everything is float64, and exact as long as the numbers in a
frame stay below 2^53, which on the lower rungs they do; above, the error is 1e-16 of the values in
the frame, never of the values since the run began. For w the offset is put back in sums of
2 x 53 bits (`moments`), because its variance is what remains of them without their mean.

**Batches.** A rung is 512 entries: 256 of history, 256 new. Terms are summed when the new half is
full, then the new half becomes the history. Batches start at fixed sample numbers, so however the
stream is cut into blocks the same additions happen in the same order: results are identical to the
last bit. `settle` does the same for half-filled rungs, at the end of a segment.

Sums may be reordered by the compiler (``reassoc``) because vector registers need it; the order is
then fixed in the machine code. Nothing is assumed about infinities or NaN.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.moments import add_batch
from allanscope.compiled import njit

__all__ = [
    "BATCH",
    "COLUMNS",
    "HEAD",
    "MOMENTS",
    "WIDTH",
    "Ladder",
    "advance",
    "offset_near",
    "put_all_back",
    "settle",
    "spend_batches",
    "with_offset",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BATCH = 256
"""New entries of a rung that are spent at once, and entries of history: more than 3 x 63 lags."""

HEAD = 128
"""First entries of a segment that each rung keeps: more than 2 x 63, for TOTDEV's reflection."""

COLUMNS = ("ostdev", "oadev", "ohdev", "mdev", "pdev", "stdev", "adev", "hdev", "totdev")
"""Whose squares are summed in the first columns of `sums`."""

MOMENTS = {"ostdev": 9, "stdev": 15}
"""Where six columns more begin. Number and sum of w less the offset that the rung has at present,
as are the squares of w in `COLUMNS`. Then what earlier offsets had, which were put back: sum and
sum of squares, each in two doubles."""

WIDTH = 21


class Ladder(NamedTuple):
    """All rungs of all axes, and the sums that their terms go to.

    Attributes
    ----------
    rungs : ndarray, shape (axes, levels, 3, 2 BATCH)
        Entries (x, z, q) of each rung. Number BATCH - 1 is the origin of the frame, nought; a
        segment begins there, and reads nothing before it.
    heads : ndarray, shape (axes, levels, HEAD)
        First phases of the segment on each rung.
    lags : ndarray of int64, shape (taus,)
        m / 2^L of each tau, in order of level.
    first : ndarray of int64, shape (levels + 1,)
        Where the lags of each level begin.
    sums : ndarray, shape (axes, taus, WIDTH)
        Sums of squares (`COLUMNS`), then what `MOMENTS` says.
    offsets : ndarray, shape (axes, levels)
        What the entries of a rung count from, in units of the samples.
    """

    rungs: Floats
    heads: Floats
    lags: Ints
    first: Ints
    sums: Floats
    offsets: Floats


_OSTDEV, _OADEV, _OHDEV, _MDEV, _PDEV, _STDEV, _ADEV, _HDEV, _TOTDEV = range(9)
_OSTDEV_NUMBER, _STDEV_NUMBER = MOMENTS["ostdev"], MOMENTS["stdev"]
_OSTDEV_PLAIN, _STDEV_PLAIN = _OSTDEV_NUMBER + 1, _STDEV_NUMBER + 1

_VECTORS = {"reassoc", "contract"}


@njit(cache=True, nogil=True, fastmath=_VECTORS)
def _full_overlap(
    rung: Floats, span: tuple[int, int], k: int, stride: float, total: Floats
) -> None:
    """Add the terms that end at the entries of a span, all estimators at once."""
    start, stop = span
    x, z, q = rung[0], rung[1], rung[2]
    x0, x1, x2 = x[start:stop], x[start - k : stop - k], x[start - 2 * k : stop - 2 * k]
    z0, z1, z2 = z[start:stop], z[start - k : stop - k], z[start - 2 * k : stop - 2 * k]
    q0, q1, q2 = q[start:stop], q[start - k : stop - k], q[start - 2 * k : stop - 2 * k]
    x3, z3 = x[start - 3 * k : stop - 3 * k], z[start - 3 * k : stop - 3 * k]
    half = 0.5 * k * stride
    # On rung 0 MDEV sums z + x, which include the last phase: one more term, as SP 1065 counts.
    inclusive = 1.0 if stride == 1.0 else 0.0
    ww = dd = hh = ee = rr = w_sum = 0.0
    for j in range(stop - start):
        w = x0[j] - x1[j]
        before = x1[j] - x2[j]
        d = w - before
        h = d - (before - (x2[j] - x3[j]))
        e = (z0[j] - z3[j]) - 3.0 * (z1[j] - z2[j]) + inclusive * h
        r = half * (z0[j] - z2[j]) - ((q0[j] - q1[j]) - (q1[j] - q2[j]))
        w_sum += w
        ww += w * w
        dd += d * d
        hh += h * h
        ee += e * e
        rr += r * r
    total[_OSTDEV_NUMBER] += stop - start
    total[_OSTDEV_PLAIN] += w_sum
    total[_OSTDEV] += ww
    total[_OADEV] += dd
    total[_OHDEV] += hh
    total[_MDEV] += ee
    total[_PDEV] += rr


@njit(cache=True, nogil=True)
def _full_overlap_start(rung: Floats, stop: int, k: int, stride: float, total: Floats) -> None:
    """Add the terms of a segment's first 3 k entries, where the longer differences do not fit."""
    x, z, q = rung[0], rung[1], rung[2]
    origin = BATCH - 1
    for j in range(origin + k, min(origin + 3 * k, stop)):
        w = x[j] - x[j - k]
        total[_OSTDEV_NUMBER] += 1.0
        total[_OSTDEV_PLAIN] += w
        total[_OSTDEV] += w * w
    for j in range(origin + 2 * k, min(origin + 3 * k, stop)):
        d = x[j] - 2.0 * x[j - k] + x[j - 2 * k]
        r = 0.5 * k * stride * (z[j] - z[j - 2 * k]) - (q[j] - 2.0 * q[j - k] + q[j - 2 * k])
        total[_OADEV] += d * d
        total[_PDEV] += r * r
    j = origin + 3 * k - 1
    if stride == 1.0 and j < stop:
        # The inclusive sum before the first phase is nought: one term more than for exclusive sums.
        e = (z[j] + x[j]) - 3.0 * (z[j - k] + x[j - k]) + 3.0 * (z[j - 2 * k] + x[j - 2 * k])
        total[_MDEV] += e * e


@njit(cache=True, nogil=True)
def _no_overlap(x: Floats, before: int, stop: int, k: int, total: Floats) -> None:
    """Add the terms that end at entries whose number in the segment is a multiple of k."""
    origin = BATCH - 1 - before
    number = before - before % k + k
    total[_STDEV_NUMBER] += (before + stop - BATCH) // k - before // k
    w_sum = ww = dd = hh = 0.0
    while number < 3 * k and origin + number < stop:
        j = origin + number
        w = x[j] - x[j - k]
        w_sum += w
        ww += w * w
        if number == 2 * k:
            d = w - (x[j - k] - x[j - 2 * k])
            dd += d * d
        number += k
    start = origin + number
    if start < stop:
        last = x[start - k]
        w_last = last - x[start - 2 * k]
        d_last = w_last - (x[start - 2 * k] - x[start - 3 * k])
        for j in range(start, stop, k):
            w = x[j] - last
            d = w - w_last
            h = d - d_last
            w_sum += w
            ww += w * w
            dd += d * d
            hh += h * h
            last, w_last, d_last = x[j], w, d
    total[_STDEV_PLAIN] += w_sum
    total[_STDEV] += ww
    total[_ADEV] += dd
    total[_HDEV] += hh


@njit(cache=True, nogil=True)
def _put_back(ladder: Ladder, axis: int, level: int) -> None:
    """Move the sums of w of a rung to those without its offset, which may change then."""
    stride = 2.0**level
    for t in range(ladder.first[level], ladder.first[level + 1]):
        total, step = ladder.sums[axis, t], ladder.offsets[axis, level] * (ladder.lags[t] * stride)
        add_batch(
            total[_OSTDEV_NUMBER + 2 : _OSTDEV_NUMBER + 6],
            (total[_OSTDEV_NUMBER], total[_OSTDEV_PLAIN], total[_OSTDEV]),
            step,
        )
        add_batch(
            total[_STDEV_NUMBER + 2 : _STDEV_NUMBER + 6],
            (total[_STDEV_NUMBER], total[_STDEV_PLAIN], total[_STDEV]),
            step,
        )
        total[_OSTDEV_NUMBER] = total[_OSTDEV_PLAIN] = total[_OSTDEV] = 0.0
        total[_STDEV_NUMBER] = total[_STDEV_PLAIN] = total[_STDEV] = 0.0


@njit(cache=True, nogil=True)
def put_all_back(ladder: Ladder) -> None:
    """Move the sums of w of all rungs to those without offsets."""
    for axis in range(ladder.rungs.shape[0]):
        for level in range(ladder.rungs.shape[1]):
            _put_back(ladder, axis, level)


@njit(cache=True, nogil=True)
def _spend(ladder: Ladder, axis: int, level: int, before: int, new: int) -> None:
    """Add all terms that end in the `new` entries of a rung that has spent `before` of them."""
    rung, stride, stop = ladder.rungs[axis, level], 2.0**level, BATCH + new
    if before == 0:
        # Only now is there a mean to count from. The first sample may lie anywhere.
        old = ladder.offsets[axis, level]
        offset = offset_near(old, rung[0, stop - 1], new * stride)
        _put_back(ladder, axis, level)
        with_offset(rung[:, BATCH:stop], 1, stride, old - offset)
        ladder.offsets[axis, level] = offset
        ladder.heads[axis, level] = rung[0, BATCH - 1 : BATCH - 1 + HEAD]
    for t in range(ladder.first[level], ladder.first[level + 1]):
        k, total = ladder.lags[t], ladder.sums[axis, t]
        start = BATCH
        if before == 0:
            _full_overlap_start(rung, stop, k, stride, total)
            start = BATCH - 1 + 3 * k
        if start < stop:
            _full_overlap(rung, (start, stop), k, stride, total)
        _no_overlap(rung[0], before, stop, k, total)


@njit(cache=True, nogil=True)
def offset_near(offset: float, rise: float, samples: float) -> float:
    """Return a round number near the mean of samples that rise by `rise` above an offset.

    It has 24 bits, so that products with lags and strides are exact, and it is whole for integers,
    so that they stay integers.
    """
    mean = offset + rise / samples
    if rise == np.floor(rise) and offset == np.floor(offset):
        mean = np.floor(mean + 0.5)
    wide = 536870913.0 * mean
    return wide - (wide - mean)


@njit(cache=True, nogil=True)
def with_offset(entries: Floats, first: int, stride: float, step: float) -> None:
    """Let the samples below entries (x, z, q) be `step` more.

    Parameters
    ----------
    entries : ndarray, shape (3, n)
        Changed in place.
    first : int
        Number of the first one, counted from the origin of the frame.
    stride : float
        Samples from one entry to the next.
    step : float
        What each sample gains.
    """
    if step == 0.0:
        return
    for j in range(entries.shape[1]):
        s = (first + j) * stride
        entries[2, j] += step * ((s - 1.0) * s * (2.0 * s - 1.0) / 12.0)
        entries[1, j] += step * (0.5 * s * (s - 1.0))
        entries[0, j] += step * s


@njit(cache=True, nogil=True)
def _take_in(rung: Floats, at: int, samples: Floats, offset: float) -> None:
    """Sum samples up on rung 0, from entry `at` on."""
    x, z, q = rung[0, at - 1], rung[1, at - 1], rung[2, at - 1]
    for j in range(samples.size):
        q += z + 0.5 * x
        z += x
        x += samples[j] - offset
        rung[0, at + j], rung[1, at + j], rung[2, at + j] = x, z, q


@njit(cache=True, nogil=True)
def _promote(rungs: Floats, offsets: Floats, level: int, before: int, new: int) -> None:
    """Carry every second of the new entries of a rung to the next."""
    lower, upper = rungs[level], rungs[level + 1]
    if before == 0:
        offsets[level + 1] = offsets[level]
    s = 2.0 ** (level + 1)
    half = 0.5 * s * s
    more = np.zeros((3, 1))
    with_offset(more, 1, s, offsets[level] - offsets[level + 1])
    more_x, more_z, more_q = more[0, 0], more[1, 0], more[2, 0]
    at = BATCH + (before // 2) % BATCH
    x, z, q = upper[0, at - 1], upper[1, at - 1], upper[2, at - 1]
    for j in range(new // 2):
        a = BATCH - 1 + 2 * j
        b = a + 2
        own_q = lower[2, b] - lower[2, a] - s * lower[1, a] - half * lower[0, a]
        q += s * z + half * x + (own_q + more_q)
        z += s * x + (lower[1, b] - lower[1, a] - s * lower[0, a] + more_z)
        x += lower[0, b] - lower[0, a] + more_x
        upper[0, at + j], upper[1, at + j], upper[2, at + j] = x, z, q


@njit(cache=True, nogil=True)
def _make_history(rung: Floats, stride: float) -> float:
    """Move the new half to the history, in a frame with its origin at the last entry.

    Return by how much the phase rose in it.
    """
    x, z, q = rung[0, 2 * BATCH - 1], rung[1, 2 * BATCH - 1], rung[2, 2 * BATCH - 1]
    for j in range(BATCH):
        s = (j - BATCH + 1) * stride
        rung[2, j] = rung[2, BATCH + j] - q - s * z - 0.5 * s * s * x
        rung[1, j] = rung[1, BATCH + j] - z - s * x
        rung[0, j] = rung[0, BATCH + j] - x
    return float(x)


@njit(cache=True, nogil=True)
def _count_from_mean(ladder: Ladder, axis: int, level: int, rise: float) -> None:
    """Give a rung the mean of its last batch, by which the phase rose, for an offset."""
    stride, old = 2.0**level, ladder.offsets[axis, level]
    offset = offset_near(old, rise, BATCH * stride)
    _put_back(ladder, axis, level)
    with_offset(ladder.rungs[axis, level, :, :BATCH], 1 - BATCH, stride, old - offset)
    ladder.offsets[axis, level] = offset


@njit(cache=True, nogil=True)
def spend_batches(ladder: Ladder, axis: int, level: int, batches: int) -> None:
    """Spend the full batch of a rung, its number `batches`, and those that it fills above."""
    levels = ladder.rungs.shape[1]
    full = True
    while full:
        before = (batches - 1) * BATCH
        _spend(ladder, axis, level, before, BATCH)
        if level + 1 < levels:
            _promote(ladder.rungs[axis], ladder.offsets[axis], level, before, BATCH)
        rise = _make_history(ladder.rungs[axis, level], 2.0**level)
        # When the segment has doubled is often enough: a level that changes between is no offset
        # of the whole, but varies as much as its change.
        if batches & (batches - 1) == 0:
            _count_from_mean(ladder, axis, level, rise)
        full = level + 1 < levels and batches % 2 == 0
        level, batches = level + 1, batches // 2


@njit(cache=True, nogil=True)
def advance(samples: Floats, taken: int, ladder: Ladder) -> None:
    """Take in the next samples of every axis.

    Parameters
    ----------
    samples : ndarray, shape (axes, n)
        Samples, less the anchor.
    taken : int
        Samples of this segment that came before.
    ladder : Ladder
        Changed in place.
    """
    for axis in range(ladder.rungs.shape[0]):
        rungs = ladder.rungs[axis]
        done, count = 0, taken
        while done < samples.shape[1]:
            at = BATCH + count % BATCH
            size = min(2 * BATCH - at, samples.shape[1] - done)
            _take_in(rungs[0], at, samples[axis, done : done + size], ladder.offsets[axis, 0])
            done += size
            count += size
            if count % BATCH == 0:
                spend_batches(ladder, axis, 0, count // BATCH)


@njit(cache=True, nogil=True)
def settle(taken: int, ladder: Ladder) -> None:
    """Add the terms of half-filled rungs and TOTDEV's reflected ends: the segment ends here.

    Parameters are those of `advance`. The rungs are ready for another segment afterwards, but not
    for going on with this one.
    """
    axes, levels = ladder.rungs.shape[0], ladder.rungs.shape[1]
    for axis in range(axes):
        rungs = ladder.rungs[axis]
        for level in range(levels):
            entries = taken >> level
            new = entries % BATCH
            before = entries - new
            if new > 0:
                _spend(ladder, axis, level, before, new)
                if level + 1 < levels:
                    _promote(rungs, ladder.offsets[axis], level, before, new)
            head = ladder.heads[axis, level]
            backwards = rungs[level, 0, BATCH - 1 + new :: -1]
            for t in range(ladder.first[level], ladder.first[level + 1]):
                ladder.sums[axis, t, _TOTDEV] += _reflected(
                    head, backwards, entries, ladder.lags[t]
                )
    put_all_back(ladder)


@njit(cache=True, nogil=True)
def _reflected(head: Floats, backwards: Floats, entries: int, k: int) -> float:
    """Return the squares that TOTDEV has beyond OADEV: those that reach past an end.

    Beyond an end the record goes on as its own image turned by 180 degrees about the last point,
    ``x[-j] = 2 x[0] - x[j]`` (Howe 2000). Both ends look alike, one read forwards, one backwards.
    """
    total = 0.0
    if entries >= 2 * k:
        for i in range(1, k):
            left = 2.0 * head[0] - head[k - i] - 2.0 * head[i] + head[i + k]
            right = 2.0 * backwards[0] - backwards[k - i] - 2.0 * backwards[i] + backwards[i + k]
            total += left * left + right * right
    elif entries >= k:
        end = head[entries]
        for i in range(1, entries):
            left = head[i - k] if i >= k else 2.0 * head[0] - head[k - i]
            right = head[i + k] if i + k <= entries else 2.0 * end - head[2 * entries - i - k]
            total += (left - 2.0 * head[i] + right) ** 2
    return total
