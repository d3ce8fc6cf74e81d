"""The host's end of the native protocol."""

from __future__ import annotations

from typing import cast

from allanscope.samples import Event, GapReason
from allanscope.wire.base import LinkStats
from allanscope.wire.native.assembly import Assembler
from allanscope.wire.native.framing import Deframer
from allanscope.wire.native.table import table_of

__all__ = ["NativeDecoder"]


class NativeDecoder:
    """Bytes of the native protocol to events."""

    def __init__(self) -> None:
        self.stats = LinkStats()
        self._deframer = Deframer()
        self._assembler = Assembler(self.stats)

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        self.stats.bytes += len(data)
        frames = [(frame, host_s) for frame in self._deframer.feed(data)]
        self.stats.crc_errors = self._deframer.crc_errors
        self.stats.resyncs = self._deframer.malformed
        return self._assembler.take(table_of(frames)) if frames else []

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial frame, e.g. after an unplug; the next Block follows a Gap."""
        self._deframer.reset()
        self._assembler.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: never samples, at most a complaint."""
        return self._assembler.finish()
