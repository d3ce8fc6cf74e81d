"""DataLog, the text that ST's SensorTile sends out of the box.

::

    bytes ─▶ lines ─▶ records ─▶ milli (mdps, mg to counts) ─▶ rows (losses, Blocks)

It has no number, no checksum and no scale: losses are counted from the time stamps, and the
counts of the gyroscope are recovered from its integer mdps. Every generation prints the same things
in other words::

    V2.0, V2.2   TimeStamp: 1234 / Acc_X: 1, Acc_Y: 2, Acc_Z :3 / Gyro_X:4, ... / Press:.., Temp:..
    V1.1         TimeStamp: 12:34:56.78 / ACC_X: 1, ACC_Y: 2, ACC_Z: 3 / GYR_X: 4, ... / TEMP: 24.5

The firmware writes through a ring without an overflow check: when the host is slow, lines are cut
anywhere. So a line counts only when all of it fits, and a record only when its time, its
accelerometer and its gyroscope line came in this order.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from allanscope.samples import AXES, Block, Event, GapReason, StreamInfo
from allanscope.wire.base import (
    LinkStats,
    OneWayEncoder,
    WireFormat,
    WireSettings,
    device_times,
    temperatures_at,
)
from allanscope.wire.lines import Lines
from allanscope.wire.milli_units import MilliUnits, to_milli_units
from allanscope.wire.row_events import RowEvents
from allanscope.wire.timestamps import WrappingCounter

__all__ = [
    "CLOCK",
    "COUNTER",
    "DataLog1Format",
    "DataLogDecoder",
    "DataLogEncoder",
    "DataLogFormat",
    "Record",
    "RecordReader",
]

_USUAL_RATES = (25.0, 50.0, 100.0)
_LSM303AGR_MG = 3.9
"""DataLog 2.0 reads its accelerometer from the LSM303AGR, in steps of 3.9 mg."""
COUNTER = re.compile(rb"\s*TimeStamp\s*:\s*(-?\d{1,10})\s*")
CLOCK = re.compile(rb"\s*TimeStamp\s*:\s*(\d\d):(\d\d):(\d\d)\.(\d\d)\s*")

_VALUE = rb"\s*:\s*(-?\d{1,8})\s*"
_TRIPLE = re.compile(
    rb"\s*(acc|gyro|gyr|magn|mag)_X" + _VALUE + rb",\s*\1_Y" + _VALUE + rb",\s*\1_Z" + _VALUE,
    re.IGNORECASE,
)
_NUMBER = rb"-?\d{1,5}\.-?\d{1,3}"
_TEMPERATURE = re.compile(
    rb"\s*(?:Press\s*:\s*" + _NUMBER + rb"\s*,)?\s*Temp\s*:\s*(" + _NUMBER + rb")\s*"
    rb"(?:,\s*Hum\s*:\s*" + _NUMBER + rb"\s*)?",
    re.IGNORECASE,
)
_IGNORED = re.compile(
    rb"\s*(?:(?:Press|Hum)\s*:\s*" + _NUMBER + rb"|V\s*:\s*\d+\s*mV\s*Chrg\s*:\s*\d+\s*%)\s*",
    re.IGNORECASE,
)


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
            polled=True,
        )
        self._rows = RowEvents(self.stats, units.decide)

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        self.stats.bytes += len(data)
        self._host_s = host_s
        dropped = self._lines.dropped
        for line in self._lines.feed(data):
            self._line(line)
        if self._lines.dropped > dropped:
            self._damage(self._lines.dropped - dropped)
        return self._rows.events()

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial record, e.g. after an unplug; the next Block follows a Gap."""
        self._lines.reset()
        self._reader.flush()
        self._stamps = self._new_stamps()
        self._rows.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: the last record, if it is whole."""
        last = self._lines.flush()
        if last:
            self._line(last)
        self._add(self._reader.flush())
        return self._rows.events(final=True)

    def _line(self, line: bytes) -> None:
        before = self._reader.damaged
        self._add(self._reader.line(line))
        if self._reader.damaged > before:
            self._damage(self._reader.damaged - before)

    def _damage(self, times: int) -> None:
        self.stats.resyncs += times
        self._rows.note_damage()

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

    def _new_stamps(self) -> WrappingCounter:
        return (
            WrappingCounter(24 * 3600 * 100, 100.0)
            if self._clock
            else WrappingCounter(1 << 32, 1000.0)
        )


@dataclass(slots=True)
class Record:
    """One record while it is being read.

    Attributes
    ----------
    stamp : tuple of bytes
        The numbers of the time stamp, not yet interpreted.
    accel, gyro : tuple of float or None
        mg and mdps.
    temperature_c : float
        NaN while none has come.
    """

    stamp: tuple[bytes, ...]
    accel: tuple[float, ...] | None = None
    gyro: tuple[float, ...] | None = None
    temperature_c: float = field(default=float("nan"))

    @property
    def complete(self) -> bool:
        """Whether both sensors have come."""
        return self.accel is not None and self.gyro is not None


class RecordReader:
    """Lines to records.

    Parameters
    ----------
    stamp : pattern
        `COUNTER` or `CLOCK`.

    Attributes
    ----------
    damaged : int
        Lines that fit nothing, and records that were not complete.
    """

    def __init__(self, stamp: re.Pattern[bytes]) -> None:
        self.damaged = 0
        self._stamp = stamp
        self._open: Record | None = None

    def line(self, line: bytes) -> Record | None:
        """Take a line and return the record that it completes."""
        if match := self._stamp.fullmatch(line):
            before = self.flush()
            self._open = Record(match.groups())
            return before
        if match := _TRIPLE.fullmatch(line):
            self._triple(match)
        elif match := _TEMPERATURE.fullmatch(line):
            return self._temperature(match)
        elif not _IGNORED.fullmatch(line):
            self.damaged += 1
        return None

    def flush(self) -> Record | None:
        """Return the record that is open, if it is complete, and forget it."""
        record, self._open = self._open, None
        if record is None:
            return None
        if not record.complete:
            self.damaged += 1
            return None
        return record

    def _triple(self, match: re.Match[bytes]) -> None:
        sensor = match[1][:1].lower()
        if sensor == b"m":
            return
        values = tuple(float(match[i]) for i in (2, 3, 4))
        record = self._open
        if record is not None and sensor == b"a" and record.accel is None:
            record.accel = values
        elif record is not None and sensor == b"g" and record.accel and record.gyro is None:
            record.gyro = values
        else:
            # A second line of a kind, or one without its time: part of the record got lost.
            self.damaged += 1
            self._open = None

    def _temperature(self, match: re.Match[bytes]) -> Record | None:
        if self._open is None:
            return None
        # V1.1 prints "%d.%02d" of two integers, so half a degree below zero reads "0.-50".
        whole, _, hundredths = match[1].partition(b".")
        sign = -1.0 if b"-" in match[1] else 1.0
        fraction = hundredths.lstrip(b"-")
        size = abs(int(whole)) + int(fraction) / 10 ** len(fraction)
        self._open.temperature_c = sign * size
        return self.flush()


_ROOM_C = 25.0
_DAY = 24 * 3600 * 100


class DataLogEncoder(OneWayEncoder):
    """Blocks to DataLog text.

    Parameters
    ----------
    clock : bool
        Whether to write version 1.1, with the time of day, instead of version 2.
    """

    def __init__(self, clock: bool) -> None:
        super().__init__(StreamInfo(AXES, (70e-3,) * 3 + (0.061e-3,) * 3, 50.0))
        self._clock = clock

    def encode(self, block: Block) -> bytes:
        """Return one record a row; it always names both sensors, an absent one reads 0."""
        rows = np.arange(len(block))
        seconds = device_times(block, rows, self._info.nominal_hz)
        degrees = np.nan_to_num(temperatures_at(block, rows), nan=_ROOM_C)
        per_second = 100 if self._clock else 1000
        stamps = np.round(seconds * per_second).astype(np.int64).tolist()
        values = to_milli_units(block, self._info).tolist()
        write = _version_1 if self._clock else _version_2
        text = "".join(map(write, stamps, values, degrees.tolist()))
        return text.encode("ascii")


def _version_2(milliseconds: int, values: list[int], degrees: float) -> str:
    gx, gy, gz, ax, ay, az = values
    stamp = (milliseconds + 2**31) % 2**32 - 2**31  # printed with %d: negative after 24.8 days
    return (
        f"TimeStamp: {stamp}\r\n"
        f" Acc_X: {ax}, Acc_Y: {ay}, Acc_Z :{az}\r\n"
        f" Gyro_X:{gx}, Gyro_Y:{gy}, Gyro_Z:{gz}\r\n"
        f" Magn_X:0, Magn_Y:0, Magn_Z:0\r\n"
        f" Press:1013.25, Temp:{degrees:5.2f}, Hum:40.0\r\n"
    )


def _version_1(hundredths: int, values: list[int], degrees: float) -> str:
    gx, gy, gz, ax, ay, az = values
    seconds, cc = divmod(hundredths % _DAY, 100)
    minutes, ss = divmod(seconds, 60)
    hh, mm = divmod(minutes, 60)
    # Whole and hundredths are printed as two integers, each with the sign of the number.
    number = round(degrees * 100)
    sign = "-" if number < 0 else ""
    whole, part = divmod(abs(number), 100)
    lead = f"{sign if whole else ''}{whole}.{sign}{part:02d}"
    return (
        f"\nTimeStamp: {hh:02d}:{mm:02d}:{ss:02d}.{cc:02d}"
        f"\n\rACC_X: {ax}, ACC_Y: {ay}, ACC_Z: {az}"
        f"\n\rGYR_X: {gx}, GYR_Y: {gy}, GYR_Z: {gz}"
        f"\n\rMAG_X: 0, MAG_Y: 0, MAG_Z: 0"
        f"\n\rHUM: 40.00\n\rTEMP: {lead}\n\rPRESS: 1013.25\n\rV: 3700mV Chrg: 80%"
    )


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
        return float(any(records) or bool(reader.flush()))


@dataclass(frozen=True, slots=True)
class DataLog1Format(DataLogFormat):
    """The same of 2016, with the time of day."""

    name: str = "datalog11"
    summary: str = "text of ST's DataLog firmware, version 1.1"
    clock: bool = True
