"""The sums of one part of a recording, in the order in which they are joined.

The first pass sums nothing up: instead it keeps the last samples, and how long segments are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank
from allanscope.allan.shard import ALIGNED, BLOCK, Shard
from allanscope.analysis import AnalyserSettings
from allanscope.samples import Block, Event, Gap, StreamInfo
from allanscope.spectrum import SpectrumBank, SpectrumShard

__all__ = ["NullSum", "PartSums", "TailBuffer"]

PER_OCTAVE = AnalyserSettings().per_octave


class PartSums:
    """Deviations and spectrum of one part.

    A part begins and ends anywhere in a segment; sums begin and end at multiples of `ALIGNED`
    samples of a segment. So it begins with the samples that the part before could not use, and
    leaves its own last ones to the next::

        part before   ...────────┤ALIGNED│rest│
        this part                        ├────┼──── piece ────┤rest│  segments │ piece ...
                                  halo    ^ from the cut        └ to where the segment ends

    Segments that begin and end in the part go to a bank of its own, which is merged as a whole.

    Parameters
    ----------
    anchor : ndarray, shape (axes,), or None
        First sample of the run; None when this part has it.
    taken : int
        Samples of the segment that is open at the cut.
    recent : ndarray, shape (n, axes)
        The last of them.
    """

    def __init__(
        self, anchor: NDArray[np.float64] | None, taken: int, recent: NDArray[Any]
    ) -> None:
        self._anchor = anchor
        self._joins: list[_Run | tuple[AllanBank, SpectrumBank]] = []
        self._run: _Run | None = None
        if taken:
            begin = taken - taken % ALIGNED
            halo = len(recent) - taken % ALIGNED
            self._run = _Run(begin, recent[:halo] if begin else None)
            self._run.add(recent[halo:], self._anchor)

    def feed(self, event: Event) -> None:
        """Take one event of the decoder."""
        match event:
            case StreamInfo():
                pass  # one configuration: the first pass has seen to it
            case Block() if len(event):
                if self._anchor is None:
                    self._anchor = event.counts[0].astype(np.float64)
                if self._run is None:
                    self._run = _Run(0, None)
                self._run.add(event.counts, self._anchor)
            case Gap():
                self._close()

    def finish(self, last: bool) -> None:
        """End the part; what does not fill a multiple of `ALIGNED` is the next part's."""
        if self._run is not None:
            self._run.rest = self._run.rest if last else []
            self._joins.append(self._run)
            self._run = None

    def join_to(self, bank: AllanBank, spectrum: SpectrumBank) -> None:
        """Bring the banks of all parts before up to the end of this one."""
        for one in self._joins:
            if isinstance(one, _Run):
                one.join_to(bank, spectrum)
            else:
                one[0].rate, one[1].rate = bank.rate, spectrum.rate
                bank.merge(one[0])
                spectrum.merge(one[1])

    def _close(self) -> None:
        """End a segment."""
        run, self._run = self._run, None
        if run is None:
            return
        run.closed = True
        if run.start:
            self._joins.append(run)
            return
        assert self._anchor is not None
        if not self._joins or isinstance(self._joins[-1], _Run):
            axes = len(self._anchor)
            new = (
                AllanBank(1.0, axes, PER_OCTAVE, anchor=self._anchor),
                SpectrumBank(1.0, axes, anchor=self._anchor),
            )
            self._joins.append(new)
        closed = self._joins[-1]
        assert isinstance(closed, tuple)
        run.join_to(*closed)


class _Run:
    """A run of samples of one segment: a piece, and the rest that fills no multiple of ALIGNED."""

    def __init__(self, start: int, halo: NDArray[Any] | None) -> None:
        self.start = start
        self.closed = False
        self.rest: list[NDArray[Any]] = []
        self._halo = halo
        self._pieces: tuple[Shard, SpectrumShard] | None = None

    def add(self, counts: NDArray[Any], anchor: NDArray[np.float64] | None) -> None:
        self.rest.append(counts)
        waiting = sum(map(len, self.rest))
        if waiting < ALIGNED:
            return
        assert anchor is not None
        if self._pieces is None:
            axes = len(anchor)
            self._pieces = (
                Shard(axes, PER_OCTAVE, anchor, self.start, self._halo),
                SpectrumShard(axes, anchor, self._halo),
            )
            self._halo = None
        joined = np.concatenate(self.rest)
        whole = waiting - waiting % ALIGNED
        for piece in self._pieces:
            piece.extend(joined[:whole])
        self.rest = [joined[whole:].copy()]

    def join_to(self, bank: AllanBank, spectrum: SpectrumBank) -> None:
        if self._pieces is not None:
            bank.join(self._pieces[0])
            spectrum.join(self._pieces[1])
        for counts in self.rest:
            bank.update(counts)
            spectrum.update(counts)
        if self.closed:
            bank.gap()
            spectrum.gap()


class TailBuffer:
    """The end of the open segment; takes samples and gaps as a bank does.

    Parameters
    ----------
    axes : int
        Number of columns.

    Attributes
    ----------
    anchor : ndarray, shape (axes,), or None
        First sample of the run.
    taken : int
        Samples of the open segment.
    """

    def __init__(self, axes: int) -> None:
        self.anchor: NDArray[np.float64] | None = None
        self.taken = 0
        self._rows = 0
        self._held = np.empty((0, axes))
        self._waiting: list[NDArray[Any]] = []

    def update(self, counts: NDArray[Any]) -> None:
        """Take in the next samples."""
        if not len(counts):
            return
        if self.anchor is None:
            self.anchor = counts[0].astype(np.float64)
        self.taken += len(counts)
        self._waiting.append(counts.copy())  # the room it came in is used again
        if sum(map(len, self._waiting)) > ALIGNED:
            self._held = self.recent()
            self._waiting = []

    def gap(self, lost: int = 0) -> None:
        """End the segment."""
        self._rows += self.taken // (BLOCK // 2)
        self.taken = 0
        self._held = self._held[:0]
        self._waiting = []

    def recent(self) -> NDArray[Any]:
        """Return the last samples, from `ALIGNED` before the last multiple of it on."""
        wanted = min(self.taken, self.taken % ALIGNED + ALIGNED)
        # An empty array of floats must not turn counts into floats.
        parts = [part for part in (self._held, *self._waiting) if len(part)]
        joined = np.concatenate(parts) if parts else self._held
        return joined[len(joined) - wanted :].copy()

    def rows_of_half_segment(self) -> int:
        """Return how many rows the archive of one pass would have at half the stride of ours."""
        return self._rows + self.taken // (BLOCK // 2)


class NullSum:
    """Takes samples and gaps, and keeps nothing."""

    def update(self, counts: NDArray[Any]) -> None:
        """Take in nothing."""

    def gap(self) -> None:
        """End nothing."""
