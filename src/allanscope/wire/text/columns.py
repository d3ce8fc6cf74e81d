"""What the columns of a table are called, and which of them are ours."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from allanscope.samples import AXES
from allanscope.wire.text.units import DIVISORS, Quantity, unit_of_text

__all__ = [
    "Column",
    "Columns",
    "cells_of",
    "column_of",
    "columns_of",
    "columns_without_sensor",
    "in_unknown_unit",
    "unnamed",
    "with_units_below",
]

_NAME = re.compile(r"\s*([^\[\](){}]*?)\s*(?:[\[({]([^\])}]*)[\])}])?\s*")
_AXIS = re.compile(
    r"(?:field)?(?:(a|acc|accel|accelerometer|acceleration|linear_?acceleration)"
    r"|(?:g|gyr|gyro|gyroscope|angularrate|angular_?velocity|w|omega))"
    r"_?(?:l_|rs_s_)?([xyz])"
)
"""The axis of a name; `w_RS_S_x` is EuRoC's, `field.angular_velocity.x` comes from ROS."""
_TIME = re.compile(r"t|ts|time|timestamp|time_stamp|fieldheaderstamp")
_TEMPERATURE = re.compile(r"temp|temperature|t")
_BARE_AXIS = re.compile(r"([xyz])[_.]?\d?")
_SEPARATORS = "\t;,|"
_QUOTES = " \"'"


@dataclass(frozen=True, slots=True)
class Column:
    """One column.

    Attributes
    ----------
    quantity : str
        What it measures.
    unit : str
        In the spelling of `DIVISORS`, empty when not given.
    axis : int
        Place in `AXES`; -1 for a time or a temperature.
    """

    quantity: Quantity
    unit: str
    axis: int = -1


Columns = tuple[Column | None, ...]
"""The columns of a table from left to right, None for those that are not ours."""


def cells_of(line: str) -> list[str]:
    """Cut a line at its tabs, semicolons, commas, bars or spaces, whichever it has first.

    A unit in brackets stays with its name also where spaces separate; quotation marks around a
    cell, and empty cells at the end, which a trailing separator leaves, are dropped.

    >>> cells_of("A_X [mg] A_Y [mg] ")
    ['A_X [mg]', 'A_Y [mg]']
    >>> cells_of('1 ,"2",, ')
    ['1', '2']
    """
    separator = next((s for s in _SEPARATORS if s in line), None)
    if separator is None:
        cells = re.sub(r"(?<!\s)\s+(?=[\[({])", "\0", line).split()
        cells = [cell.replace("\0", " ").strip(_QUOTES) for cell in cells]
    else:
        cells = [cell.strip(_QUOTES) for cell in line.split(separator)]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def column_of(header: str) -> Column | None:
    """Return the column that a header names, None for one that is not ours.

    >>> column_of("GyroX [mdps]")
    Column(quantity='gyro', unit='mdps', axis=0)
    >>> column_of("time[us]").unit
    'us'
    """
    match = _NAME.fullmatch(header[:80])
    if match is None:
        return None
    name = re.sub(r"[\s.\-]+", "", match[1].lower()).strip("_")
    unit = unit_of_text(match[2] or "")
    found = _named(name, unit)
    if found is None and not unit and "_" in name:
        # "gx_dps", "gx_rad_s": the unit as a part of the name.
        parts = name.split("_")
        for size in (1, 2):
            unit = unit_of_text("_".join(parts[-size:]))
            if found is None and any(unit in units for units in DIVISORS.values()):
                found = _named("_".join(parts[:-size]), unit)
    return found


def in_unknown_unit(header: str) -> bool:
    """Return whether a header names an axis in an unknown unit, so that it is not taken.

    >>> in_unknown_unit("gx[furlong]"), in_unknown_unit("gx[dps]"), in_unknown_unit("mx[mG]")
    (True, False, False)
    """
    match = _NAME.fullmatch(header[:80])
    if match is None or not match[2] or column_of(header) is not None:
        return False
    column = column_of(match[1])
    return column is not None and column.axis >= 0


def _named(name: str, unit: str) -> Column | None:
    if axis := _AXIS.fullmatch(name):
        sensor = "a" if axis[1] else "g"
        return _column("accel" if axis[1] else "gyro", unit, AXES.index(sensor + axis[2]))
    if _TEMPERATURE.fullmatch(name) and unit in DIVISORS["temperature"]:
        return _column("temperature", unit)
    if _TIME.fullmatch(name):
        return _column("time", unit)
    return _column("temperature", unit) if _TEMPERATURE.fullmatch(name) else None


def _column(quantity: Quantity, unit: str, axis: int = -1) -> Column | None:
    """Return a column, unless its unit is none of its quantity's."""
    return Column(quantity, unit, axis) if not unit or unit in DIVISORS[quantity] else None


def columns_of(cells: Sequence[str], bare: Quantity = "gyro") -> Columns | None:
    """Return the columns that the cells of a header name, None when no axis is among them.

    Of several columns of one axis the first counts. Three columns called just x, y and z are those
    of the sensor `bare`, six are a gyroscope and an accelerometer.
    """
    if (without := columns_without_sensor(cells, bare)) is not None:
        return without
    seen: set[tuple[Quantity, int]] = set()
    columns: list[Column | None] = []
    for cell in cells:
        column = column_of(cell)
        if column is not None and (column.quantity, column.axis) in seen:
            column = None
        if column is not None:
            seen.add((column.quantity, column.axis))
        columns.append(column)
    return tuple(columns) if any(column and column.axis >= 0 for column in columns) else None


def columns_without_sensor(cells: Sequence[str], bare: Quantity = "gyro") -> Columns | None:
    """Return the columns of a header that names axes and no sensor, None for another one.

    Such a header has x, y and z once or twice, with a digit perhaps, a time before them or not, and
    a temperature behind. Sensors are identified by their place, as without a header.

    Examples
    --------
    >>> [one.axis for one in columns_without_sensor(["time", "x1", "y1", "z1", "X2", "Y2", "Z2"])]
    [-1, 0, 1, 2, 3, 4, 5]
    >>> columns_without_sensor(["x", "y", "mz"]) is None
    True
    """
    names = [match and match[1] for match in map(_BARE_AXIS.fullmatch, map(str.lower, cells))]
    first = next((i for i, name in enumerate(names) if name), len(names))
    count = sum(name is not None for name in names)
    order = "".join(name or " " for name in names[first : first + count])
    before, after = cells[:first], cells[first + count :]
    around = [column_of(one) for one in (*before, *after)]
    quantities = tuple(one.quantity if one else "" for one in around)
    wanted = (*("time" for _ in before), *("temperature" for _ in after))
    if order not in ("xyz", "xyzxyz") or max(len(before), len(after)) > 1 or quantities != wanted:
        return None
    start = AXES.index(f"{bare[0]}x") if count == len("xyz") else 0
    axes = [
        Column("gyro" if axis.startswith("g") else "accel", "", start + i)
        for i, axis in enumerate(AXES[start : start + count])
    ]
    return (*around[:first], *axes, *around[first:])


def with_units_below(columns: Columns, cells: Sequence[str]) -> Columns | None:
    """Return the columns with the units of a second line of their header, None where it is none.

    Examples
    --------
    >>> columns = columns_of(["Time", "GyroX"])
    >>> [one.unit for one in with_units_below(columns, ["[ms]", "[deg/s]"])]
    ['ms', 'deg/s']
    >>> with_units_below(columns, ["first", "second"]) is None
    True
    """
    if len(cells) != len(columns):
        return None
    found: list[Column | None] = []
    some = False
    for column, cell in zip(columns, cells, strict=True):
        unit = unit_of_text(cell.strip("[](){} "))
        if column is None or not unit:
            found.append(column)
        elif unit in DIVISORS[column.quantity]:
            found.append(replace(column, unit=unit))
            some = True
        else:
            return None
    return tuple(found) if some else None


def unnamed(count: int) -> Columns | None:
    """Return the assumed meaning of columns without a header, by their number.

    Three are a gyroscope, six a gyroscope and an accelerometer; one more is a time before them,
    and an eighth a temperature behind.
    """
    time, temperature = Column("time", ""), Column("temperature", "")
    gyro = tuple(Column("gyro", "", i) for i in range(3))
    both = (*gyro, *(Column("accel", "", i) for i in range(3, 6)))
    return {
        3: gyro,
        4: (time, *gyro),
        6: both,
        7: (time, *both),
        8: (time, *both, temperature),
    }.get(count)
