"""The lines of ST's DataLog text, and records made of them.

Every generation prints the same things in other words::

    V2.0, V2.2   TimeStamp: 1234 / Acc_X: 1, Acc_Y: 2, Acc_Z :3 / Gyro_X:4, ... / Press:.., Temp:..
    V1.1         TimeStamp: 12:34:56.78 / ACC_X: 1, ACC_Y: 2, ACC_Z: 3 / GYR_X: 4, ... / TEMP: 24.5

The firmware writes through a ring without an overflow check: when the host is slow, lines are torn
anywhere. So a line counts only when all of it fits, and a record only when its time, its
accelerometer and its gyroscope line came in this order.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

__all__ = ["CLOCK", "COUNTER", "Record", "RecordReader"]

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
            before = self.rest()
            self._open = Record(match.groups())
            return before
        if match := _TRIPLE.fullmatch(line):
            self._triple(match)
        elif match := _TEMPERATURE.fullmatch(line):
            return self._temperature(match)
        elif not _IGNORED.fullmatch(line):
            self.damaged += 1
        return None

    def rest(self) -> Record | None:
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
        return self.rest()
