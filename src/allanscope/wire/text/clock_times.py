"""Times that people can read: ``12:34:56.78`` and ``2024-05-17T12:34:56.789Z``."""

from __future__ import annotations

import math
import re
from datetime import date

__all__ = ["ClockTimes", "is_clock_time", "joined_dates"]

_WRITTEN = re.compile(
    r"(?:(\d{4})-(\d\d)-(\d\d)[T ])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d{1,12})?)"
    r"(?:Z|[+-]\d\d(?::?\d\d)?)?"
)
_DATE_AND_TIME = re.compile(rb"(\d{4}-\d\d-\d\d) +(?=\d{1,2}:\d\d:)")
_LONGEST = 48
_DAY_S = 86_400.0


def is_clock_time(cell: str) -> bool:
    """Return whether a cell is a time of day, with or without a date.

    >>> is_clock_time("00:00:01.20"), is_clock_time("12:30"), is_clock_time("2024-05-17T10:00:00Z")
    (True, False, True)
    """
    return len(cell) <= _LONGEST and _WRITTEN.fullmatch(cell) is not None


def joined_dates(line: bytes) -> bytes:
    """Return a line in which a date and the time after it are one cell.

    >>> joined_dates(b"2024-05-17 10:00:00.5 1 2")
    b'2024-05-17T10:00:00.5 1 2'
    """
    return _DATE_AND_TIME.sub(rb"\1T", line) if b":" in line else line


class ClockTimes:
    """Times of day to seconds that go on over midnight; with dates, from the first date on."""

    def __init__(self) -> None:
        self._first_day: int | None = None
        self._last_s = -math.inf
        self._midnights_s = 0.0

    def seconds(self, cell: str) -> float:
        """Return the time that is written in a cell.

        Raises
        ------
        ValueError
            If it is none, or no day of the calendar.

        Examples
        --------
        >>> clock = ClockTimes()
        >>> clock.seconds("23:59:59.5"), clock.seconds("00:00:00.5")
        (86399.5, 86400.5)
        """
        match = _WRITTEN.fullmatch(cell) if len(cell) <= _LONGEST else None
        if match is None:
            raise ValueError(f"{cell!r} is no time")
        of_day = 3600.0 * int(match[4]) + 60.0 * int(match[5]) + float(match[6].replace(",", "."))
        if match[1] is not None:
            day = date(int(match[1]), int(match[2]), int(match[3])).toordinal()
            self._first_day = day if self._first_day is None else self._first_day
            return _DAY_S * (day - self._first_day) + of_day
        if self._last_s - of_day - self._midnights_s > _DAY_S / 2:
            self._midnights_s += _DAY_S
        self._last_s = of_day + self._midnights_s
        return self._last_s
