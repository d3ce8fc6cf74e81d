"""Arrays as a stream: a StreamInfo, Blocks and Gaps, as if a decoder had told of them.

That way everything that is done with a device is done with arrays too: the same sums, fit and
closed loop. Names and units are those of delimited text.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.parts import PARTS, part_named
from allanscope.pipeline.settings import DeviceSettings
from allanscope.samples import AXES, Block, Event, Gap, StreamInfo, Ticks, unit_of
from allanscope.wire.pacing import period_of, resolution_of
from allanscope.wire.text.columns import Column, column_of
from allanscope.wire.text.units import DIVISORS, Quantity, quantity_named

__all__ = [
    "Columns",
    "columns_of_array",
    "columns_of_mapping",
    "events_of_columns",
    "with_units",
    "words_of",
]

ROWS = 1 << 16
"""Rows of one Block."""

LONG_STEP = 1.5
"""Times that lie farther apart than this many periods have samples missing between them."""

AFTER_RESET = {"gyro": 250.0, "accel": 2.0}
"""Full scales of these parts as long as nobody writes to their registers."""


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
    """

    axes: Mapping[str, NDArray[Any]]
    units: Mapping[str, str]
    time_s: NDArray[np.float64] | None = None
    temperature_c: NDArray[np.float64] | None = None


def columns_of_array(data: ArrayLike, axes: Sequence[str] | None) -> Columns:
    """Return the columns of an array of shape (n,) or (n, k).

    Parameters
    ----------
    data : array_like
        Samples.
    axes : sequence of str, optional
        Name of each column. Without it one column is gx, three are the gyroscope, six both sensors,
        as in text without a header; and a structured array says it itself.

    Raises
    ------
    ValueError
        For another shape, or names that do not fit it.

    Examples
    --------
    >>> list(columns_of_array(np.zeros((5, 3)), None).axes)
    ['gx', 'gy', 'gz']
    """
    values = np.asarray(data)
    if values.dtype.names:
        return columns_of_mapping({name: values[name] for name in axes or values.dtype.names})
    if values.ndim == 1:
        values = values[:, np.newaxis]
    if values.ndim != 2:
        raise ValueError(f"an array of samples has shape (n,) or (n, axes), not {values.shape}")
    if axes is None:
        axes = _usual_axes(values.shape)
    if len(axes) != values.shape[1]:
        raise ValueError(f"{len(axes)} axis names do not fit an array of shape {values.shape}")
    return columns_of_mapping(dict(zip(axes, values.T, strict=True)))


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
        plain = AXES[column.axis] if column.axis >= 0 else column.quantity
        if plain in found:
            raise ValueError(f"column {name!r} comes twice")
        found[plain] = (column, _column(str(name), values))
    axes = {axis: found[axis][1] for axis in AXES if axis in found}
    if not axes:
        raise ValueError(f"no axis among the columns {list(data)}; axes are {' '.join(AXES)}")
    lengths = {len(values) for _, values in found.values()}
    if len(lengths) > 1:
        raise ValueError(f"columns differ in length: {sorted(lengths)}")
    return Columns(
        axes,
        {axis: found[axis][0].unit for axis in axes},
        _converted(found.get("time"), "s"),
        _converted(found.get("temperature"), "degc"),
    )


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
        quantity, plain = quantity_named(_group(name), unit)
        for axis in columns.axes:
            if axis == name or (name not in AXES and _group(axis) == quantity):
                given[axis] = plain
    return replace(columns, units=given)


def words_of(columns: Columns, info: StreamInfo) -> str:
    """Return how the columns were understood: ``gx dps, gy dps`` or ``az lsb of 6.1e-05 g``."""
    return ", ".join(
        f"{axis} {_unit(axis, column, columns)}"
        + (f" of {scale:g} {unit_of(axis)}" if _unit(axis, column, columns) == "lsb" else "")
        for (axis, column), scale in zip(columns.axes.items(), info.scale, strict=True)
    )


def events_of_columns(columns: Columns, device: DeviceSettings) -> Iterator[Event]:
    """Yield what a decoder would yield of these samples.

    Integers without a unit are counts, floats dps and g. Where the times leave a period out there
    is a Gap.

    Raises
    ------
    ValueError
        For a sample that is not finite, times that do not go up, or a rate that neither the caller
        nor the times tell.
    """
    info, counts = _described(columns, device)
    yield info
    n = len(counts)
    holes = _holes(columns.time_s)
    bounds = [0, *holes, n]
    index = 0
    for start, stop in pairwise(bounds):
        if start:
            lost = holes[start]
            yield Gap("file", lost)
            index += lost
        for first in range(start, stop, ROWS):
            rows = slice(first, min(first + ROWS, stop))
            yield Block(index, counts[rows], _ticks(columns, rows))
            index += len(counts[rows])


def _described(columns: Columns, device: DeviceSettings) -> tuple[StreamInfo, NDArray[Any]]:
    """Return what the samples mean, and the samples as counts of that."""
    part = part_named(device.part) if device.part else PARTS["LSM6DSM"]
    scale_of_counts = {
        "gyro": part.gyro_scale(device.gyro_fs or AFTER_RESET["gyro"]),
        "accel": part.accel_scale(device.accel_fs or AFTER_RESET["accel"]),
    }
    values, scales = [], []
    for axis, column in columns.axes.items():
        unit = _unit(axis, column, columns)
        values.append(column if unit == "lsb" else column / DIVISORS[_group(axis)][unit])
        scales.append(scale_of_counts[_group(axis)] if unit == "lsb" else 1.0)
    times = columns.time_s
    info = StreamInfo(
        axes=tuple(columns.axes),
        scale=tuple(scales),
        nominal_hz=device.rate_hz or _rate_of(times),
        rate_claimed=bool(device.rate_hz),
        part=device.part,
        wire="arrays",
        time_resolution_s=0.0 if times is None else resolution_of(cast("Any", times[:1000])),
        device_clock=times is not None,
    )
    return info, _block_counts(values)


def _block_counts(values: list[NDArray[Any]]) -> NDArray[Any]:
    """Return one array for all axes: int16 or int32 where all are integers, else float64."""
    rows = np.column_stack(values)
    if rows.dtype.kind in "iu":
        for dtype in (np.int16, np.int32):
            limits = np.iinfo(dtype)
            if rows.size and rows.min() >= limits.min and rows.max() <= limits.max:
                return rows.astype(dtype)
    return rows.astype(np.float64)


def _ticks(columns: Columns, rows: slice) -> Ticks:
    if columns.time_s is None and columns.temperature_c is None:
        return Ticks.none()
    n = rows.stop - rows.start
    unknown = np.full(n, np.nan)
    return Ticks(
        np.arange(n),
        unknown if columns.time_s is None else columns.time_s[rows],
        unknown,
        unknown if columns.temperature_c is None else columns.temperature_c[rows],
    )


def _holes(times: NDArray[np.float64] | None) -> dict[int, int]:
    """Return the row after each hole, and how many samples it lacks."""
    if times is None or len(times) < 3:
        return {}
    steps = np.diff(times)
    period = float(np.median(steps))
    if not period > 0.0 or steps.min() < 0.0:
        raise ValueError("times must go up from row to row")
    after = np.flatnonzero(steps > LONG_STEP * period)
    lost = np.rint(steps[after] / period).astype(np.int64) - 1
    return dict(zip((after + 1).tolist(), lost.tolist(), strict=True))


def _rate_of(times: NDArray[np.float64] | None) -> float:
    period = None if times is None else period_of(cast("Any", times[:1000]))
    if period is None:
        raise ValueError("the sample rate is not known; give rate, in Hz, or a column t")
    return float(f"{1.0 / period:.4g}")


def _column(name: str, values: ArrayLike) -> NDArray[Any]:
    column = np.asarray(values)
    if column.ndim != 1:
        raise ValueError(f"column {name} must have shape (n,), got {column.shape}")
    if column.dtype.kind not in "iuf":
        raise ValueError(f"column {name} must hold integers or floats, got {column.dtype}")
    if column.dtype.kind == "f":
        column = column.astype(np.float64)
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size and not name.lower().startswith("temp"):
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


def _usual_axes(shape: tuple[int, ...]) -> tuple[str, ...]:
    columns = {1: AXES[:1], 3: AXES[:3], 6: AXES}.get(shape[1])
    if columns is None:
        raise ValueError(f"an array of shape {shape} needs axes: a name for each column")
    return columns


def _unit(axis: str, column: NDArray[Any], columns: Columns) -> str:
    if columns.units[axis]:
        return columns.units[axis]
    if column.dtype.kind in "iu":
        return "lsb"
    return unit_of(axis)


def _group(name: str) -> Quantity:
    """Return the quantity of an axis, or the name itself where it is no axis."""
    if name in AXES:
        return "gyro" if name.startswith("g") else "accel"
    return cast("Quantity", name)
