"""What is summed up while the samples of one configuration pass by."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank
from allanscope.analysis.extremes import lowest_and_highest
from allanscope.analysis.gathering import ROOM, Gathering
from allanscope.analysis.lanes import side_by_side
from allanscope.clock import Clock
from allanscope.history import History
from allanscope.samples import Block, Gap, StreamInfo
from allanscope.spectrum.bank import SpectrumBank

__all__ = ["StreamState", "Temperature"]

FULL_COUNT = 32767
"""Largest int16 count: a sample there, or at the opposite end, says only `at least this much`."""


class Temperature:
    """The last temperature, held from tick to tick, and the extremes of the run."""

    def __init__(self) -> None:
        self.first = np.nan
        self.last = np.nan
        self.lowest = np.inf
        self.highest = -np.inf

    def at_samples(self, block: Block) -> NDArray[np.float64] | None:
        """Return the temperature at each sample of a block, or None where there never was one."""
        ticks = block.ticks
        seen = np.isfinite(ticks.temperature_c)
        if seen.any():
            values = ticks.temperature_c[seen]
            if np.isnan(self.first):
                self.first = float(values[0])
            held = np.concatenate([[self.last], values])
            bounds = np.concatenate([[0], ticks.offset[seen], [len(block)]])
            self.last = float(values[-1])
            self.lowest = min(self.lowest, float(values.min()))
            self.highest = max(self.highest, float(values.max()))
            return np.repeat(held, np.diff(bounds))
        return None if np.isnan(self.last) else np.full(len(block), self.last)

    def summary(self) -> dict[str, float]:
        """Return first, last, lowest and highest in degC; empty when none was seen."""
        if np.isnan(self.first):
            return {}
        return {
            "first": self.first,
            "last": self.last,
            "lowest": self.lowest,
            "highest": self.highest,
        }


class StreamState:
    """The running sums of one configuration: as small after a night as after a minute.

    Parameters
    ----------
    info : StreamInfo
        What the samples mean.
    per_octave : int
        Averaging times in each octave.
    history_rows : int
        Most rows of block means that are kept for what needs a time series.
    gathered_rows : int
        Rows that are summed up at a time.
    """

    def __init__(
        self, info: StreamInfo, per_octave: int, history_rows: int, gathered_rows: int = ROOM
    ) -> None:
        rate_hz = info.nominal_hz or 1.0
        columns = len(info.axes)
        self.info = info
        self.bank = AllanBank(rate_hz, axes=columns, per_octave=per_octave)
        self.spectrum = SpectrumBank(rate_hz, axes=columns)
        self.history = History(columns, history_rows)
        self.clock = Clock.of(info)
        self.temperature = Temperature()
        self.samples = 0
        self.lost = 0
        self.unknown_losses = 0
        self.segments = 0
        self.lowest = np.full(columns, np.inf)
        self.highest = np.full(columns, -np.inf)
        self.saturated = np.zeros(columns, np.int64)
        self.counted = True
        self._in_segment = False
        self._gathering = Gathering(gathered_rows)

    def block(self, block: Block) -> None:
        """Take a run of samples."""
        if not self._in_segment:
            self.segments += 1
            self._in_segment = True
        counts = block.counts
        self.counted = self.counted and np.issubdtype(counts.dtype, np.integer)
        self.samples += len(block)
        self.clock.update(block.index, block.ticks)
        temperature_c = self.temperature.at_samples(block)
        for piece in self._gathering.take(counts, temperature_c):
            self._sum_up(*piece)

    def gap(self, gap: Gap) -> None:
        """Take a hole."""
        self.settle()
        self._in_segment = False
        self.bank.gap()
        self.spectrum.gap()
        self.history.gap(gap.lost)
        self.clock.gap(gap)
        if gap.lost is None:
            self.unknown_losses += 1
        else:
            self.lost += gap.lost

    def settle(self) -> None:
        """Sum up what has been gathered; must come before any of the sums is read."""
        for piece in self._gathering.rest():
            self._sum_up(*piece)

    def _sum_up(self, counts: NDArray[Any], temperature_c: NDArray[np.float64] | None) -> None:
        def everything_else() -> None:
            self.spectrum.update(counts)
            self.history.update(counts, temperature_c)
            self._extremes(counts)

        side_by_side(len(counts), lambda: self.bank.update(counts), everything_else)

    def _extremes(self, counts: NDArray[Any]) -> None:
        lowest, highest = lowest_and_highest(counts)
        self.lowest = np.minimum(self.lowest, lowest)
        self.highest = np.maximum(self.highest, highest)
        if counts.dtype == np.int16:
            full = (lowest == -FULL_COUNT - 1) | (highest == FULL_COUNT)
            for column in np.flatnonzero(full):
                values = counts[:, column]
                at_end = (values == FULL_COUNT) | (values == -FULL_COUNT - 1)
                self.saturated[column] += int(np.count_nonzero(at_end))
