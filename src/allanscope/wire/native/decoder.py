"""The host's end of the native protocol."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Event, GapReason
from allanscope.wire.base import LinkStats
from allanscope.wire.native.assembly import Assembler
from allanscope.wire.native.framing import Deframer
from allanscope.wire.native.kernel import batch_table
from allanscope.wire.native.table import FrameTable, table_of

__all__ = ["NativeDecoder"]

_SLICE = 1 << 22
"""Bytes read at a time: a piece of a replay, without a copy."""


class NativeDecoder:
    """Bytes of the native protocol to events.

    Parameters
    ----------
    batch : bool
        Whether to read with the compiled loop; frame by frame in plain Python gives the same.
    """

    def __init__(self, batch: bool = True) -> None:
        self.stats = LinkStats()
        self._batch = batch
        self._deframer = Deframer()
        self._assembler = Assembler(self.stats)

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        return self.feed_chunks(data, np.array([len(data)]), np.array([host_s]))

    def feed_chunks(
        self, data: bytes, ends: NDArray[np.int64], host_s: NDArray[np.float64]
    ) -> list[Event]:
        """Take many chunks at once; a recording is replayed this way.

        Parameters
        ----------
        data : bytes
            The chunks, one after another.
        ends : ndarray of int64, shape (c,)
            Where each chunk ends in `data`, ascending.
        host_s : ndarray of float64, shape (c,)
            When each chunk arrived.
        """
        self.stats.bytes += len(data)
        events: list[Event] = []
        for start in range(0, len(data), _SLICE):
            piece = data[start : start + _SLICE]
            table = self._read(piece)
            arrival = np.searchsorted(ends, table.ends + start)
            events += self._assembler.feed(table, host_s[arrival])
        self.stats.crc_errors = self._deframer.crc_errors
        self.stats.resyncs = self._deframer.malformed + self._assembler.repeats
        return events

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial frame, e.g. after an unplug; the next Block follows a Gap."""
        self._deframer.reset()
        self._assembler.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: never samples, at most a complaint."""
        return self._assembler.finish()

    def _read(self, data: bytes) -> FrameTable:
        if not self._batch:
            return table_of(self._deframer.feed(data))
        return batch_table(self._deframer, data)
