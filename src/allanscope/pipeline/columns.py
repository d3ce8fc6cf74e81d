"""Columns with names and units, from arrays and tables; names and units are those of text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.samples import AXES, unit_of
from allanscope.wire.text import (
    DIVISORS,
    Column,
    Quantity,
    accel_comes_first,
    assumed_as,
    column_of,
    columns_of,
    gyro_unit,
    quantity_named,
    shows_gravity,
    unit_by_gravity,
)

__all__ = [
    "Columns",
    "columns_of_array",
    "columns_of_mapping",
    "columns_of_table",
    "known_names",
    "quantity_of",
    "text_of_columns",
    "with_guesses",
    "with_units",
]

LOOKED_AT = 1024
"""Rows by whose values a unit or a sensor is told."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Named columns of equal length.

    Attributes
    ----------
    axes : mapping
        Axis to its samples, shape (n,), in the order of `AXES`.
    units : mapping
        Axis to its unit, empty where it is not known yet.
    time_s, temperature_c : ndarray of float64, shape (n,), or None
        Time and temperature of each row.
    scales : mapping
        Axis to its scale in dps or g per count, where the source of the counts states it.
    assumed : tuple of str
        What the source did not say and was assumed of it.
    lost : mapping
        Rows that are missing before a row, by its number: where there were NaN and no times.
    """

    axes: Mapping[str, NDArray[Any]]
    units: Mapping[str, str]
    time_s: NDArray[np.float64] | None = None
    temperature_c: NDArray[np.float64] | None = None
    scales: Mapping[str, float] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    lost: Mapping[int, int] = field(default_factory=dict)

    def unit(self, axis: str) -> str:
        """Return the unit of an axis; without one integers are counts, floats dps or g."""
        if self.units[axis]:
            return self.units[axis]
        return "lsb" if self.axes[axis].dtype.kind in "iu" else unit_of(axis)


def columns_of_array(data: ArrayLike, axes: Sequence[str] | None, timed: bool = False) -> Columns:
    """Return the columns of an array of shape (n,) or (n, k).

    Parameters
    ----------
    data : array_like
        Samples.
    axes : sequence of str, optional
        Name of each column. Without it one column is gx, three are the gyroscope, six both sensors,
        as in text without a header; where gravity is in the first three these are the
        accelerometer. A structured array says it itself.
    timed : bool
        Whether one column more in front may be a time, and an eighth at the end a temperature.

    Raises
    ------
    ValueError
        For another shape, or names that do not fit it.

    Examples
    --------
    >>> list(columns_of_array(np.zeros((5, 3)), None).axes)
    ['gx', 'gy', 'gz']
    """
    values = np.asanyarray(data)
    if values.dtype.names:
        return columns_of_mapping({name: values[name] for name in axes or values.dtype.names})
    if values.ndim == 0:
        raise ValueError(
            "give a path, an array, a table or a mapping of names to columns; got "
            f"{type(data).__name__} {data!r}"
        )
    if values.ndim == 1:
        values = values[:, np.newaxis]
    if values.ndim != 2:
        raise ValueError(f"an array of samples has shape (n,) or (n, axes), not {values.shape}")
    assumed: tuple[str, ...] = ()
    if axes is None:
        axes = _usual_axes(values, timed)
        assumed = (f"no names: {len(axes)} columns, assumed to be {' '.join(axes)}",)
        assumed = assumed if len(axes) > 1 else ()
    twice = [name for i, name in enumerate(axes) if name in axes[:i]]
    if twice:
        raise ValueError(f"{twice[0]} appears twice among the names of the axes")
    if len(axes) != values.shape[1]:
        raise ValueError(f"{len(axes)} axis names do not fit an array of shape {values.shape}")
    columns = columns_of_mapping(dict(zip(axes, values.T, strict=True)))
    return replace(columns, assumed=assumed + columns.assumed)


def columns_of_mapping(data: Mapping[str, ArrayLike]) -> Columns:
    """Return the columns that a mapping of ``name`` or ``name[unit]`` to an array (n,) holds.

    Raises
    ------
    ValueError
        For a name that is none of t, gx ... az and temp, a unit that does not exist, a column
        that comes twice or has another length, or when there is no axis at all.

    Examples
    --------
    >>> columns = columns_of_mapping({"az[mg]": [998, 1002], "t[ms]": [0, 10]})
    >>> dict(columns.units), columns.time_s.tolist()
    ({'az': 'mg'}, [0.0, 0.01])
    """
    found: dict[str, tuple[Column, NDArray[Any]]] = {}
    for name, values in data.items():
        column = column_of(str(name))
        if column is None:
            raise ValueError(f"column {name!r} is unknown; names are t {' '.join(AXES)} temp")
        plain = _plain(column)
        if plain in found:
            raise ValueError(f"column {name!r} appears twice")
        found[plain] = (column, _column(str(name), values, column.quantity))
    axes = {axis: found[axis][1] for axis in AXES if axis in found}
    if not axes:
        raise ValueError(f"no axis among the columns {list(data)}; axes are {' '.join(AXES)}")
    lengths = {len(values) for _, values in found.values()}
    if len(lengths) > 1:
        raise ValueError(f"columns differ in length: {sorted(lengths)}")
    return _without_missing(
        Columns(
            axes,
            {axis: found[axis][0].unit for axis in axes},
            _converted(found.get("time"), "s"),
            _converted(found.get("temperature"), "degc"),
        )
    )


def known_names(names: Sequence[str]) -> dict[str, str]:
    """Return those names of the columns of a table that are ours, and how they are called here.

    Examples
    --------
    >>> known_names(["Time (s)", "IMU_GyrX", "IMU_GyrY", "IMU_GyrZ", "label"])
    {'Time (s)': 'time[s]', 'IMU_GyrX': 'gx', 'IMU_GyrY': 'gy', 'IMU_GyrZ': 'gz'}
    """
    return {
        name: f"{_plain(column)}[{column.unit}]" if column.unit else _plain(column)
        for name, column in zip(names, columns_of(names) or (), strict=False)
        if column is not None
    }


def _plain(column: Column) -> str:
    return AXES[column.axis] if column.axis >= 0 else column.quantity


def _without_missing(columns: Columns) -> Columns:
    """Return the rows in which every axis has a number; NaN is a lost sample.

    So is a row of zeros, where an accelerometer shows gravity.
    """
    blank = np.zeros(len(next(iter(columns.axes.values()))), np.bool_)
    for values in columns.axes.values():
        if values.dtype.kind == "f":
            blank |= np.isnan(values)
    accel = [columns.axes[axis][:LOOKED_AT] for axis in AXES[3:] if axis in columns.axes]
    zeros = np.full(len(blank), len(accel) == 3 and shows_gravity(np.column_stack(accel)))
    for values in columns.axes.values() if zeros.any() else ():
        zeros &= values == 0
    missing = blank | zeros
    count = int(missing.sum())
    if count == 0:
        return columns
    if count == missing.size:
        raise ValueError(f"all {count} rows have NaN: there is no sample")
    kept = np.flatnonzero(~missing)
    before = np.diff(kept) - 1
    places = np.flatnonzero(before)
    lost = dict(zip((places + 1).tolist(), before[places].tolist(), strict=True))
    time_s, temperature_c = columns.time_s, columns.temperature_c
    what = " or ".join(w for w, there in (("NaN", blank), ("zeros only", zeros)) if there.any())
    rows = "row has" if count == 1 else "rows have"
    return replace(
        columns,
        axes={axis: values[kept] for axis, values in columns.axes.items()},
        time_s=None if time_s is None else time_s[kept],
        temperature_c=None if temperature_c is None else temperature_c[kept],
        assumed=(*columns.assumed, f"{count} {rows} {what}, taken as lost samples"),
        lost=lost if time_s is None else {},
    )


def columns_of_table(data: Any, axes: Sequence[str] | None) -> Columns:
    """Return the columns of an array or of a table, recognised by its interface.

    A table of pandas or polars has ``columns``, a mapping and an ``.npz`` file ``keys``; a column
    of such a table has a ``name``, which is that of the axis. An index of times, or one that is
    called t or time, is the time where no column is. A dataset of xarray has ``data_vars``, an
    array of it ``coords``: the labels of its second dimension are the names of the axes, a
    coordinate t or time is the time, the attribute ``units`` the unit. Dates count in seconds since
    the first.

    Raises
    ------
    ValueError
        As for `columns_of_array` and `columns_of_mapping`.
    """
    if hasattr(data, "data_vars"):
        names = axes or [str(name) for name in data.data_vars]
        return columns_of_mapping(dict([*_times(data), *(_labelled(n, data[n]) for n in names)]))
    if hasattr(data, "coords") and hasattr(data, "dims"):
        if data.ndim == 1:
            name = axes[0] if axes else str(data.name or "gx")
            return columns_of_mapping(dict([*_times(data), _labelled(name, data)]))
        labels = data.dims[-1]
        if axes is None and labels in data.coords:
            axes = [str(name) for name in data.coords[labels].values]
        if axes is None:
            axes = _usual_axes(data.values, timed=False)
        columns = zip(axes, np.moveaxis(data.values, -1, 0), strict=True)
        unit = str(data.attrs.get("units", ""))
        named = {_with_unit(name, unit): values for name, values in columns}
        return columns_of_mapping(dict(_times(data)) | named)
    if hasattr(data, "name") and hasattr(data, "to_numpy"):  # a column of pandas or polars
        given = (axes[0] if axes else data.name) or "gx"
        return columns_of_mapping(_with_index(data, {str(given): _values(data)}))
    if hasattr(data, "columns"):
        chosen = axes or list(data.columns)
    elif hasattr(data, "keys"):
        chosen = axes or list(data.keys())
    else:
        return columns_of_array(data, axes)
    table = dict(_in_seconds(str(name), _values(data[name])) for name in chosen)
    return columns_of_mapping(_with_index(data, table))


def _values(column: Any) -> NDArray[Any]:
    """Return the values of a column of any library; dates with a zone are in UTC."""
    values = np.asarray(getattr(column, "values", column))
    if values.dtype.kind == "O" and hasattr(column, "to_numpy"):  # a type of pandas with gaps
        values = column.to_numpy(dtype=float, na_value=np.nan)
    return values


def _in_seconds(name: str, values: NDArray[Any]) -> tuple[str, NDArray[Any]]:
    """Return a column of dates or durations as seconds since the first, another as it is."""
    if values.dtype.kind not in "Mm":
        return name, values
    return f"{name.partition('[')[0]}[s]", (values - values[:1]) / np.timedelta64(1, "s")


def _with_index(data: Any, table: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the columns, and the index of a table of pandas in front where it is the time."""
    index: Any = getattr(data, "index", None)
    names = map(column_of, table)
    if not hasattr(index, "values") or any(one and one.quantity == "time" for one in names):
        return table
    values = np.asarray(index.values)
    named = column_of(str(index.name)) if index.name is not None else None
    if values.dtype.kind in "Mm":
        return dict([_in_seconds("t", values)]) | table
    if named is not None and named.quantity == "time":
        return {str(index.name): values} | table
    return table


def _labelled(name: str, array: Any) -> tuple[str, NDArray[Any]]:
    """Return the name with the unit, and the values, of an array of xarray."""
    return _with_unit(name, str(array.attrs.get("units", ""))), array.values


def _times(data: Any) -> list[tuple[str, NDArray[Any]]]:
    """Return the time of an array or dataset of xarray; dates as seconds since the first."""
    for name in ("t", "time"):
        if name in data.coords:
            return [_in_seconds(*_labelled(name, data.coords[name]))]
    return []


def _with_unit(name: str, unit: str) -> str:
    return f"{name}[{unit}]" if unit and "[" not in name else name


def with_units(columns: Columns, units: Mapping[str, str] | str | None) -> Columns:
    """Return the columns with the units that the caller gave, which have the last word.

    Raises
    ------
    UsageError
        For a group or a unit that does not exist.
    """
    if units is None:
        return columns
    if isinstance(units, str):
        units = dict.fromkeys(columns.axes, units)
    given = dict(columns.units)
    for name, unit in units.items():
        quantity, plain = quantity_named(quantity_of(name), unit)
        for axis in columns.axes:
            if axis == name or (name not in AXES and quantity_of(axis) == quantity):
                given[axis] = plain
    return replace(columns, units=given)


def with_guesses(columns: Columns) -> Columns:
    """Return the columns with a unit for each axis, and with a remark on each that is a guess."""
    units, said = dict(columns.units), {"gyro": "", "accel": ""}
    for sensor in ("accel", "gyro"):
        silent = [a for a in columns.axes if quantity_of(a) == sensor and not columns.units[a]]
        if not silent:
            continue
        rows = np.column_stack([columns.axes[axis][:LOOKED_AT] for axis in silent])
        if sensor == "accel":
            told = unit_by_gravity(rows)
            why = "gravity has that size" if told else ""
        else:
            beside = (units[axis] for axis in columns.axes if quantity_of(axis) == "accel")
            told, why = gyro_unit(rows, next(beside, ""))
        for axis in silent:
            unit = columns.unit(axis)
            units[axis] = told if told and (sensor == "accel" or unit == "dps") else unit
        names = dict.fromkeys(units[axis] for axis in silent)
        words = " and ".join("counts (lsb)" if name == "lsb" else name for name in names)
        why = why if told in names else ""
        said[sensor] = f"no unit of {sensor} is given: {assumed_as(words, why)}"
    return replace(columns, units=units, assumed=(*columns.assumed, *filter(None, said.values())))


def text_of_columns(columns: Columns) -> tuple[bytes, Callable[[slice], bytes]]:
    r"""Return a table as text: its header, and what writes some rows, to the last digit.

    Examples
    --------
    >>> table = columns_of_mapping({"t[ms]": [0, 10], "az[mg]": [998, 1002]})
    >>> header, rows = text_of_columns(table)
    >>> (header + rows(slice(0, 2))).decode()
    't[s],az[mg]\n0.0,998\n0.01,1002\n'
    """
    there: dict[str, NDArray[Any]] = {}
    if columns.time_s is not None:
        there["t[s]"] = columns.time_s
    for axis, values in columns.axes.items():
        scale = columns.scales.get(axis) if columns.unit(axis) == "lsb" else None
        there[f"{axis}[{columns.unit(axis) if scale is None else unit_of(axis)}]"] = (
            values if scale is None else values * scale
        )
    if columns.temperature_c is not None:
        there["temp[degC]"] = columns.temperature_c

    def rows(some: slice) -> bytes:
        written = [map(repr, values[some].tolist()) for values in there.values()]
        return "".join(",".join(row) + "\n" for row in zip(*written, strict=True)).encode()

    return (",".join(there) + "\n").encode(), rows


def quantity_of(name: str) -> Quantity:
    """Return the quantity of an axis, or the name itself where it is not an axis."""
    if name in AXES:
        return "gyro" if name.startswith("g") else "accel"
    return cast("Quantity", name)


def _column(name: str, values: ArrayLike, quantity: str) -> NDArray[Any]:
    if np.ma.is_masked(values):
        raise ValueError(
            f"{name} has masked samples; "
            "leave such rows out and give the times of the others as a column t"
        )
    column = np.asarray(values)
    if column.ndim != 1:
        raise ValueError(f"column {name} must have shape (n,), got {column.shape}")
    if column.dtype.kind not in "iuf":
        raise ValueError(f"column {name} must hold integers or floats, got {column.dtype}")
    if column.dtype.kind == "f":
        column = column.astype(np.float64)
        sound = np.isfinite(column) if quantity == "time" else ~np.isinf(column)
        bad = np.flatnonzero(~sound)
        if bad.size and quantity != "temperature":
            raise ValueError(
                f"sample {bad[0]} of {name} is {column[bad[0]]} (one of {bad.size} not finite); "
                "leave such rows out and give the times of the others as a column t"
            )
    return column


def _converted(found: tuple[Column, NDArray[Any]] | None, unit: str) -> NDArray[np.float64] | None:
    if found is None:
        return None
    column, values = found
    return np.asarray(values / DIVISORS[column.quantity][column.unit or unit], np.float64)


def _usual_axes(values: NDArray[Any], timed: bool) -> tuple[str, ...]:
    """Return what columns are taken for by their number, and by where gravity is."""
    known = {1: 0, 3: 0, 6: 0} | ({4: 1, 7: 1, 8: 1} if timed else {})
    count = values.shape[1]
    if count not in known:
        raise ValueError(f"an array of shape {values.shape} needs axes: a name for each column")
    time, temperature = ("t",) * known[count], ("temp",) * (count == 8)
    axes = AXES[: count - len(time) - len(temperature)]
    if len(axes) >= 3 and values.dtype.kind in "iuf":
        padded = np.full((min(len(values), LOOKED_AT), len(AXES)), np.nan)
        padded[:, : len(axes)] = values[:LOOKED_AT, len(time) : len(time) + len(axes)]
        if accel_comes_first(padded):
            axes = (AXES[3:] + AXES[:3])[: len(axes)]
    return (*time, *axes, *temperature)
