"""DataLog, the text that ST's SensorTile sends out of the box.

::

    bytes ─▶ lines ─▶ decoder (records) ─▶ milli (mdps, mg to counts) ─▶ rows (losses, Blocks)

It has no number, no checksum and no scale: losses are told by the time stamps, and the counts of
the gyroscope are had back from its integer mdps.
"""

from __future__ import annotations

from dataclasses import dataclass

from allanscope.wire.base import WireFormat, WireSettings
from allanscope.wire.datalog.decoder import CLOCK, COUNTER, DataLogDecoder, RecordReader
from allanscope.wire.datalog.encoder import DataLogEncoder
from allanscope.wire.lines import Lines

__all__ = ["DataLog1Format", "DataLogDecoder", "DataLogEncoder", "DataLogFormat"]


@dataclass(frozen=True, slots=True)
class DataLogFormat(WireFormat):
    """What a SensorTile with the demonstration firmware sends as soon as it is plugged in."""

    name: str = "datalog"
    summary: str = "text of ST's DataLog firmware, versions 2.0 and 2.2"
    clock: bool = False

    def decoder(self, settings: WireSettings) -> DataLogDecoder:
        """Return a fresh decoder."""
        return DataLogDecoder(settings, self.clock)

    def encoder(self) -> DataLogEncoder:
        """Return a fresh encoder."""
        return DataLogEncoder(self.clock)

    def score(self, sample: bytes) -> float:
        """Return 1 when there is a whole record; no other text looks like one."""
        reader = RecordReader(CLOCK if self.clock else COUNTER)
        lines = Lines()
        records = [reader.line(line) for line in lines.feed(sample)]
        return float(any(records) or bool(reader.rest()))


@dataclass(frozen=True, slots=True)
class DataLog1Format(DataLogFormat):
    """The same of 2016, with the time of day."""

    name: str = "datalog11"
    summary: str = "text of ST's DataLog firmware, version 1.1"
    clock: bool = True
