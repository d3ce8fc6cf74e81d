"""A shard of one segment, averaged by itself, that a spectrum bank takes in as if it had seen it.

The low levels of the ladder look back less than a halo of `ALIGNED` samples; what leaves them
upwards, 1 / 256 of the samples, is kept and pushed up the bank's own high levels in order. Frames
and filters begin where one pass has them, because shards begin at multiples of `ALIGNED` samples:
the hop of the highest low level.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.spectrum.ladder import FACTOR, SEGMENT, Ladder, narrow_columns

__all__ = ["ALIGNED", "SpectrumShard"]

_LEVELS = 4

ALIGNED = SEGMENT * FACTOR ** (_LEVELS - 1)
"""Samples of the halo, and twice the hop of the highest level that a shard works on."""

_SLICE = 1 << 13


class SpectrumShard:
    """Periodograms of the samples that follow a halo.

    Parameters
    ----------
    axes : int
        Number of columns.
    anchor : ndarray, shape (axes,)
        The bank's: the first sample of the run.
    halo : ndarray, shape (ALIGNED, axes), optional
        The last samples before the shard; none for a shard that begins its segment.

    Attributes
    ----------
    ladder : Ladder
        The low levels.
    samples : int
        Taken in, without the halo.
    """

    def __init__(
        self,
        axes: int,
        anchor: NDArray[np.float64],
        halo: NDArray[np.generic] | None = None,
    ) -> None:
        self.anchor = anchor
        self.samples = 0
        self.ladder = Ladder(axes)
        self.ladder.grow(_LEVELS)
        self._above: list[NDArray[np.float32]] = []
        if halo is not None:
            self._push(halo)
            for level in self.ladder.levels:
                level.power[:] = 0.0
                level.count = 0
        self._above = [np.empty((axes, 0), np.float32)]

    @property
    def above(self) -> NDArray[np.float32]:
        """What goes to the level above, shape (axes, n)."""
        return np.concatenate(self._above, axis=1)

    def extend(self, samples: NDArray[np.generic]) -> None:
        """Take in the next samples, shape (n, axes)."""
        self._push(samples)
        self.samples += len(samples)

    def _push(self, samples: NDArray[np.generic]) -> None:
        for first in range(0, len(samples), _SLICE):
            part = narrow_columns(samples[first : first + _SLICE], self.anchor)
            for level, decimator in zip(self.ladder.levels, self.ladder.decimators, strict=True):
                level.push(part)
                part = decimator.push(part)
            self._above.append(part)
