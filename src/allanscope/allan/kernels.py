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

where (X, Z, Q) are what the stretch alone contributes. That step carries entries of a rung to the
next: each is a stretch on from the last that is there. Nor does it care about an offset of the
rate, except for w, which has m times the offset more. So every rung also takes a mean off the
samples, its `offset`, found anew whenever the segment has doubled, and wherever the first sample
lay the numbers are as small as the noise allows:

    x += a s,     z += a s (s - 1) / 2,     q += a (s - 1) s (2 s - 1) / 12

is what an offset a adds in s samples. Everything is float64, and exact as long as the numbers in a
frame stay below 2^53, which on the lower rungs they do; above, the error is 1e-16 of the values in
the frame, never of the values since the run began. For w the offset is put back in sums of
2 x 53 bits (`moments`), because its variance is what remains of them without their mean.

**Batches.** A rung is 512 entries: 256 of history, 256 new. Terms are summed when the new half is
full, then the new half becomes the history. Batches start at fixed sample numbers, so however the
stream is cut into blocks the same additions happen in the same order: results are identical to the
last bit. `settle` does the same for half-filled rungs, at the end of a segment.

Samples come in rows of all axes, which are summed up side by side: the sums of one axis wait for
each other. Squares are summed in four lanes, as vector registers need it, in an order that is the
same on every processor. The loops are `compiled/cascade.c`; where samples are whole numbers, as
counts are, most terms are those of `compiled/whole.c`, and the low rungs are kept as such for long
stretches (`compiled/stretch.c`), with the same bits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import Pointer, kernel

__all__ = [
    "BATCH",
    "COLUMNS",
    "FREE",
    "HEAD",
    "MOMENTS",
    "NOTED",
    "WIDTH",
    "Ladder",
    "add_block_sums",
    "advance",
    "offset_near",
    "restore_offsets",
    "rows_of",
    "settle",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BATCH = 256
"""New entries of a rung that are spent at once, and entries of history: more than 3 x 63 lags."""

HEAD = 128
"""First entries of a segment that each rung keeps: more than 2 x 63, for TOTDEV's reflection."""

COLUMNS = ("ostdev", "oadev", "ohdev", "mdev", "pdev", "stdev", "adev", "hdev", "totdev")
"""Whose squares are summed in the first columns of `sums`, in the order of `cascade.c`."""

MOMENTS = {"ostdev": 9, "stdev": 15}
"""Where six columns more begin. Number and sum of w less the offset that the rung has at present,
as are the squares of w in `COLUMNS`. Then what earlier offsets had, which were put back: sum and
sum of squares, each in two doubles."""

WIDTH = 21

FREE, NOTED = -1, -2
"""A place for a mark that has none, and one whose sums have been noted: see `Ladder`."""


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
    marks : ndarray of int64, shape (levels, slots)
        Numbers of samples of the open segment at which each rung is to note its sums of OADEV:
        `FREE` where there is none, `NOTED` once it is done.
    marked : ndarray, shape (axes, taus, slots, 3)
        At each mark: the squares of the terms that end there or before, the squares of those that
        reach across, and the number of these.
    """

    rungs: Floats
    heads: Floats
    lags: Ints
    first: Ints
    sums: Floats
    offsets: Floats
    marks: Ints
    marked: Floats


_LADDER = (
    Pointer(np.float64, 4, written=True),
    Pointer(np.float64, 3, written=True),
    *(Pointer(np.int64, 1), Pointer(np.int64, 1)),
    Pointer(np.float64, 3, written=True),
    Pointer(np.float64, 2, written=True),
    Pointer(np.int64, 2, written=True),
    Pointer(np.float64, 4, written=True),
    *(int, int, int),
)
_ROWS = {"int16": Pointer(np.int16, 2), "float64": Pointer(np.float64, 2)}
_advance = {
    name: kernel(f"cascade_advance_{name}", rows, Pointer(np.float64, 1), int, int, *_LADDER)
    for name, rows in _ROWS.items()
}
_settle = kernel("cascade_settle", int, *_LADDER)
_restore_offsets = kernel("cascade_restore_offsets", *_LADDER)
_add_block_sums = kernel("cascade_add_block_sums", Pointer(np.float64, 3), int, int, int, *_LADDER)


def rows_of(samples: NDArray[Any]) -> NDArray[Any]:
    """Return samples of shape (n, axes) as loops take them: int16, all others as float64."""
    return np.ascontiguousarray(samples, samples.dtype if samples.dtype == np.int16 else np.float64)


def advance(samples: NDArray[Any], anchor: Floats, taken: int, ladder: Ladder) -> None:
    """Take in the next samples of every axis.

    Parameters
    ----------
    samples : ndarray, shape (n, axes)
        Samples.
    anchor : ndarray, shape (axes,)
        Subtracted from every sample.
    taken : int
        Samples of this segment that came before.
    ladder : Ladder
        Changed in place.
    """
    own = rows_of(samples)
    n, axes = own.shape
    _advance[own.dtype.name](own, anchor, n, taken, *_checked(ladder, axes, *anchor.shape))


def settle(taken: int, ladder: Ladder) -> None:
    """Add the terms of half-filled rungs and TOTDEV's reflected ends: the segment ends here.

    Parameters are those of `advance`. The rungs are ready for another segment afterwards, but not
    for going on with this one.
    """
    _settle(taken, *_checked(ladder))


def restore_offsets(ladder: Ladder) -> None:
    """Put the offsets back into the sums of w of all rungs: see `MOMENTS`."""
    _restore_offsets(*_checked(ladder))


def add_block_sums(block_sums: Floats, level: int, taken: int, ladder: Ladder) -> None:
    """Take sums of blocks of 2^level samples in at a rung, as the rung below would pass them on.

    A block of s samples moves the running sums of a rung by its own (X, Z, Q), as at the top of
    this file, so whoever has those of neighbouring blocks needs their samples no more to go on
    with the rungs whose stride is s and above. Integers below 2^53 stay exact.

    Parameters
    ----------
    block_sums : ndarray, shape (axes, k, 3)
        (X, Z, Q) of what follows the `taken` blocks that this segment had before.
    level : int
        The rung; those below it are left alone.
    taken : int
        Entries that the rung has taken in.
    ladder : Ladder
        Changed in place.
    """
    axes, blocks, sums = block_sums.shape
    if sums != 3 or not 0 <= level < ladder.rungs.shape[1]:
        raise ValueError(f"rung {level} takes sums of shape (axes, k, 3), got {block_sums.shape}")
    own = np.ascontiguousarray(block_sums, np.float64)
    _add_block_sums(own, blocks, level, taken, *_checked(ladder, axes))


def _checked(ladder: Ladder, *axes: int) -> tuple[Any, ...]:
    """Return a ladder as loops take it; ValueError where its arrays do not fit together."""
    rows, levels = ladder.rungs.shape[:2]
    taus, slots = int(ladder.first[-1]), ladder.marks.shape[1]
    if (
        ladder.rungs.shape[2:] != (3, 2 * BATCH)
        or ladder.heads.shape != (rows, levels, HEAD)
        or ladder.first.shape != (levels + 1,)
        or ladder.lags.shape != (taus,)
        or ladder.sums.shape != (rows, taus, WIDTH)
        or ladder.offsets.shape != (rows, levels)
        or ladder.marks.shape != (levels, slots)
        or ladder.marked.shape != (rows, taus, slots, 3)
        or any(one != rows for one in axes)
    ):
        raise ValueError("the arrays of a ladder are inconsistent")
    return *ladder, rows, levels, slots


def offset_near(offset: float, rise: float, samples: float) -> float:
    """Return a round number near the mean of samples that rise by `rise` above an offset.

    It has 24 bits, so that products with lags and strides are exact, and it is whole for integers,
    so that they stay integers.
    """
    mean = offset + rise / samples
    if rise == np.floor(rise) and offset == np.floor(offset):
        mean = np.floor(mean + 0.5)
    wide = 536870913.0 * mean
    return float(wide - (wide - mean))
