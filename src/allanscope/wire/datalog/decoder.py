"""DataLog text to events."""

from __future__ import annotations

import math
from typing import cast

from allanscope.samples import Event, GapReason
from allanscope.wire.base import LinkStats, WireSettings
from allanscope.wire.datalog.grammar import CLOCK, COUNTER, Record, RecordReader
from allanscope.wire.lines import Lines
from allanscope.wire.milli import MilliUnits
from allanscope.wire.rows import Rows
from allanscope.wire.stamps import Stamps

__all__ = ["DataLogDecoder"]

_USUAL_RATES = (25.0, 50.0, 100.0)
_LSM303AGR_MG = 3.9
"""DataLog 2.0 reads its accelerometer from the LSM303AGR, in steps of 3.9 mg."""


class DataLogDecoder:
    """Bytes of DataLog text to events.

    Parameters
    ----------
    settings : WireSettings
        What the user said about the device.
    clock : bool
        Whether the time stamps are those of version 1.1, a time of day.
    """

    def __init__(self, settings: WireSettings, clock: bool) -> None:
        self.stats = LinkStats()
        self._clock = clock
        self._lines = Lines()
        self._reader = RecordReader(CLOCK if clock else COUNTER)
        self._stamps = self._new_stamps()
        self._host_s = math.nan
        units = MilliUnits(
            "datalog11" if clock else "datalog",
            settings,
            usual_rates=_USUAL_RATES,
            time_resolution_s=1e-2 if clock else 1e-3,
            accel_choices=() if clock else (_LSM303AGR_MG,),
        )
        self._rows = Rows(self.stats, units.decide)

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        self.stats.bytes += len(data)
        self._host_s = host_s
        dropped = self._lines.dropped
        for line in self._lines.feed(data):
            self._line(line)
        if self._lines.dropped > dropped:
            self._damage(self._lines.dropped - dropped)
        return self._rows.take()

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial record, e.g. after an unplug; the next Block follows a Gap."""
        self._lines.reset()
        self._reader.rest()
        self._stamps = self._new_stamps()
        self._rows.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: the last record, if it is whole."""
        last = self._lines.rest()
        if last:
            self._line(last)
        self._add(self._reader.rest())
        return self._rows.take(final=True)

    def _line(self, line: bytes) -> None:
        before = self._reader.damaged
        self._add(self._reader.line(line))
        if self._reader.damaged > before:
            self._damage(self._reader.damaged - before)

    def _damage(self, times: int) -> None:
        self.stats.resyncs += times
        self._rows.damaged()

    def _add(self, record: Record | None) -> None:
        if record is None or record.gyro is None or record.accel is None:
            return
        self.stats.frames += 1
        numbers = [int(number) for number in record.stamp]
        if self._clock:
            hours, minutes, seconds, hundredths = numbers
            numbers = [((hours * 60 + minutes) * 60 + seconds) * 100 + hundredths]
        device_s = self._stamps.seconds(numbers[0])
        self._rows.add(record.gyro + record.accel, device_s, self._host_s, record.temperature_c)

    def _new_stamps(self) -> Stamps:
        return Stamps(24 * 3600 * 100, 100.0) if self._clock else Stamps(1 << 32, 1000.0)
