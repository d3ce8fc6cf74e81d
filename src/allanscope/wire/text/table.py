"""Rows of a table to values, as fast as plain Python can."""

from __future__ import annotations

import math

from allanscope.wire.text.clock_times import ClockTimes, is_clock_time
from allanscope.wire.text.columns import Columns
from allanscope.wire.text.units import DIVISORS, Quantity

__all__ = ["Table", "TableRow"]

TableRow = tuple[tuple[float, ...], float, float]
"""Six values in the units of the text, the time in s if its unit is known, and degC."""

_SEPARATORS = (b"\t", b";", b",", b"|")
_LATEST_S = 1e12
_EXACT, _LONGEST_NUMBER = 2.0**53, 1e21
"""Whole numbers between these, nanoseconds since 1970 for instance, lose digits as float64."""


class Table:
    """Reads rows of known columns.

    Parameters
    ----------
    columns : Columns
        What the header says, or what is taken for granted without one.
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
        """Whether there is a time whose unit nobody gave."""
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
        if not is_clock_time(text):
            return _number(cell)
        self._clock = self._clock or ClockTimes()
        return self._clock.seconds(text)

    def _time_of(self, value: float, cells: list[bytes]) -> float:
        if self._clock is not None:
            return value
        if self._origin or (self.rows == 0 and _EXACT < abs(value) < _LONGEST_NUMBER):
            value = self._from_origin(value, cells)
        back = self._last_time - value
        if back > 2**31 and self._last_time < 2**32 and self._time_unit != "s":
            self._wrapped += 2.0**32  # a 32-bit counter of the device has wrapped
        if not math.isnan(value):
            self._last_time = value
        return (value + self._wrapped) / DIVISORS["time"].get(self._time_unit, 1.0)

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
