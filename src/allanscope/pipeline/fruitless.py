"""Bytes that bring no samples: the watchdog counts samples, because garbage is bytes too."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Block, Event, Notice
from allanscope.wire import LinkStats

__all__ = ["FRUITLESS_S", "Fruitless"]

FRUITLESS_S = 3.0
"""Bytes that come for so long without a sample are worth a line."""


class Fruitless:
    """Follow a stream and know for how long its bytes have brought no samples.

    Attributes
    ----------
    told : bool
        Whether it has been said and no sample has come since.
    """

    def __init__(self) -> None:
        self.told = False
        self._described = True
        self._frames = 0
        self.restart()

    def restart(self) -> None:
        """Begin anew with the next bytes: a silence, or a port that was gone, is another story."""
        self._first_ns: int | None = None
        self._held_ns = self._last_ns = 0

    @property
    def long(self) -> bool:
        """Whether bytes have come for too long since the last sample, if there was one."""
        return self._first_ns is not None and self._last_ns - self._first_ns > FRUITLESS_S * 1e9

    def take(self, events: list[Event], read_ns: NDArray[np.int64]) -> None:
        """Take what some reads were decoded to, with the host time of each; 0 is unknown."""
        if not read_ns[0]:
            return  # a file: nothing comes late
        self._last_ns = int(read_ns[-1])
        for event in events:
            if isinstance(event, Notice) and "wanted" in event.fields:
                self._described = False
        sample_ns = _last_sample_ns(events)
        if sample_ns:
            self.told, self._described, self._first_ns = False, True, None
        later = read_ns[read_ns > sample_ns]
        if self._first_ns is None and len(later):
            self._first_ns = int(later[0])

    def news(self, stats: LinkStats, framed: bool) -> str:
        """Return what is to be said now, once; empty when all is well.

        Parameters
        ----------
        stats : LinkStats
            Counters of the decoder.
        framed : bool
            Whether frames may hold no samples. In all other formats one is a row, and rows are
            held back until it is known what they mean.
        """
        if not framed and stats.frames > self._frames:
            self._held_ns = self._last_ns
        self._frames = stats.frames
        held = self._last_ns - self._held_ns <= FRUITLESS_S * 1e9
        if self.told or held or not self.long:
            return ""
        return self.text()

    def text(self) -> str:
        """Say it."""
        self.told = True
        why = "" if self._described else ": no descriptor says what they mean"
        return (
            f"bytes arrive, but nothing could be decoded for {FRUITLESS_S:g} s{why}; "
            "how many samples are lost is not known"
        )


def _last_sample_ns(events: list[Event]) -> int:
    """Return when the last sample came, in ns of the host's clock, a little late; 0 without one."""
    for event in reversed(events):
        if isinstance(event, Block):
            known = event.ticks.host_s[np.isfinite(event.ticks.host_s)]
            if len(known):
                return round(float(known[-1]) * 1e9) + 1000  # seconds are less exact than ns
    return 0
