"""Tables in binary files: arrays of NumPy (``.npz``, ``.npy``) and Parquet, to columns.

Nothing in such a file is run: pickled objects are refused. What a header claims is compared with
what the file has before any memory is taken for it.
"""

from __future__ import annotations

import json
import math
import re
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from allanscope.errors import InputError, UsageError
from allanscope.pipeline.columns import Columns, columns_of_array, columns_of_mapping
from allanscope.samples import AXES
from allanscope.wire.text import column_of

__all__ = ["TableFile", "is_table_file", "table_of_file"]

MOST_BYTES = 1 << 31
"""Of arrays in memory: six axes as float64 over 11 h at 1 kHz."""
MOST_MEMBERS = 256
MOST_COLUMNS = 4096
"""More than this is no table of sensors."""

_MAGICS = {b"PK\x03\x04": "npz", b"\x93NUM": "npy", b"PAR1": "parquet"}
_RATES = ("rate", "rate_hz", "sample_rate", "sample_rate_hz", "sampling_rate")
_NAMES = ("columns", "names", "axes", "header")
_WITH_UNIT = re.compile(r"\s*([^\[(]*?)\s*[\[(]([^\])]*)[\])]\s*")
_AXES = "xyz"


@dataclass(frozen=True, slots=True)
class TableFile:
    """What a file of arrays holds.

    Attributes
    ----------
    columns : Columns
        Its samples.
    rate_hz : float or None
        Rate that it states.
    part : str
        Part that it names.
    kind : {'npz', 'npy', 'parquet'}
        What it is.
    """

    columns: Columns
    kind: str
    rate_hz: float | None = None
    part: str = ""


@dataclass(slots=True)
class _Found:
    """Arrays of a file by the name that each has."""

    columns: dict[str, NDArray[Any]] = field(default_factory=dict)
    tables: dict[str, NDArray[Any]] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    rate_hz: float | None = None
    left_out: list[str] = field(default_factory=list)


def is_table_file(path: Path) -> bool:
    """Return whether a file begins as one of these does."""
    return _kind(path) != ""


def _kind(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return _MAGICS.get(file.read(4), "")
    except OSError:
        return ""


def table_of_file(path: Path) -> TableFile:
    """Read a file of arrays.

    In ``.npz`` an array of shape (n,) is a column and called as in text (``gx``, ``az[mg]``,
    ``t[us]``, ``gyro_x_dps``), one of shape (n, 3) is a sensor (``gyro``, ``acc_mps2``), and a
    single one of shape (n, k) is a table, whose columns an array of strings called ``columns`` may
    name. A number called ``rate`` is the sample rate. Parquet has columns called as in text.

    Raises
    ------
    InputError
        When it is damaged, too large, or holds no axis; the message says which arrays it has.
    UsageError
        When it is Parquet and pyarrow is not installed.
    """
    kind = _kind(path)
    read: Mapping[str, Callable[[Path], TableFile]] = {
        "npz": _from_npz,
        "npy": _from_npy,
        "parquet": _from_parquet,
    }
    try:
        return read[kind](path)
    except (ValueError, EOFError, zlib.error, zipfile.BadZipFile) as error:
        if isinstance(error, UsageError):
            raise
        raise InputError(f"{path}: {_line(error)}") from None
    except (OSError, NotImplementedError, RuntimeError, MemoryError) as error:
        raise InputError(f"cannot read {path}: {_line(error)}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__


# --- NumPy --------------------------------------------------------------------------------------


def _from_npy(path: Path) -> TableFile:
    size = path.stat().st_size
    with path.open("rb") as file:
        array = _array(file, size)
    if array is None:
        raise ValueError("the array holds neither numbers nor a table")
    return TableFile(_table(array, ()), "npy")


def _from_npz(path: Path) -> TableFile:
    found = _Found()
    with zipfile.ZipFile(path) as archive:
        members = [one for one in archive.infolist() if one.filename.endswith(".npy")]
        if not members:
            raise ValueError("a ZIP archive that holds no arrays of NumPy")
        if len(members) > MOST_MEMBERS or sum(one.file_size for one in members) > MOST_BYTES:
            raise ValueError(f"more than {MOST_MEMBERS} arrays or {MOST_BYTES >> 30} GiB of them")
        for member in members:
            with archive.open(member) as file:
                _sort_in(
                    found, member.filename.removesuffix(".npy"), _array(file, member.file_size)
                )
    return TableFile(_columns(found), "npz", found.rate_hz)


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
        raise ValueError(f"an array of shape {shape} is said to be there, the file is too short")
    data = file.read(count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise ValueError(f"an array of shape {shape} is cut off")
    flat = np.frombuffer(data, dtype)
    return flat.reshape(shape, order="F" if fortran else "C")


def _sort_in(found: _Found, name: str, array: NDArray[Any] | None) -> None:
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
        if all((column := column_of(one)) and column.axis >= 0 for one in columns):
            return columns
    return None


def _columns(found: _Found) -> Columns:
    """Return the columns that the arrays of a file make."""
    if any((column := column_of(name)) and column.axis >= 0 for name in found.columns):
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
            f"call them t {' '.join(AXES)} temp, or give one table"
        )
    if not left_out:
        return columns
    said = f"left out, as their names are not known: {' '.join(left_out)[:200]}"
    return replace(columns, assumed=(*columns.assumed, said))


def _table(array: NDArray[Any], names: tuple[str, ...]) -> Columns:
    """Return the columns of one array; those whose name is not known are left out."""
    if array.dtype.names:
        known = [name for name in array.dtype.names if column_of(name) is not None]
        return columns_of_array(array, known)
    if array.ndim == 2 and len(names) == array.shape[1]:
        known = [name for name in names if column_of(name) is not None]
        return columns_of_mapping({name: array[:, names.index(name)] for name in known})
    return columns_of_array(array, None, timed=True)


def _length(columns: Columns) -> int:
    return len(next(iter(columns.axes.values())))


# --- Parquet ------------------------------------------------------------------------------------


def _from_parquet(path: Path) -> TableFile:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise UsageError("Parquet needs pyarrow: pip install pyarrow") from None
    try:
        with pq.ParquetFile(path) as file:
            schema = file.schema_arrow
            if len(schema) > MOST_COLUMNS:
                raise ValueError(f"a table of {len(schema)} columns")
            known = [
                one.name
                for one in schema
                if column_of(one.name) is not None
                and (pa.types.is_integer(one.type) or pa.types.is_floating(one.type))
            ]
            if file.metadata.num_rows * max(len(known), 1) * 8 > MOST_BYTES:
                raise ValueError(f"{file.metadata.num_rows} rows: more than fit in memory")
            arrays = _columns_of_parquet(file, known)
            facts = _facts(schema.metadata)
    except pa.ArrowException as error:
        raise ValueError(f"no sound Parquet file: {_line(error)}") from None
    columns = columns_of_mapping(arrays)
    scales = _numbers(facts.get("axes"), facts.get("scale"))
    rate = facts.get("rate_hz")
    return TableFile(
        replace(columns, scales={a: s for a, s in scales.items() if a in columns.axes}),
        "parquet",
        float(rate) if columns.time_s is None and isinstance(rate, int | float) else None,
        part if isinstance(part := facts.get("part"), str) else "",
    )


def _columns_of_parquet(file: Any, names: list[str]) -> dict[str, NDArray[Any]]:
    """Return the columns, read a batch at a time: what rows there are, whatever is claimed."""
    parts: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
    held = 0
    for batch in file.iter_batches(columns=names):
        for name in names:
            part = batch.column(name).to_numpy(zero_copy_only=False)
            held += part.nbytes
            parts[name].append(part)
        if held > MOST_BYTES:
            raise ValueError(f"more than {MOST_BYTES >> 30} GiB of samples")
    if not held:
        raise ValueError(f"no samples in columns called t {' '.join(AXES)} temp")
    return {name: np.concatenate(pieces) for name, pieces in parts.items()}


def _facts(metadata: Mapping[bytes, bytes] | None) -> dict[str, Any]:
    """Return what our own export says of its columns; empty for other people's files."""
    try:
        facts = json.loads((metadata or {}).get(b"allanscope", b"{}"))
    except (ValueError, RecursionError):
        return {}
    return facts if isinstance(facts, dict) else {}


def _numbers(names: Any, values: Any) -> dict[str, float]:
    """Return which axis has which scale, as far as these are names and positive numbers."""
    if not isinstance(names, list) or not isinstance(values, list):
        return {}
    pairs = zip(names, values, strict=False)
    return {
        name: float(value)
        for name, value in pairs
        if name in AXES and isinstance(value, int | float) and 0.0 < value < 1e6
    }
