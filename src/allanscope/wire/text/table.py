"""Rows of a table to values, as fast as plain Python can.

`Table` reads the rows of known columns; its cells hold numbers, with a decimal comma perhaps, or
times that people can read (`ClockTimes`): ``12:34:56.78``, ``1:34:56.78 PM`` and
``2024-05-17T12:34:56.789Z``.

Tables get a column of row numbers in front without a name, or a column less than was announced.
Where a header names one column more or fewer than the rows have cells, the values show which names
belong to which cells (`realigned`): a time goes up, gravity is 1 g.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import date
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import Pointer, kernel
from allanscope.wire.text.columns import Column, Columns
from allanscope.wire.text.units import DIVISORS, Quantity, unit_by_gravity

__all__ = ["ClockTimes", "PlainRows", "Table", "TableRow", "is_number", "joined_dates", "realigned"]

TableRow = tuple[tuple[float, ...], float, float]
"""Six values in the units of the text, the time in s if its unit is known, and degC."""

_SEPARATORS = (b"\t", b";", b",", b"|")
_LATEST_S = 1e12
_EXACT, _LONGEST_NUMBER = 2.0**53, 1e21
"""Whole numbers between these, nanoseconds since 1970 for instance, lose digits as float64. They
are counted from the first, as are those that are later in s than any time: nanoseconds since a
phone was switched on, milliseconds since 1970."""
_WARMTH = (-60.0, 150.0)
_WRITTEN_TIME = re.compile(
    r"(?:(\d{4})-(\d\d)-(\d\d)[T ])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d{1,12})?)"
    r"(?: ?([AaPp])\.?[Mm]\.?)?(?:Z|[+-]\d\d(?::?\d\d)?)?"
)
_TIME_AND_HALF = re.compile(rb"(:\d\d(?:[.,]\d+)?) +(?=[AaPp]\.?[Mm]\b)")
_DATE_AND_TIME = re.compile(rb"(\d{4}-\d\d-\d\d) +(?=\d{1,2}:\d\d:)")
_LONGEST_TIME = 48
_DAY_S = 86_400.0


def is_number(cell: str) -> bool:
    """Return whether a cell holds a number, with a point or a comma, or a time of day.

    >>> [is_number(cell) for cell in ("-1,5e3", "00:00:01.20", "2024-05-17T10:00:00Z")]
    [True, True, True]
    >>> [is_number(cell) for cell in ("gx", "12:30", "")]
    [False, False, False]
    """
    try:
        float(cell.replace(",", ".", 1))
    except ValueError:
        return _is_clock_time(cell)
    return True


class PlainRows(NamedTuple):
    """Rows that were read together, and how much of the text they are.

    Attributes
    ----------
    values : ndarray, shape (n, 6)
    time_s, degrees : ndarray, shape (n,)
    size : int
        Bytes, with the line feed of the last row.
    newlines : int
        Line feeds among them.
    """

    values: NDArray[np.float64]
    time_s: NDArray[np.float64]
    degrees: NDArray[np.float64]
    size: int
    newlines: int


_INTS_OUT = Pointer(np.int64, 1, written=True)
_read_rows = kernel(
    "read_rows",
    *(Pointer(np.uint8, 1), int, int, int, Pointer(np.uint8, 1), int),
    *(Pointer(np.float64, 2, written=True), _INTS_OUT, _INTS_OUT),
    returns=int,
)


class Table:
    """Reads rows of known columns.

    Parameters
    ----------
    columns : Columns
        What the header says, or the assumptions without one.
    time_unit : str
        Unit of the time where the user gave one; empty to go by the header.

    Attributes
    ----------
    rows : int
        Rows read so far.
    """

    def __init__(self, columns: Columns, time_unit: str = "") -> None:
        self.columns = columns
        self._count = len(columns)
        self._separator: bytes | None = None
        self._separated = False
        places = {c.axis: i for i, c in enumerate(columns) if c is not None and c.axis >= 0}
        self._axes = sorted(places)
        self._all_axes = len(places) == 6
        self._time = self._place("time")
        self._temperature = self._place("temperature")
        # What is read of each row: its axes, then a time and a temperature, or a stand-in for them.
        self._places = [places[axis] for axis in self._axes]
        stand_in = self._places[0]
        for place in (self._time, self._temperature):
            self._places.append(stand_in if place is None else place)
        stated = columns[self._time] if self._time is not None else None
        self._time_unit = time_unit or (stated.unit if stated else "")
        self._last_time = -math.inf
        self._wrapped = 0.0
        self._origin = 0
        self._clock: ClockTimes | None = None
        self.rows = 0

    @property
    def time_unit_missing(self) -> bool:
        """Whether there is a time without a unit."""
        return self._time is not None and not self._time_unit and self._clock is None

    @property
    def units(self) -> dict[Quantity, str]:
        """Units that the columns state."""
        return {c.quantity: c.unit for c in self.columns if c is not None and c.unit}

    def row(self, line: bytes) -> TableRow | None:
        """Return what a line holds, None when it is not a whole row of this table.

        The values are those of an empty row, all NaN, where no axis has one.
        """
        if not self._separated:
            self._separator = next((s for s in _SEPARATORS if s in line), None)
        cells = line.split(self._separator)
        if len(cells) < self._count or b"".join(cells[self._count :]).strip():
            return None
        try:
            numbers = [float(cell) if (cell := cells[i]) else math.nan for i in self._places]
        except ValueError:
            try:
                numbers = self._slowly(cells)
            except ValueError:
                return None
        time_s = self._time_of(numbers[-2], cells) if self._time is not None else math.nan
        if abs(time_s) > _LATEST_S:
            return None
        self._separated = True
        self.rows += 1
        degrees = numbers[-1] if self._temperature is not None else math.nan
        if self._all_axes:
            return tuple(numbers[:6]), time_s, degrees
        values = [math.nan] * 6
        for axis, number in zip(self._axes, numbers, strict=False):
            values[axis] = number
        return tuple(values), time_s, degrees

    def plain_rows(self, data: memoryview) -> PlainRows | None:
        """Return the rows that a text begins with, up to one that `row` has to look at.

        None where there is none. What they hold is what `row` returns, to the last bit.
        """
        unscaled = self._origin or self._clock is not None or self.rows == 0
        by_blanks = self._separator is None and self._count > 1
        if unscaled or not self._separated or by_blanks:
            return None
        wanted = np.zeros(self._count, np.uint8)
        wanted[self._places] = 1
        if self._time is not None:
            wanted[self._time] = 2
        most = len(data) // self._count + 1
        found = np.empty((most, int(np.count_nonzero(wanted))))
        ends, newlines = np.empty(most, np.int64), np.empty(most, np.int64)
        text = np.frombuffer(data, np.uint8)
        separator = (self._separator or b"\n")[0]  # a line of one cell has none
        shape = (len(data), separator, self._count, wanted, most)
        count = _read_rows(text, *shape, found, ends, newlines)
        columns = np.cumsum(wanted > 0) - 1
        numbers = found[:count, columns[self._places]]
        time_s = np.full(count, math.nan)
        if self._time is not None and count:
            time_s, count = self._times_of(numbers[:, -2])
        if count == 0:
            return None
        self.rows += count
        values = np.full((count, 6), math.nan)
        values[:, self._axes] = numbers[:count, : len(self._axes)]
        degrees = numbers[:count, -1] if self._temperature is not None else np.full(count, math.nan)
        size, lines = int(ends[count - 1]), int(newlines[count - 1])
        return PlainRows(values, time_s[:count], degrees, size, lines)

    def _times_of(self, raw: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
        """Return times in s, and how many of them neither wrap nor are too late."""
        back = np.append(self._last_time, raw[:-1]) - raw
        time_s = (raw + self._wrapped) / DIVISORS["time"].get(self._time_unit, 1.0)
        odd = np.flatnonzero((back > 2**31) | (np.abs(time_s) > _LATEST_S))
        count = int(odd[0]) if odd.size else len(raw)
        if count:
            self._last_time = float(raw[count - 1])
        return time_s, count

    def _place(self, quantity: Quantity) -> int | None:
        places = [i for i, c in enumerate(self.columns) if c is not None and c.quantity == quantity]
        return places[0] if places else None

    def _slowly(self, cells: list[bytes]) -> list[float]:
        """Return the numbers of a row of which one is quoted, a time of day, or has a comma."""
        numbers = []
        for number, place in enumerate(self._places):
            if place == self._time and number == len(self._places) - 2:
                numbers.append(self._written_time(cells[place]))
            else:
                numbers.append(_number(cells[place]))
        return numbers

    def _written_time(self, cell: bytes) -> float:
        text = cell.strip(b" \"'").decode("ascii", "replace")
        if not _is_clock_time(text):
            return _number(cell)
        self._clock = self._clock or ClockTimes()
        return self._clock.seconds(text)

    def _time_of(self, value: float, cells: list[bytes]) -> float:
        if self._clock is not None:
            return value
        divisor = DIVISORS["time"].get(self._time_unit, 1.0)
        most = min(_EXACT, _LATEST_S * divisor)
        if self._origin or (self.rows == 0 and most < abs(value) < _LONGEST_NUMBER):
            value = self._from_origin(value, cells)
        back = self._last_time - value
        if back > 2**31 and self._last_time < 2**32 and self._time_unit != "s":
            self._wrapped += 2.0**32  # a 32-bit counter of the device has wrapped
        if not math.isnan(value):
            self._last_time = value
        return (value + self._wrapped) / divisor

    def _from_origin(self, value: float, cells: list[bytes]) -> float:
        """Return a long whole number less the first of its kind, to the last digit."""
        assert self._time is not None
        try:
            whole = int(cells[self._time].strip(b" \"'"))
        except ValueError:
            return value - self._origin
        self._origin = self._origin or whole
        return float(whole - self._origin) if abs(whole) < _LONGEST_NUMBER else value


def _number(cell: bytes) -> float:
    """Return the number in a cell, NaN for an empty one; quoted, or with a decimal comma."""
    cell = cell.strip(b' "')
    try:
        return float(cell)
    except ValueError:
        return float(cell.replace(b",", b".", 1)) if cell.strip() else math.nan


def realigned(columns: Columns, rows: Sequence[Sequence[str]]) -> tuple[Columns, str] | None:
    """Return the columns as the cells of some rows have them, and what to say of it.

    Parameters
    ----------
    columns : Columns
        What the header names.
    rows : sequence of rows of str
        Cells of the first rows, all of the same number.

    Returns
    -------
    (Columns, str) or None
        None where the numbers differ by more than one, or no axis would be left.

    Examples
    --------
    >>> gyro = tuple(Column("gyro", "dps", i) for i in range(3))
    >>> rows = [["1", "0.5", "0.1", "0.2"], ["2", "0.4", "0.1", "0.3"], ["3", "0.4", "0.2", "0.2"]]
    >>> realigned(gyro, rows)[0][0] is None
    True
    """
    cells = len(rows[0]) if rows else 0
    if abs(cells - len(columns)) != 1 or any(len(row) != cells for row in rows):
        return None
    values = _values(rows)
    counted = f"the header names {len(columns)} columns and the rows have {cells}: "
    if cells > len(columns):
        first = _first_cell(columns, values[:, 0])
        choices = [
            ((*columns, None), "the last cell of each row is left out"),
            ((first, *columns), f"the first cell of each row is assumed to be {_name(first)}"),
        ]
    else:
        choices = [
            (columns[:-1], "the last name is left out"),
            (columns[1:], "the first name is left out"),
        ]
    scores = [_fit(choice, values) for choice, _ in choices]
    blank = not any(row[0] for row in rows)
    if cells > len(columns) and (blank or np.all(np.diff(values[:, 0]) == 1.0)):
        scores[1] += 1.0  # row numbers
    if cells < len(columns) and columns[0] is None:
        scores[1] += 0.5  # nothing of ours is lost
    best, words = choices[int(np.argmax(scores))]
    if not any(column and column.axis >= 0 for column in best):
        return None
    return best, counted + words


def _first_cell(columns: Columns, values: NDArray[np.float64]) -> Column | None:
    """Return what a cell without a name in front of the others is: a time, or a row number."""
    named = any(column and column.quantity == "time" for column in columns)
    steps = np.diff(values)
    goes_up = bool(np.isfinite(steps).all() and (steps > 0.0).all() and (steps != 1.0).any())
    return Column("time", "") if goes_up and not named else None


def _name(column: Column | None) -> str:
    return "a row number" if column is None else "the time"


def _values(rows: Sequence[Sequence[str]]) -> NDArray[np.float64]:
    """Return cells as numbers, times of day in seconds, NaN for what is neither."""
    clocks = [ClockTimes() for _ in rows[0]]

    def number(cell: str, clock: ClockTimes) -> float:
        try:
            if _is_clock_time(cell):
                return clock.seconds(cell)
            return float(cell.replace(",", ".", 1))
        except ValueError:
            return math.nan

    return np.array([[number(c, k) for c, k in zip(row, clocks, strict=True)] for row in rows])


def _fit(columns: Columns, values: NDArray[np.float64]) -> float:
    """Return how well values are what their columns should be."""
    score = 0.0
    accel = []
    for column, cells in zip(columns, values.T, strict=True):
        if column is None:
            continue
        if column.quantity == "time":
            score += 2.0 if bool((np.diff(cells) > 0.0).all()) else -2.0
        elif column.quantity == "temperature":
            score += 0.25 if bool(((cells > _WARMTH[0]) & (cells < _WARMTH[1])).all()) else -1.0
        elif column.quantity == "accel":
            accel.append(cells)
    return score + (1.0 if accel and unit_by_gravity(np.column_stack(accel)) else 0.0)


def _is_clock_time(cell: str) -> bool:
    """Return whether a cell is a time of day, with or without a date."""
    return len(cell) <= _LONGEST_TIME and _WRITTEN_TIME.fullmatch(cell) is not None


def joined_dates(line: bytes) -> bytes:
    """Return a line in which a time, the date before it, and AM or PM after it are one cell.

    >>> joined_dates(b"2024-05-17 10:00:00.5 1 2")
    b'2024-05-17T10:00:00.5 1 2'
    >>> joined_dates(b"1:00:00.5 PM 1 2")
    b'1:00:00.5PM 1 2'
    """
    if b":" not in line:
        return line
    return _TIME_AND_HALF.sub(rb"\1", _DATE_AND_TIME.sub(rb"\1T", line))


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
        match = _WRITTEN_TIME.fullmatch(cell) if len(cell) <= _LONGEST_TIME else None
        if match is None:
            raise ValueError(f"{cell!r} is not a time")
        hours = int(match[4])
        if match[7]:  # 12 AM is midnight, 12 PM noon
            hours = hours % 12 + (12 if match[7] in "Pp" else 0)
        of_day = 3600.0 * hours + 60.0 * int(match[5]) + float(match[6].replace(",", "."))
        if match[1] is not None:
            day = date(int(match[1]), int(match[2]), int(match[3])).toordinal()
            self._first_day = day if self._first_day is None else self._first_day
            return _DAY_S * (day - self._first_day) + of_day
        if self._last_s - of_day - self._midnights_s > _DAY_S / 2:
            self._midnights_s += _DAY_S
        self._last_s = of_day + self._midnights_s
        return self._last_s
