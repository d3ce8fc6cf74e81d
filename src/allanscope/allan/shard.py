"""A shard of one segment, summed up by itself, that a bank then takes in as if it had seen it.

The rungs of the cascade differ in how far they look back: a term on rung L spans up to 189 entries
of 2^L samples. What the low rungs need fits in a halo; what the high rungs need does not. So a
shard works on the `LEVELS` lowest rungs only, which do all but a thousandth of the work::

    halo ──▶ low rungs, whose sums are then thrown away: now their history is right
    shard ─┬▶ low rungs, terms that end in the shard, in batches that begin where one pass has them
           └▶ (X, Z, Q) of each `BLOCK` samples, for the high rungs and the archive

and the bank hands these sums up its own high rungs, in order. Each term is the same number as in
one pass, and every term is there once. Counts are equal; sums are of the same batches, added in
another order: for integer samples whose sums stay below 2^53 to the last bit, else to rounding.

A shard begins and ends where the highest low rung begins a batch: after a multiple of `ALIGNED`
samples of its segment. The sums of the modified totals and the Theo family come from the archive,
whose rows must not be finer than a block: see `AllanBank.join`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.cascade import Cascade
from allanscope.allan.kernels import BATCH, advance, offset_near
from allanscope.compiled import Pointer, kernel

__all__ = ["ALIGNED", "BLOCK", "LEVELS", "Shard"]

LEVELS = 10
"""Rungs that a shard works on."""

BLOCK = 1 << LEVELS
"""Samples of a block: the stride of the first rung above."""

ALIGNED = BATCH << (LEVELS - 1)
"""Samples from one possible end of a shard to the next, and samples of the halo."""

_SLICE = 1 << 14


class Shard:
    """Sums of the samples from `start` on, up to the next multiple of `ALIGNED` samples.

    Parameters
    ----------
    axes, per_octave : int
        As those of the bank.
    anchor : ndarray, shape (axes,)
        The bank's: the first sample of the run.
    start : int
        Samples of the segment that come before; a multiple of `ALIGNED`.
    halo : ndarray, shape (ALIGNED, axes), optional
        The last samples before `start`; not for a shard that begins its segment.

    Attributes
    ----------
    end : int
        Samples of the segment up to the end of what was taken in.
    block_sums : ndarray, shape (axes, k, 3)
        What the shard hands to the high rungs.
    cascade : Cascade
        The low rungs as one pass has them at `end`, and the sums of this shard alone.

    Raises
    ------
    ValueError
        For a start that is no multiple of `ALIGNED`, or a halo that does not fit.
    """

    def __init__(
        self,
        axes: int,
        per_octave: int,
        anchor: NDArray[np.float64],
        start: int = 0,
        halo: NDArray[np.generic] | None = None,
    ) -> None:
        if start % ALIGNED or (start > 0) != (halo is not None):
            raise ValueError(f"a shard starts at multiples of {ALIGNED}, with a halo; got {start}")
        self.anchor = np.array(anchor, np.float64)
        if self.anchor.shape != (axes,):
            raise ValueError(f"a shard of {axes} axes has as many anchors, got {anchor!r}")
        self.start = start
        self.end = start
        self.cascade = Cascade(axes, per_octave)
        self.cascade.grow(LEVELS)
        self._block_sums = [np.empty((axes, 0, 3))]
        if halo is not None:
            if halo.shape != (ALIGNED, axes):
                raise ValueError(f"a halo has shape {(ALIGNED, axes)}, got {halo.shape}")
            self.end -= ALIGNED
            for axis, level in enumerate(halo.mean(axis=0) - anchor):
                self.cascade.offsets[axis] = offset_near(0.0, float(np.round(level)), 1.0)
            self._advance(halo)
            self.cascade.sums[:] = 0.0
            self.cascade.heads[:] = 0.0

    @property
    def block_sums(self) -> NDArray[np.float64]:
        """What the shard hands to the high rungs, shape (axes, k, 3)."""
        return np.concatenate(self._block_sums, axis=1)

    def extend(self, samples: NDArray[np.generic]) -> None:
        """Take in the next samples, shape (n, axes), n a multiple of `ALIGNED`."""
        if samples.shape[1:] != (self.cascade.axes,) or len(samples) % ALIGNED:
            raise ValueError(
                f"a shard takes multiples of {ALIGNED} samples of {self.cascade.axes} axes, "
                f"got shape {samples.shape}"
            )
        for begin in range(0, len(samples), _SLICE):
            piece = samples[begin : begin + _SLICE]
            self._advance(piece)
            self._block_sums.append(_block_sums_of(piece, self.anchor))

    def _advance(self, samples: NDArray[np.generic]) -> None:
        """Feed the low rungs."""
        advance(samples, self.anchor, self.end, self.cascade.ladder())
        self.end += len(samples)


_block_sums = kernel(
    *("block_sums", Pointer(np.float64, 2), Pointer(np.float64, 1), int, int, int),
    Pointer(np.float64, 3, written=True),
)


def _block_sums_of(
    samples: NDArray[np.generic], anchor: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (X, Z, Q) of each block of every axis, shape (axes, n // BLOCK, 3)."""
    n, axes = samples.shape
    found = np.empty((axes, n // BLOCK, 3))
    _block_sums(np.ascontiguousarray(samples, np.float64), anchor, axes, n, BLOCK, found)
    return found
