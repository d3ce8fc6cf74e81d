"""What the columns of a table are called, and which of them are ours."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast

from allanscope.samples import AXES
from allanscope.wire.text.units import DIVISORS, Quantity, unit_of_text

__all__ = [
    "Column",
    "Columns",
    "cells_of",
    "column_of",
    "columns_of",
    "columns_under_groups",
    "columns_without_sensor",
    "in_unknown_unit",
    "names_no_sensor",
    "sensor_of_name",
    "unnamed",
    "with_units_below",
]

_NAME = re.compile(r"\s*([^\[\](){}]*?)\s*(?:[\[({]([^\])}]*)[\])}])?\s*")
_AXIS = re.compile(
    r"(?:field)?(?:(a|acc|accel|accelerometer|(?:accelerometer)?acceleration|linear_?acceleration)"
    r"|(?:g|gyr|gyro|gyroscope|angularrate|angular_?velocity|gyrorotation|(?:motion)?rotationrate|w|omega))"
    r"_?(?:l_|rs_s_)?([xyz])"
)
"""The axis of a name; `w_RS_S_x` is EuRoC's, `field.angular_velocity.x` comes from ROS, and
`gyroRotationX` and `accelerometerAccelerationX` from a phone."""
_NAVIGATION = {"p": "gx", "q": "gy", "r": "gz", "fx": "ax", "fy": "ay", "fz": "az"}
"""Rates and specific force as in navigation; `fx` without rates may be a force."""
_SENSOR = (
    r"(?:(acc(?:el(?:erometer|eration)?)?)"
    r"|gyr(?:o(?:scope)?)?|ang(?:ular)?_?(?:vel(?:ocity)?|rate))"
)
_LOOSE = re.compile(
    r"(?!.*(?:bias|offset|std|var|cov))(?:\w*_)?"
    rf"(?:{_SENSOR}(?:_?(?:adc|raw|smooth))?_?([xyz012])|([xyz])_{_SENSOR})"
)
"""What may be an axis where no name is one: `IMU_AccX`, `gyro_adc_x`, `accSmooth[0]`, `X_Acc`."""
_TIME = re.compile(
    r"t|ts|(?:(?:imu|sys(?:tem)?|gps)_?)?time(?:_?stamp)?|fieldheaderstamp|(?:seconds_)?elapsed|epoch?|hh:mm:ss\w*"
)
_CLOCKS = {
    **{"millis": "ms", "micros": "us", "timeus": "us", "elapsedrealtimenanos": "ns"},
    "sampletimefine": "100us",
}
"""Names that tell the unit: Arduino's clocks, ArduPilot's, Android's, Xsens's."""
_TEMPERATURE = re.compile(r"(?:(?:imu|g|gyro?|acc|chip|die|sensor)_?)?temp(?:erature)?|t")
_BARE_AXIS = re.compile(r"([xyz])(?:[_-]?axis)?[_.]?\d?")
_GROUPS: Mapping[Quantity, re.Pattern[str]] = {
    "accel": re.compile(r"acc", re.IGNORECASE),
    "gyro": re.compile(r"gyr|angular[ _]?(?:rate|vel)", re.IGNORECASE),
}
"""What the name of three columns, or of a file, says of its sensor."""
_SENSOR_LOGGER = "seconds_elapsed"
"""A column of the app Sensor Logger, which writes a file a sensor, without units."""
_ITS_UNITS: Mapping[Quantity, str] = {"gyro": "rad/s", "accel": "m/s2"}
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
    name = _joined(match[1])
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


def _joined(name: str) -> str:
    """Return a name in small letters, without blanks, dots and hyphens."""
    return re.sub(r"[\s.\-]+", "", name.lower()).strip("_")


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
    if name in _CLOCKS and not unit:
        return _column("time", _CLOCKS[name])
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
    columns = [column_of(cell) for cell in cells]
    for sensor in ("gyro", "accel"):
        if not any(column and column.quantity == sensor for column in columns):
            rates = sensor == "gyro" or any(one and one.quantity == "gyro" for one in columns)
            for place, column in enumerate(_loosely(cells, sensor, navigation=rates)):
                columns[place] = columns[place] or column
    columns = _first_of_each(columns)
    return tuple(columns) if any(column and column.axis >= 0 for column in columns) else None


def _loosely(cells: Sequence[str], sensor: Quantity, *, navigation: bool) -> list[Column | None]:
    """Return the columns of x, y and z of a sensor whose names have more to them; none of fewer.

    The names of navigation count too if so said.
    """
    columns: list[Column | None] = []
    for cell in cells:
        match = _NAME.fullmatch(cell[:80])
        index = match[2] if match and match[2] in ("0", "1", "2") else ""
        name = _joined(match[1]) + index if match else ""
        axis = _LOOSE.fullmatch(name)
        column = None
        own = _NAVIGATION.get(name, "") if navigation else ""
        if match and own[:1] == sensor[0]:
            column = _column(sensor, unit_of_text(match[2] or ""), AXES.index(own))
        elif axis and match and ("accel" if axis[1] or axis[4] else "gyro") == sensor:
            letter = "xyz"["xyz012".index(axis[2] or axis[3]) % 3]
            unit = "" if index else unit_of_text(match[2] or "")
            column = _column(sensor, unit, AXES.index(sensor[0] + letter))
        columns.append(column)
    return columns if sum(one is not None for one in _first_of_each(columns)) == 3 else []


def _first_of_each(columns: Sequence[Column | None]) -> list[Column | None]:
    """Return columns without those that were there before."""
    seen: set[tuple[Quantity, int]] = set()
    first: list[Column | None] = []
    for column in columns:
        known = column is None or (column.quantity, column.axis) in seen
        if column is not None:
            seen.add((column.quantity, column.axis))
        first.append(None if known else column)
    return first


def columns_without_sensor(cells: Sequence[str], bare: Quantity = "gyro") -> Columns | None:
    """Return the columns of a header that names axes and no sensor, None for another one.

    Such a header has x, y and z once or twice (or z, y, x), with a digit perhaps, times before them
    and a temperature behind. A unit says which sensor it is (phones write ``X (m/s^2)``), and then
    one other column may stand on either side; without one the sensor is told by its place, as
    without a header.

    Examples
    --------
    >>> [one.axis for one in columns_without_sensor(["time", "x1", "y1", "z1", "X2", "Y2", "Z2"])]
    [-1, 0, 1, 2, 3, 4, 5]
    >>> [one.axis for one in columns_without_sensor(["Time (s)", "X (g)", "Y (g)", "Z (g)"])]
    [-1, 3, 4, 5]
    >>> columns_without_sensor(["time", "seconds_elapsed", "z", "y", "x"])[2]
    Column(quantity='gyro', unit='rad/s', axis=2)
    >>> columns_without_sensor(["x", "y", "mz"]) is None
    True
    """
    named = [_bare_axis(cell) for cell in cells]
    first = next((i for i, name in enumerate(named) if name), len(named))
    count = sum(name is not None for name in named)
    both = count == len("xyzxyz")
    letters = [name[0] if name else "" for name in named[first : first + count]]
    triples = [letters[:3], letters[3:]] if both else [letters]
    if any(triple not in (["x", "y", "z"], ["z", "y", "x"]) for triple in triples):
        return None
    units = [name[1] for name in named[first : first + count] if name]
    sensors = _sensors_of(units, bare)
    before, after = cells[:first], cells[first + count :]
    strange = int(set(units).isdisjoint(("", "lsb")))
    beside = _may_surround(before, "time", strange) and _may_surround(after, "temperature", strange)
    if not sensors or not beside:
        return None
    usual = _ITS_UNITS if _SENSOR_LOGGER in cells else {}
    axes = [
        Column(sensor, unit or usual.get(sensor, ""), AXES.index(sensor[0] + letter))
        for sensor, letter, unit in zip(sensors, letters, units, strict=True)
    ]
    return tuple(_first_of_each([*map(column_of, before), *axes, *map(column_of, after)]))


def names_no_sensor(cells: Sequence[str]) -> bool:
    """Return whether a header has x, y and z of a sensor that neither a name nor a unit tells.

    >>> names_no_sensor(["t", "x", "y", "z"]), names_no_sensor(["t", "x [g]", "y [g]", "z [g]"])
    (True, False)
    """
    units = {axis[1] for axis in map(_bare_axis, cells) if axis}
    return columns_without_sensor(cells) is not None and units <= {"", "lsb"}


def columns_under_groups(groups: Sequence[str], cells: Sequence[str]) -> Columns | None:
    """Return the columns of a header of two lines: sensors in the first, axes in the second.

    Spreadsheets write so: a name stands above the first of its columns. None where the first line
    names no sensor of all of x, y and z of the second.

    Examples
    --------
    >>> groups = ["Time (s)", "IMU Gyroscope", "", "", "IMU Magnetometer"]
    >>> columns_under_groups(groups, ["", "X", "Y", "Z", "X", "Y", "Z"])[:2]
    (Column(quantity='time', unit='s', axis=-1), Column(quantity='gyro', unit='', axis=0))
    >>> columns_under_groups(["Time (s)", "Orientation"], ["", "X", "Y", "Z"]) is None
    True
    """
    above, name = [], ""
    for place in range(len(cells)):
        name = (groups[place] if place < len(groups) else "") or name
        above.append(name)
    named = [_under_group(group, cell) for group, cell in zip(above, cells, strict=True)]
    bare = [bool(_bare_axis(cell) and name) for cell, name in zip(cells, named, strict=True)]
    columns = columns_of(named) if any(bare) else None
    axes = [column.axis for column in columns or () if column and column.axis >= 0]
    return columns if sorted(axes) in ([0, 1, 2], [3, 4, 5], [0, 1, 2, 3, 4, 5]) else None


def _under_group(group: str, cell: str) -> str:
    """Return the name of a column from those of its group and its own, '' where both say none."""
    axis = _bare_axis(cell)
    if axis is None:
        return cell or group
    sensor = sensor_of_name(group)
    if not sensor:
        return ""
    match = _NAME.fullmatch(group[:80])
    unit = axis[1] or (match[2] if match else "")
    return f"{sensor}_{axis[0]}" + (f"[{unit}]" if unit else "")


def sensor_of_name(name: str) -> Quantity | Literal[""]:
    """Return the sensor that is in the name of some columns or of a file, '' for none or two.

    >>> sensor_of_name("IMU Gyroscope"), sensor_of_name("acc_gyr"), sensor_of_name("night")
    ('gyro', '', '')
    """
    sensors = [sensor for sensor, words in _GROUPS.items() if words.search(name)]
    return sensors[0] if len(sensors) == 1 else ""


def _bare_axis(cell: str) -> tuple[str, str] | None:
    """Return x, y or z and the unit of a column that names no sensor."""
    match = _NAME.fullmatch(cell[:80])
    axis = match and _BARE_AXIS.fullmatch(match[1].lower())
    return (axis[1], unit_of_text(match[2] or "")) if match and axis else None


def _sensors_of(units: Sequence[str], bare: Quantity) -> list[Quantity]:
    """Return the sensor of each of three or six columns in these units, none for strange ones."""
    one = [
        next((q for q in ("gyro", "accel") if unit != "lsb" and unit in DIVISORS[q]), "")
        for unit in units
    ]
    if any(unit not in ("", "lsb") and not known for unit, known in zip(units, one, strict=True)):
        return []
    groups = [set(one[i : i + 3]) for i in range(0, len(one), 3)]
    if any(len(group) > 1 for group in groups):
        return []
    said = [group.pop() for group in groups]
    other: Mapping[str, Quantity] = {"gyro": "accel", "accel": "gyro"}
    if len(said) == 1:
        sensors = [said[0] or bare]
    else:
        front = said[0] or other.get(said[1], "gyro")
        sensors = [front, said[1] or other[front]]
    if len(set(sensors)) < len(sensors):
        return []
    return [cast("Quantity", sensor) for sensor in sensors for _ in range(3)]


def _may_surround(cells: Sequence[str], usual: Quantity, strange: int) -> bool:
    """Return whether columns beside x, y and z are of one quantity, but for some strange ones."""
    found = [column_of(cell) for cell in cells]
    known = [column.quantity == usual for column in found if column is not None]
    return all(known) and len(found) - len(known) <= strange


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
