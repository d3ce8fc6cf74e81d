"""The ladder of rungs over the segments of a run: which taus it holds and how many terms each has.

`kernels` spends the samples; this file knows what the sums mean. One segment is open at a time.
Closing it settles the half-filled rungs, counts its terms and clears the rungs; sums and counts go
on. So a gap costs the terms that would have spanned it and nothing else, and two runs add up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.estimators.base import Sums
from allanscope.allan.kernels import (
    BATCH,
    COLUMNS,
    FREE,
    HEAD,
    MOMENTS,
    WIDTH,
    Ladder,
    add_block_sums,
    advance,
    restore_offsets,
    settle,
)
from allanscope.allan.moments import Pair, sample_variance, shifted, two_sum

__all__ = ["Cascade", "lags_of_level"]

_MOST_LEVELS = 56
"""More would bring averaging factors that no int64 holds."""


def lags_of_level(level: int, per_octave: int) -> NDArray[np.int64]:
    """Return m / stride for the taus of one rung, ascending.

    Rung 0 has every averaging factor below 64, the others one octave from 32 up.

    Examples
    --------
    >>> lags_of_level(0, 2).tolist()
    [1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45]
    >>> lags_of_level(7, 2).tolist()
    [32, 45]
    """
    octaves = np.arange(5 * per_octave if level else 0, 6 * per_octave)
    lags = np.unique(np.round(2.0 ** (octaves / per_octave)).astype(np.int64))
    return lags[lags < 64]


class Cascade:
    """Sums of all lagged differences of a run, exact below m = 64, thinned by 2^L above.

    Parameters
    ----------
    axes : int
        Number of axes.
    per_octave : int
        Averaging factors in each octave.
    slots : int
        Marks that a rung may have at a time: see `allanscope.allan.dynamic`.

    Attributes
    ----------
    m, stride : ndarray of int64, shape (taus,)
        Averaging factor, and step between the terms of the overlapping estimators, in samples.
    samples : int
        Samples taken in so far.
    taken : int
        Those of the open segment.

    Examples
    --------
    OAVAR of the rates 0 1 3 2 at m = 1 is half the mean square difference, of 1 4 1:

    >>> cascade = Cascade(axes=1, per_octave=1)
    >>> cascade.extend(np.array([[0.0], [1.0], [3.0], [2.0]]))
    >>> oadev = cascade.settled().variances("oadev")
    >>> oadev.m.tolist(), oadev.variance.tolist(), oadev.terms.tolist()
    ([1, 2], [[1.0, 2.0]], [[3, 1]])
    """

    def __init__(self, axes: int, per_octave: int, slots: int = 0) -> None:
        self.axes = axes
        self.per_octave = per_octave
        self.samples = 0
        self.taken = 0
        self.levels = 0
        self.lags = np.empty(0, np.int64)
        self.first = np.zeros(1, np.int64)
        self.rungs = np.zeros((axes, 0, 3, 2 * BATCH))
        self.heads = np.zeros((axes, 0, HEAD))
        self.sums = np.zeros((axes, 0, WIDTH))
        self.offsets = np.zeros((axes, 0))
        self.counts = np.zeros((0, 3, len(COLUMNS)), np.int64)
        self.marks = np.zeros((0, slots), np.int64)
        self.marked = np.zeros((axes, 0, slots, 3))
        self.grow(1)

    def grow(self, levels: int) -> None:
        """Add rungs until there are `levels`."""
        for level in range(self.levels, levels):
            lags = lags_of_level(level, self.per_octave)
            self.lags = np.append(self.lags, lags)
            self.first = np.append(self.first, self.lags.size)
        missing = max(levels - self.levels, 0)
        taus = self.lags.size - self.counts.shape[0]
        self.levels += missing
        self.rungs = _extended(self.rungs, missing, axis=1)
        self.heads = _extended(self.heads, missing, axis=1)
        self.offsets = _extended(self.offsets, missing, axis=1)
        self.sums = _extended(self.sums, taus, axis=1)
        self.counts = _extended(self.counts, taus, axis=0)
        self.marks = _extended(self.marks - FREE, missing, axis=0) + FREE
        self.marked = _extended(self.marked, taus, axis=1)

    @property
    def stride(self) -> NDArray[np.int64]:
        """Step between terms in samples, shape (taus,)."""
        return np.repeat(1 << np.arange(self.levels), np.diff(self.first))

    @property
    def m(self) -> NDArray[np.int64]:
        """Averaging factors in samples, shape (taus,)."""
        return self.lags * self.stride

    def factors_near(self, m: float) -> NDArray[np.int64]:
        """Return the averaging factors around `m`, whether they are reached yet or not."""
        level = max(int(np.log2(max(m, 1.0) / 32.0)), 0)
        near = [lags_of_level(i, self.per_octave) << i for i in range(max(level - 1, 0), level + 2)]
        return np.concatenate(near)

    def missing(self, kind: str, m: int, terms: int) -> int:
        """Return how many samples more of the open segment bring the terms at `m` to a number.

        Parameters
        ----------
        kind : str
            One of `COLUMNS`.
        m : int
            One of the averaging factors.
        terms : int
            Of all segments together.
        """
        level = max((m >> 5).bit_length() - 1, 0)
        k = m >> level
        index = np.flatnonzero(self.m == m)
        wanted = terms - int(self.counts[index, 0, COLUMNS.index(kind)].sum())
        if wanted <= 0:
            return 0
        entries = _entries_with(kind, wanted, k, first=level == 0)
        return max((entries << level) - self.taken, 0)

    def extend(self, samples: NDArray[Any], anchor: NDArray[np.float64] | None = None) -> None:
        """Take in the next samples, shape (n, axes), which lie above the anchor of each axis."""
        n = len(samples)
        self.make_room(n)
        advance(
            samples, np.zeros(self.axes) if anchor is None else anchor, self.taken, self.ladder()
        )
        self.samples += n
        self.taken += n

    def make_room(self, samples: int) -> None:
        """Add the rungs that so many samples more need, before the one below hands up to them."""
        self.grow(((self.taken + samples) // 32).bit_length())

    def close(self) -> None:
        """End the segment: what comes next is no neighbour of what came before."""
        if self.taken:
            settle(self.taken, self.ladder())
            terms = self._terms_of_segment()
            has_any = terms > 0
            self.counts += np.stack([terms, has_any, has_any * self.taken], axis=1)
            self.taken = 0

    def settled(self) -> Cascade:
        """Return a closed copy."""
        copy = Cascade.__new__(Cascade)
        copy.__dict__.update(self.__dict__)
        copy.rungs, copy.heads = self.rungs.copy(), self.heads.copy()
        copy.sums, copy.counts = self.sums.copy(), self.counts.copy()
        copy.offsets = self.offsets.copy()
        copy.marks, copy.marked = self.marks.copy(), self.marked.copy()
        copy.close()
        return copy

    def merge(self, other: Cascade, shift: NDArray[np.float64]) -> None:
        """Add the sums of another closed run whose anchor lies `shift` (axes,) above this one's."""
        self.close()
        self.grow(other.levels)
        taus = other.lags.size
        theirs, terms = other.sums.copy(), other.counts[:, 0]
        step = shift[:, np.newaxis] * other.m
        for kind in MOMENTS:
            number = terms[:, COLUMNS.index(kind)].astype(np.float64)
            _set_moments(theirs, kind, *shifted(number, *_moments(theirs, kind), step))
        self._add(theirs)
        self.counts[:taus] += other.counts
        self.samples += other.samples

    def join(self, low: Cascade, block_sums: NDArray[np.float64], start: int) -> None:
        """Go on with a shard of the open segment: see `allanscope.allan.shard`.

        Parameters
        ----------
        low : Cascade
            The low rungs at the end of the shard, and the sums of the shard on them.
        block_sums : ndarray, shape (axes, k, 3)
            Sums of blocks of 2^(number of low rungs) samples, for the rungs above.
        start : int
            Samples of the segment before the shard: `taken`.
        """
        if start != self.taken:
            raise ValueError(f"the shard begins at {start}, {self.taken} samples are here")
        count = block_sums.shape[1] << low.levels
        self.grow(((start + count) // 32).bit_length())
        restore_offsets(self.ladder())
        restore_offsets(low.ladder())
        self.rungs[:, : low.levels] = low.rungs
        self.offsets[:, : low.levels] = low.offsets
        if start == 0:
            self.heads[:, : low.levels] = low.heads
        self._add(low.sums)
        add_block_sums(block_sums, low.levels, start >> low.levels, self.ladder())
        self.samples += count
        self.taken += count

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything that changes, by name."""
        return {
            "cascade": np.array([self.samples, self.taken], np.int64),
            "rungs": self.rungs,
            "heads": self.heads,
            "sums": self.sums,
            "offsets": self.offsets,
            "counts": self.counts,
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what `arrays` returned; ValueError when that does not fit together."""
        samples, taken = arrays["cascade"].tolist()
        self.grow(min(arrays["rungs"].shape[1], _MOST_LEVELS))
        shapes = [(name, array.shape) for name, array in self.arrays().items()]
        if shapes != [(name, arrays[name].shape) for name, _ in shapes] or not (
            0 <= taken <= samples and (taken // 32).bit_length() <= self.levels
        ):
            raise ValueError("state of a bank is damaged: its sums are inconsistent")
        self.samples, self.taken = samples, taken
        self.rungs, self.heads = arrays["rungs"], arrays["heads"]
        self.sums, self.counts = arrays["sums"], arrays["counts"]
        self.offsets = arrays["offsets"]

    def variances(self, kind: str) -> Sums:
        """Return the variances of one of `COLUMNS` for tau0 = 1, where they have a term at all.

        The run must be closed: see `settled`.
        """
        column = COLUMNS.index(kind)
        have = self.counts[:, 0, column] > 0
        terms, segments, covered = self.counts[have, :, column].T
        m, sums = self.m[have].astype(np.float64), self.sums[:, have]
        squares = sums[..., column]
        match kind:
            case "stdev" | "ostdev":
                variance = sample_variance(terms.astype(np.float64), *_moments(sums, kind)) / m**2
            case "adev" | "oadev":
                variance = squares / terms / (2.0 * m**2)
            case "totdev":
                variance = (squares + sums[..., COLUMNS.index("oadev")]) / terms / (2.0 * m**2)
            case "hdev" | "ohdev":
                variance = squares / terms / (6.0 * m**2)
            case "mdev":
                variance = squares / terms / (2.0 * m**4)
            case _:
                variance = 72.0 * squares / terms / m**6
                # A line through one point has no slope: at m = 1 PDEV is OADEV by definition.
                allan = sums[..., COLUMNS.index("oadev")] / terms / 2.0
                variance = np.where(m == 1, allan, variance)
        apart = kind in ("stdev", "adev", "hdev")
        return Sums(
            m=self.m[have],
            variance=variance,
            terms=np.broadcast_to(terms, variance.shape),
            stride=(self.m if apart else self.stride)[have],
            n=self.samples,
            segments=segments,
            covered=covered,
        )

    def ladder(self) -> Ladder:
        """Return the arrays as loops take them."""
        return Ladder(
            *(self.rungs, self.heads, self.lags, self.first, self.sums, self.offsets),
            *(self.marks, self.marked),
        )

    def _add(self, theirs: NDArray[np.float64]) -> None:
        """Add sums at the first taus, those of w without losing a digit."""
        ours = self.sums[:, : theirs.shape[1]]
        moments = {kind: (_moments(ours, kind), _moments(theirs, kind)) for kind in MOMENTS}
        ours += theirs
        for kind, (mine, other) in moments.items():
            pairs = []
            for one, more in zip(mine, other, strict=True):
                high, low = two_sum(one[0], more[0])
                pairs.append((high, low + (one[1] + more[1])))
            _set_moments(ours, kind, *pairs)

    def _terms_of_segment(self) -> NDArray[np.int64]:
        """Return how many terms of each of `COLUMNS` the open segment has, shape (taus, 9)."""
        k = self.lags
        entries = self.taken // self.stride
        counts = {
            "ostdev": entries - k + 1,
            "oadev": entries - 2 * k + 1,
            "ohdev": entries - 3 * k + 1,
            "mdev": entries - 3 * k + 1 + (self.stride == 1),
            "pdev": entries - 2 * k + 1,
            "stdev": entries // k,
            "adev": entries // k - 1,
            "hdev": entries // k - 2,
            "totdev": np.where(entries >= k, entries - 1, 0),
        }
        terms: NDArray[np.int64] = np.column_stack([counts[kind] for kind in COLUMNS])
        return np.maximum(terms, 0)


def _entries_with(kind: str, terms: int, k: int, *, first: bool) -> int:
    """Return how many entries of a rung have so many terms: see `_terms_of_segment`."""
    entries = {
        "ostdev": terms + k - 1,
        "oadev": terms + 2 * k - 1,
        "ohdev": terms + 3 * k - 1,
        "mdev": terms + 3 * k - 1 - first,
        "pdev": terms + 2 * k - 1,
        "stdev": terms * k,
        "adev": (terms + 1) * k,
        "hdev": (terms + 2) * k,
        "totdev": max(terms + 1, k),
    }
    return entries[kind]


def _moments(sums: NDArray[np.float64], kind: str) -> tuple[Pair, Pair]:
    """Return the sum of w and that of its squares, shape (axes, taus) each."""
    a, b, c, d = np.moveaxis(sums[..., MOMENTS[kind] + 2 : MOMENTS[kind] + 6], -1, 0).copy()
    return (a, b), (c, d)


def _set_moments(sums: NDArray[np.float64], kind: str, first: Pair, second: Pair) -> None:
    sums[..., MOMENTS[kind] + 2 : MOMENTS[kind] + 6] = np.stack([*first, *second], axis=-1)


def _extended(array: NDArray[Any], count: int, axis: int) -> NDArray[Any]:
    """Return the array with `count` more rows of nought."""
    if count == 0:
        return array
    width = [(0, count) if i == axis else (0, 0) for i in range(array.ndim)]
    return np.pad(array, width)
