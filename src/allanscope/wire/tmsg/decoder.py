"""TMsg messages to events."""

from __future__ import annotations

import math
from typing import cast

from allanscope.samples import Event, GapReason, Notice
from allanscope.sanitize import text_of
from allanscope.wire.base import LinkStats, WireSettings
from allanscope.wire.milli import MilliUnits
from allanscope.wire.row import Pairing
from allanscope.wire.rows import Rows
from allanscope.wire.stamps import Stamps
from allanscope.wire.tmsg.messages import (
    DEVICE,
    READ_PRESENTATION,
    REPLY,
    STREAM,
    Unwrapper,
    read_current,
    read_sensortile,
)

__all__ = ["TMsgDecoder"]

_USUAL_RATES = (12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1660.0)


class TMsgDecoder:
    """Bytes of the TMsg protocol to events.

    Parameters
    ----------
    settings : WireSettings
        What the user said about the device.
    sensortile : bool
        Whether messages have the fixed layout of the SensorTile's firmware.
    """

    def __init__(self, settings: WireSettings, sensortile: bool) -> None:
        self.stats = LinkStats()
        self._sensortile = sensortile
        self._unwrapper = Unwrapper()
        self._read = read_sensortile if sensortile else read_current
        units = MilliUnits(
            "tmsg-sensortile" if sensortile else "tmsg",
            settings,
            usual_rates=_USUAL_RATES,
            time_resolution_s=1e-2 if sensortile else 1e-6,
        )
        self._rows = Rows(self.stats, units.decide, checked=True)
        self._start_over()

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        self.stats.bytes += len(data)
        events: list[Event] = []
        for body in self._unwrapper.feed(data):
            if body is None:
                self.stats.crc_errors += 1
                self._rows.damaged()
            elif body[2] == STREAM:
                self._stream(body, host_s)
            else:
                events += self._rows.take()
                events += self._other(body)
        return events + self._rows.take()

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial message, e.g. after an unplug; the next Block follows a Gap."""
        self._unwrapper.reset()
        self._start_over()
        self._rows.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: rows that were held back."""
        return self._rows.take(final=True)

    def _start_over(self) -> None:
        self._stamps = Stamps(24 * 3600 * 100, 100.0) if self._sensortile else Stamps(1 << 32, 1e6)
        self._pairing = Pairing()
        self._temperature_c = math.nan

    def _stream(self, body: bytes, host_s: float) -> None:
        reading = self._read(body)
        if reading is None:
            self.stats.unknown += 1
            self._rows.damaged()
            return
        self.stats.frames += 1
        device_s = self._stamps.seconds(reading.stamp)
        if not math.isnan(reading.temperature_c):
            self._temperature_c = reading.temperature_c
        values = self._pairing.take(reading.gyro, reading.accel)
        if values is not None:
            self._rows.add(values, device_s, host_s, self._temperature_c)
            self._temperature_c = math.nan

    def _other(self, body: bytes) -> list[Event]:
        command = body[2] - REPLY
        if body[1] != DEVICE or command < 0:
            self.stats.unknown += 1
            return []
        self.stats.frames += 1
        said = text_of(body[3:]) if command == READ_PRESENTATION else body[3:].hex(" ")
        return [Notice("reply", f"command {command:#04x}: {said}".rstrip(": "))]
