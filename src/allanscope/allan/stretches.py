"""Stretches of samples in place of samples: how the high rungs of a ladder go on from sums alone.

A stretch of s samples moves the running sums of a rung like

    q += s z + s^2/2 x + Q,     z += s x + Z,     x += X

(see `kernels`), so whoever has (X, Z, Q) of neighbouring stretches needs their samples no more to
go on with the rungs whose stride is s and above. Integers below 2^53 stay exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.kernels import BATCH, Ladder, offset_near, spend_batches, with_offset
from allanscope.compiled import njit

__all__ = ["add_rows", "hand_up", "stretches_of"]

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def stretches_of(samples: Floats, length: int) -> Floats:
    """Return (X, Z, Q) of each `length` samples of every axis, shape (axes, n // length, 3)."""
    axes, count = samples.shape[0], samples.shape[1] // length
    found = np.empty((axes, count, 3))
    for axis in range(axes):
        for i in range(count):
            x = z = q = 0.0
            for j in range(i * length, (i + 1) * length):
                q += z + 0.5 * x
                z += x
                x += samples[axis, j]
            found[axis, i, 0], found[axis, i, 1], found[axis, i, 2] = x, z, q
    return found


@njit(cache=True, nogil=True)
def hand_up(stretches: Floats, level: int, taken: int, ladder: Ladder) -> None:
    """Take stretches of 2^level samples in at a rung, as the rung below would hand them up.

    Parameters
    ----------
    stretches : ndarray, shape (axes, k, 3)
        What follows the `taken` stretches that this segment had before.
    level : int
        The rung; those below it are left alone.
    taken : int
        Entries that the rung has taken in.
    ladder : Ladder
        Changed in place.
    """
    s = 2.0**level
    half = 0.5 * s * s
    for axis in range(stretches.shape[0]):
        rung = ladder.rungs[axis, level]
        done, count = 0, taken
        if taken == 0 and stretches.shape[1] > 0:
            rise = stretches[axis, :, 0].sum()
            ladder.offsets[axis, level] = offset_near(0.0, rise, s * stretches.shape[1])
        while done < stretches.shape[1]:
            at = BATCH + count % BATCH
            size = min(2 * BATCH - at, stretches.shape[1] - done)
            x, z, q = rung[0, at - 1], rung[1, at - 1], rung[2, at - 1]
            own = stretches[axis, done : done + size].copy()
            for j in range(size):
                with_offset(own[j].reshape(3, 1), 1, s, -ladder.offsets[axis, level])
            for j in range(size):
                more = own[j]
                q += s * z + half * x + more[2]
                z += s * x + more[1]
                x += more[0]
                rung[0, at + j], rung[1, at + j], rung[2, at + j] = x, z, q
            done += size
            count += size
            if count % BATCH == 0:
                spend_batches(ladder, axis, level, count // BATCH)


@njit(cache=True, nogil=True)
def add_rows(
    stretches: Floats, length: int, rows: Floats, part: Floats, filled: int, stride: int
) -> None:
    """Fill rows (u, v) of an archive from stretches; `length` divides `stride` and `filled`."""
    for axis in range(stretches.shape[0]):
        u, v = part[axis]
        row, count = 0, filled
        for i in range(stretches.shape[1]):
            v += stretches[axis, i, 1] + length * u
            u += stretches[axis, i, 0]
            count += length
            if count == stride:
                rows[axis, 0, row], rows[axis, 1, row] = u, v
                row, count, u, v = row + 1, 0, 0.0, 0.0
        part[axis, 0], part[axis, 1] = u, v
