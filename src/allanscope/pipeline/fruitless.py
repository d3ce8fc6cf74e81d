"""Bytes that bring no samples: the watchdog counts samples, because garbage is bytes too."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Block, Event, Notice
from allanscope.wire.base import LinkStats

__all__ = ["FRUITLESS_S", "Fruitless"]

FRUITLESS_S = 3.0
"""Bytes that come for so long without a sample are worth a line."""


class Fruitless:
    """Follow a stream and say, once each time, that its bytes bring no samples.

    Attributes
    ----------
    told : bool
        Whether it has been said and no sample has come since.
    """

    def __init__(self) -> None:
        self.told = False
        self._described = True
        self._frames = 0
        self._good_ns: int | None = None
        self._last_ns = 0

    def restart(self) -> None:
        """Begin anew with the next bytes: a silence, or a port that was gone, is another story."""
        self._good_ns = None
        self._last_ns = 0

    def watch(
        self, events: list[Event], read_ns: NDArray[np.int64], stats: LinkStats, native: bool
    ) -> str:
        """Take what some reads brought, and return what is to be said; empty when all is well.

        Parameters
        ----------
        events : list of Event
            What they were decoded to.
        read_ns : ndarray of int64, shape (n,)
            Host time of each read; 0 where it is not known.
        stats : LinkStats
            Counters of the decoder.
        native : bool
            Whether frames may hold no samples. In all other formats one is a row, and rows are
            held back until it is known what they mean.
        """
        begin, end = int(read_ns[0]), int(read_ns[-1])
        if not begin:
            return ""  # a file: nothing comes late
        since = begin if self._good_ns is None else self._good_ns
        good_ns = _sample_times(events) if native else np.empty(0, np.int64)
        if not native and stats.frames > self._frames:
            good_ns = np.array([end])
        self._frames = stats.frames
        self._described &= not any(
            isinstance(event, Notice) and "wanted" in event.fields for event in events
        )
        bounds = np.concatenate([[since], good_ns])
        # The last read before each sample that came, and the last of all.
        reads = np.concatenate([[max(since, self._last_ns)], read_ns])
        before = reads[np.searchsorted(read_ns, good_ns)]
        self._last_ns = end
        waited_ns = np.concatenate([before, [end]]) - bounds
        late = waited_ns > FRUITLESS_S * 1e9
        text = ""
        if late.any() and not (self.told and late.argmax() == 0 and late.sum() == 1):
            why = "" if self._described else ": no descriptor says what they mean"
            text = (
                f"bytes arrive, but nothing could be decoded for {FRUITLESS_S:g} s{why}; "
                "how many samples are lost is not known"
            )
        self.told = bool(late[-1])
        self._described |= bool(len(good_ns))
        self._good_ns = int(bounds[-1])
        return text


def _sample_times(events: list[Event]) -> NDArray[np.int64]:
    """Return when samples came, in ns of the host's clock."""
    times = [event.ticks.host_s for event in events if isinstance(event, Block)]
    if not times:
        return np.empty(0, np.int64)
    known = np.concatenate(times)
    return np.rint(known[np.isfinite(known)] * 1e9).astype(np.int64)
