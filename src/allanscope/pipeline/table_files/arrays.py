"""Arrays of NumPy, ``.npz`` and ``.npy``, and what named arrays of any file are by name and shape.

In ``.npz`` an array of shape (n,) is a column and called as in text (``gx``, ``az[mg]``,
``t[us]``, ``gyro_x_dps``), one of shape (n, 3) is a sensor (``gyro``, ``acc_mps2``), and a
single one of shape (n, k) is a table, whose columns an array of strings called ``columns`` may
name. A number called ``rate`` is the sample rate.
"""

from __future__ import annotations

import math
import re
import zipfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from allanscope.pipeline.columns import (
    Columns,
    columns_of_array,
    columns_of_mapping,
    known_names,
)
from allanscope.pipeline.table_files import (
    MOST_BYTES,
    MOST_COLUMNS,
    MOST_MEMBERS,
    TableFile,
)
from allanscope.recording import most_unpacked
from allanscope.samples import AXES
from allanscope.wire.text import column_of

__all__ = ["Found", "columns_of_found", "read", "sort_in"]

_RATES = ("rate", "rate_hz", "sample_rate", "sample_rate_hz", "sampling_rate", "fs")
_NAMES = ("columns", "names", "axes", "header")
_WITH_UNIT = re.compile(r"\s*([^\[(]*?)\s*[\[(]([^\])]*)[\])]\s*")
_AXES = "xyz"


@dataclass(slots=True)
class Found:
    """Arrays of a file by the name that each has."""

    columns: dict[str, NDArray[Any]] = field(default_factory=dict)
    tables: dict[str, NDArray[Any]] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    rate_hz: float | None = None
    left_out: list[str] = field(default_factory=list)
    unknown: dict[str, NDArray[Any]] = field(default_factory=dict)


def read(path: Path, stream: str = "") -> TableFile:
    """Return the samples of an ``.npz`` or an ``.npy``."""
    return _from_npz(path) if zipfile.is_zipfile(path) else _from_npy(path)


def _from_npy(path: Path) -> TableFile:
    size = path.stat().st_size
    with path.open("rb") as file:
        array = _array(file, size)
    if array is None:
        raise ValueError("the array holds neither numbers nor a table")
    return TableFile(_table(array, ()), "npy")


def _from_npz(path: Path) -> TableFile:
    found = Found()
    with zipfile.ZipFile(path) as archive:
        members = [one for one in archive.infolist() if one.filename.endswith(".npy")]
        if not members:
            if "xl/workbook.xml" in archive.namelist():
                raise ValueError("an Excel workbook; save the sheet with the samples as CSV")
            raise ValueError("a ZIP archive that contains no arrays of NumPy")
        most = min(MOST_BYTES, most_unpacked(path.stat().st_size))
        if len(members) > MOST_MEMBERS or sum(one.file_size for one in members) > most:
            raise ValueError(f"more than {MOST_MEMBERS} arrays, or more than {most} bytes of them")
        for member in members:
            with archive.open(member) as file:
                sort_in(found, member.filename.removesuffix(".npy"), _array(file, member.file_size))
    return TableFile(columns_of_found(found), "npz", found.rate_hz)


def _array(file: IO[bytes], size: int) -> NDArray[Any] | None:
    """Return an array of numbers or strings, None for what is none.

    Raises
    ------
    ValueError
        For a header that claims more than there is.
    """
    version = npy.read_magic(file)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"arrays of format {version[0]}.{version[1]} are not known")
    shape, fortran, dtype = readers[version](file)
    if dtype.hasobject or dtype.kind not in "iufUV" or (dtype.kind == "V" and not dtype.names):
        return None
    count = math.prod(shape)
    if min(shape, default=0) < 0 or count * dtype.itemsize > min(size, MOST_BYTES):
        raise ValueError(f"the file is too short for its array of shape {shape}")
    data = file.read(count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise ValueError(f"an array of shape {shape} is truncated")
    flat = np.frombuffer(data, dtype)
    return flat.reshape(shape, order="F" if fortran else "C")


def sort_in(found: Found, name: str, array: NDArray[Any] | None) -> None:
    """Put an array of a file where it belongs by its name and shape."""
    if array is None:
        found.left_out.append(name)
    elif array.dtype.kind == "U":
        if name.lower() in _NAMES and array.ndim == 1 and len(array) <= MOST_COLUMNS:
            found.names = tuple(str(one)[:80] for one in array)
    elif array.dtype.names or (array.ndim == 2 and _sensor(name) is None):
        found.tables[name] = array
    elif array.ndim == 2 and array.shape[1] == len(_AXES):
        x, y, z = _sensor(name) or ("", "", "")
        found.columns |= dict(zip((x, y, z), array.T, strict=True))
    elif array.ndim == 1 and column_of(name) is not None:
        found.columns[name] = array
    elif array.ndim == 0 and name.lower() in _RATES and array.dtype.kind in "iuf":
        rate = float(array)
        found.rate_hz = rate if 0.0 < rate < 1e6 else None
    elif array.ndim > 0:
        found.left_out.append(name)
        if array.ndim == 1:
            found.unknown[name] = array


def _sensor(name: str) -> tuple[str, ...] | None:
    """Return the names of the three columns of a sensor, None for what names none.

    >>> _sensor("acc_mps2")
    ('acc_x[mps2]', 'acc_y[mps2]', 'acc_z[mps2]')
    """
    match = _WITH_UNIT.fullmatch(name[:80])
    splits = [(match[1], f"[{match[2]}]")] if match else [(name[:80], "")]
    parts = name[:80].split("_")
    splits += [("_".join(parts[:-k]), f"[{'_'.join(parts[-k:])}]") for k in (1, 2)]
    for base, unit in splits:
        columns = tuple(f"{base}_{axis}{unit}" for axis in _AXES)
        if all(_is_axis(one) for one in columns):
            return columns
    return None


def columns_of_found(found: Found) -> Columns:
    """Return the columns that the arrays of a file make.

    Where no axis is named, one array that is called by its sensor alone is its x axis.
    """
    if not found.tables and not any(_is_axis(name) for name in found.columns):
        for name, array in found.unknown.items():
            if _is_axis(f"{name}_x"):
                found.columns[f"{name}_x"] = array
                found.left_out.remove(name)
    if any(_is_axis(name) for name in found.columns):
        left_out = [*found.left_out, *found.tables]
        columns = columns_of_mapping(found.columns)
    elif len(found.tables) == 1:
        left_out = found.left_out
        columns = _table(next(iter(found.tables.values())), found.names)
        others = {k: v for k, v in found.columns.items() if len(v) == _length(columns)}
        if others:  # the time of a table beside it
            axes = {
                f"{axis}[{columns.units[axis]}]" if columns.units[axis] else axis: values
                for axis, values in columns.axes.items()
            }
            columns = replace(columns_of_mapping({**axes, **others}), assumed=columns.assumed)
    else:
        names = [*found.columns, *found.tables, *found.left_out]
        raise ValueError(
            f"no axis among the arrays {' '.join(names)[:200] or '(none)'}; "
            f"call them t {' '.join(AXES)} temp, or gyro and accel (three columns each), "
            "or give one table"
        )
    if not left_out:
        return columns
    remark = f"left out, as their names are not known: {' '.join(left_out)[:200]}"
    return replace(columns, assumed=(*columns.assumed, remark))


def _is_axis(name: str) -> bool:
    column = column_of(name)
    return column is not None and column.axis >= 0


def _table(array: NDArray[Any], names: tuple[str, ...]) -> Columns:
    """Return the columns of one array; those whose name is not known are left out."""
    if array.dtype.names:
        known = known_names(array.dtype.names) or {name: name for name in array.dtype.names}
        return columns_of_mapping({ours: array[name] for name, ours in known.items()})
    if array.ndim == 2 and len(names) == array.shape[1]:
        known = known_names(names)
        return columns_of_mapping({ours: array[:, names.index(n)] for n, ours in known.items()})
    return columns_of_array(array, None, timed=True)


def _length(columns: Columns) -> int:
    return len(next(iter(columns.axes.values())))
