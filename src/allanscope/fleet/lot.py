"""The table of a lot: one row for each recording and axis, written as Parquet, read by columns.

A row is made of the JSON of a single run and of nothing else, so a fleet and single runs give the
same table, byte for byte. Coefficients, levels and effects are in the internal units (dps, g, s).
The report is reckoned from what was read back, a `Lot`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from allanscope.atomic_write import atomic_folder, atomic_write
from allanscope.errors import UsageError
from allanscope.quantities import LETTERS
from allanscope.samples import AXES
from allanscope.sanitize import encodable

__all__ = ["TAUS", "EffectColumn", "Lot", "rows_of", "schema", "write_table"]

TAUS = 10.0 ** (np.arange(-12, 21) / 4.0)
"""Averaging times in s at which the table holds the Allan deviation of every row, shape (33,)."""

_PARAMETER = ("name", "value", "lower", "upper", "unit")
"""What is told of a parameter of an effect that is a number."""

_READ = (
    *("recording", "unit", "axis", "sensor_unit", "part", "origin", "started", "duration_s"),
    "samples",
    *("lost_samples", "damaged_places", "nominal_hz", "measured_hz", "rate_uncertainty_ppm"),
    *("temperature_lowest", "temperature_highest", "level_mean", "datasheet_limit"),
    *("datasheet_verdict", "explained", "residual_after_chi2_per_dof", "residual_after_p_value"),
    *(f"{name}_{part}" for name in "NBK" for part in ("value", "lower", "upper", "detected")),
    *("curve", "curve_edf"),
    "effects.list.element.kind",
    *(f"effects.list.element.parameters.list.element.{name}" for name in _PARAMETER),
)
"""Columns that the report needs."""

_JUDGED = tuple(
    f"{prefix}{name}_{part}"
    for prefix, names in (("", "QR"), ("before_", "QBKR"))
    for name in names
    for part in ("value", "lower", "upper", "detected")
)
"""Columns that limits need besides."""

_NONE = "__HIVE_DEFAULT_PARTITION__"

MOST_PARTS = 512
"""Files that are written at a time."""

_COEFFICIENT = ("value", "lower", "upper", "detected")
_ERROR = ("chi2_per_dof", "p_value", "rms_percent", "expected_rms_percent", "worst_band_z")
_LINK = ("bytes", "frames", "crc_errors", "resyncs", "suspect", "reconnects")
_TEMPERATURE = ("first", "last", "lowest", "highest")
_TEXTS = ("started", "unique_id", "serial_number", "firmware")
GROUP_ROWS = 1 << 11
"""So many rows are objects of Python at a time, when the table is written and when it is read."""


@dataclass(frozen=True)
class Lot:
    """Rows of the table, one for each recording and axis.

    Attributes
    ----------
    columns : mapping
        Name to values of the whole table, shape (m,): numbers are floats, with NaN for what is not
        known; truths are floats too; texts are objects, ``effects`` an `EffectColumn`.
    rows : ndarray of intp, shape (n,), optional
        Which rows of the table these are; all without. A column is copied when it is looked at.
    """

    columns: Mapping[str, Any]
    rows: NDArray[np.intp] | None = None

    @classmethod
    def read(cls, table: Path, limits: bool = False) -> Lot:
        """Return what a table holds, without the columns that no report needs.

        Parameters
        ----------
        table : Path
            File, or folder of a partitioned table.
        limits : bool
            Also what it takes to hold runs against limits.
        """
        groups: dict[str, list[Any]] = defaultdict(list)
        same: dict[str, str] = {}
        for read in _row_groups(table, [*_READ, *(_JUDGED if limits else ())]):
            for name in read.column_names:
                column = read.column(name).combine_chunks()
                effects = name == "effects"
                groups[name].append(_effects(column) if effects else _values(column, same))
        effects = EffectColumn.joined(groups.pop("effects"))
        columns = {name: np.concatenate(parts) for name, parts in groups.items()}
        return cls({**columns, "effects": effects})

    def __len__(self) -> int:
        return len(self.columns["axis"] if self.rows is None else self.rows)

    def __getitem__(self, name: str) -> Any:
        """Return a column of these rows."""
        return self.columns[name] if self.rows is None else self.columns[name][self.rows]

    @property
    def axes(self) -> list[str]:
        """Names of the axes that there are, in the order of the samples."""
        here = set(self["axis"].tolist())
        return [axis for axis in AXES if axis in here]

    @property
    def units(self) -> NDArray[np.str_]:
        """The unit of each row."""
        return np.asarray(self["unit"], np.str_)

    def where(self, mask: NDArray[np.bool_] | NDArray[np.intp]) -> Lot:
        """Return some of the rows, by truths or by their numbers."""
        rows = np.arange(len(self)) if self.rows is None else self.rows
        return replace(self, rows=rows[mask])

    def of_axis(self, axis: str) -> Lot:
        """Return the rows of one axis."""
        return self.where(self["axis"] == axis)

    def detected(self, name: str) -> Lot:
        """Return the rows in which a coefficient was found, and not only an upper limit for it."""
        return self.where((self[f"{name}_detected"] == 1.0) & (self[f"{name}_value"] > 0.0))


def _row_groups(table: Path, wanted: Sequence[str]) -> Iterator[Any]:
    """Yield the row groups of a table, those of a partitioned one with what their folders say."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = schema()
    for path in sorted(table.rglob("*.parquet")) if table.is_dir() else [table]:
        named = [folder.split("=", 1) for folder in path.relative_to(table).parts if "=" in folder]
        same = {name: None if value == _NONE else unquote(value) for name, value in named}
        columns = [name for name in wanted if name not in same]
        with path.open("rb") as opened:  # by us: Arrow takes no names that are not UTF-8
            file = pq.ParquetFile(opened)
            for number in range(file.num_row_groups):
                read = file.read_row_group(number, columns=columns)
                for name, value in same.items():
                    if name in wanted:
                        told = pa.array([value] * len(read), types.field(name).type)
                        read = read.append_column(name, told)
                yield read


def _values(column: Any, same: dict[str, str]) -> NDArray[Any]:
    """Return a column of the table as an array; texts that are alike are one object."""
    import pyarrow as pa

    kind = column.type
    if pa.types.is_string(kind):
        told = [one and same.setdefault(one, one) for one in column.to_pylist()]
        return np.array([*told, None], object)[:-1]
    if not pa.types.is_list(kind):
        return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), np.float64)
    values = np.full((len(column), len(TAUS)), np.nan, np.float32)
    known = ~column.is_null().to_numpy(zero_copy_only=False)
    values[known] = column.flatten().to_numpy(zero_copy_only=False).reshape(-1, len(TAUS))
    return values


@dataclass(frozen=True)
class EffectColumn:
    """The effects of all rows: numbers side by side, a few dozen bytes each.

    Attributes
    ----------
    rows : ndarray of intp, shape (n,)
        Which of the rows of `first` these are.
    first : ndarray of int64, shape (all rows + 1,)
        First effect of each row.
    kind : ndarray of object, shape (effects,)
        Of each effect.
    parameter : ndarray of int64, shape (effects + 1,)
        First parameter of each effect.
    name, unit : ndarray of object, shape (parameters,)
    numbers : ndarray of float64, shape (parameters, 3)
        Value, lower and upper limit; NaN where there is none.
    """

    rows: NDArray[np.intp]
    first: NDArray[np.int64]
    kind: NDArray[np.object_]
    parameter: NDArray[np.int64]
    name: NDArray[np.object_]
    unit: NDArray[np.object_]
    numbers: NDArray[np.float64]

    @classmethod
    def of(cls, rows: Sequence[Sequence[Mapping[str, Any]] | None]) -> EffectColumn:
        """Return the effects of some rows of the table, as `rows_of` has them."""
        import pyarrow as pa

        return _effects(pa.array(rows, schema().field("effects").type))

    @classmethod
    def joined(cls, parts: Sequence[EffectColumn]) -> EffectColumn:
        """Return one column of the effects of several, each of which has all of its rows."""

        def offsets(each: list[NDArray[np.int64]]) -> NDArray[np.int64]:
            ends = np.cumsum([0, *(one[-1] for one in each)])
            shifted = [one[:-1] + end for one, end in zip(each, ends[:-1], strict=True)]
            return np.concatenate([*shifted, ends[-1:]])

        first = offsets([one.first for one in parts])
        return cls(
            np.arange(len(first) - 1),
            first,
            np.concatenate([one.kind for one in parts]),
            offsets([one.parameter for one in parts]),
            np.concatenate([one.name for one in parts]),
            np.concatenate([one.unit for one in parts]),
            np.concatenate([one.numbers for one in parts]),
        )

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, which: NDArray[Any]) -> EffectColumn:
        return replace(self, rows=self.rows[which])

    def rows_with(self, parameter: str) -> NDArray[np.bool_]:
        """Return which rows have an effect with a parameter of this name."""

        def any_within(marked: NDArray[np.bool_], ends: NDArray[np.int64]) -> NDArray[np.bool_]:
            before = np.concatenate([[0], np.cumsum(marked)])
            return np.asarray(before[ends[1:]] > before[ends[:-1]])

        effects = any_within(self.name == parameter, self.parameter)
        return np.asarray(any_within(effects, self.first)[self.rows])

    def of_rows(self) -> Iterator[range]:
        """Yield the numbers of the effects of each row."""
        for row in self.rows.tolist():
            yield range(int(self.first[row]), int(self.first[row + 1]))

    def parameters(self, effect: int) -> dict[str, tuple[float, float, float, str]]:
        """Return the parameters of an effect: name to value, lower, upper and unit."""
        here = range(int(self.parameter[effect]), int(self.parameter[effect + 1]))
        rows = ((self.name[at], (*self.numbers[at].tolist(), self.unit[at])) for at in here)
        return {name: values for name, values in rows if values[0] == values[0]}


def _effects(column: Any) -> EffectColumn:
    """Return the effects of a group of rows."""
    fields = column.flatten()
    told = fields.field("parameters")
    each = told.flatten()

    def texts(values: Any) -> NDArray[np.object_]:
        """Return texts of which each is one object, however often it comes."""
        coded = values.dictionary_encode()
        names = np.array([*coded.dictionary.to_pylist(), None], object)
        codes = coded.indices.fill_null(len(names) - 1).to_numpy(zero_copy_only=False)
        return np.asarray(names[codes])

    def ends(lists: Any) -> NDArray[np.int64]:
        lengths = lists.value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
        return np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])

    numbers = [
        np.asarray(each.field(name).to_numpy(zero_copy_only=False), np.float64)
        for name in ("value", "lower", "upper")
    ]
    return EffectColumn(
        np.arange(len(column)),
        ends(column),
        texts(fields.field("kind")),
        ends(told),
        texts(each.field("name")),
        texts(each.field("unit")),
        np.column_stack(numbers) if len(each) else np.empty((0, 3)),
    )


def schema() -> Any:
    """Return the columns of the table."""
    import pyarrow as pa

    text, real, whole, truth = pa.string(), pa.float64(), pa.int64(), pa.bool_()
    parameter = pa.struct(
        {"name": text, "value": real, "text": text, "lower": real, "upper": real, "unit": text}
    )
    effect = pa.struct(
        {
            "kind": text,
            "parameters": pa.list_(parameter),
            "axes": pa.list_(text),
            "equivalent": pa.list_(text),
            "words": text,
        }
    )
    columns = {"recording": text, "unit": text, "axis": text, "sensor_unit": text, "part": text}
    columns |= {"origin": text}
    columns |= {"sha256": text, "allanscope": text} | dict.fromkeys(_TEXTS, text)
    columns |= {"duration_s": real, "samples": whole, "lost_samples": whole}
    columns |= {"unknown_losses": whole, "segments": whole, "damaged_places": whole}
    columns |= {f"link_{name}": whole for name in _LINK}
    columns |= {"nominal_hz": real, "measured_hz": real, "rate_uncertainty_ppm": real}
    columns |= {f"temperature_{name}": real for name in _TEMPERATURE}
    columns |= {"level_mean": real, "level_stability": real}
    for prefix in ("", "before_"):
        for name in LETTERS:
            types = (real, real, real, truth)
            pairs = zip(_COEFFICIENT, types, strict=True)
            columns |= {f"{prefix}{name}_{part}": kind for part, kind in pairs}
    columns |= {"datasheet_limit": real, "datasheet_measured": real, "datasheet_verdict": text}
    for when in ("before", "after"):
        columns |= {f"residual_{when}_{name}": real for name in _ERROR}
    columns |= {"curve": pa.list_(pa.float32()), "curve_edf": pa.list_(pa.float32())}
    columns |= {"held_out_nats": real, "held_out_nats_se": real, "explained": truth}
    columns |= {"effects": pa.list_(effect), "remarks": pa.list_(text)}
    return pa.schema(columns.items())


def rows_of(recording: str, unit: str, result: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the rows of one recording, one for each axis.

    Parameters
    ----------
    recording : str
        Its path or URL.
    unit : str
        The board that it is of.
    result : mapping
        What is kept of it: ``analysis`` is the JSON of a single run, ``circumstances`` what that
        does not say.
    """
    analysis, facts = result["analysis"], result["circumstances"]
    common = {
        "recording": encodable(recording),
        "unit": encodable(unit),
        "part": analysis["part"],
        "origin": analysis.get("origin"),
        "sha256": analysis["input"]["sha256"],
        "allanscope": analysis["allanscope"],
        **{name: facts.get(name) or None for name in _TEXTS},
        **{name: analysis[name] for name in ("duration_s", "samples", "lost_samples")},
        **{name: analysis[name] for name in ("unknown_losses", "segments")},
        "damaged_places": facts.get("damaged_places"),
        **{f"link_{name}": analysis["link"].get(name) for name in _LINK},
        "nominal_hz": analysis["rate"]["nominal_hz"],
        "measured_hz": analysis["rate"]["measured_hz"],
        "rate_uncertainty_ppm": analysis["rate"]["uncertainty_ppm"],
        **{f"temperature_{name}": analysis["temperature"].get(name) for name in _TEMPERATURE},
    }
    for name, axis in analysis["axes"].items():
        remarks = [*analysis["remarks"], *axis["remarks"]]
        yield {**common, "axis": name, "sensor_unit": axis["unit"], **_axis(axis, remarks)}


def write_table(
    path: Path, rows: Iterable[Mapping[str, Any]], partition: Sequence[str] = ()
) -> int:
    """Write the rows, whole or not at all, a group at a time; return how many there were.

    Parameters
    ----------
    path : Path
        File; a folder of files where the table is partitioned.
    rows : iterable of dict
        As `rows_of` yields them.
    partition : sequence of str
        Columns that become folders, as ``axis=gx``, and are in no file (Hive's layout).

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    written = 0
    if not partition:
        with (
            atomic_write(path) as part,
            part.open("wb") as file,  # by us: Arrow takes no names that are not UTF-8
            _writer(file, schema()) as write,
        ):
            for group in _groups(rows):
                write(group)
                written += len(group)
        return written
    with atomic_folder(path) as folder, ExitStack() as opened:
        writers: dict[Path, Callable[[list[Mapping[str, Any]]], None]] = {}
        fields = [one for one in schema() if one.name not in partition]
        for group in _groups(rows):
            parts: dict[Path, list[Mapping[str, Any]]] = defaultdict(list)
            for row in group:
                parts[_folder_of(row, partition)].append(row)
            for place, some in parts.items():
                if place not in writers:
                    if len(writers) == MOST_PARTS:
                        raise UsageError(
                            f"--partition {','.join(partition)} gives more than {MOST_PARTS} files"
                        )
                    (folder / place).mkdir(parents=True)
                    file = opened.enter_context((folder / place / "part-0.parquet").open("wb"))
                    writers[place] = opened.enter_context(_writer(file, _schema_of(fields)))
                writers[place](some)
            written += len(group)
    return written


@contextmanager
def _writer(file: IO[bytes], columns: Any) -> Iterator[Callable[[list[Mapping[str, Any]]], None]]:
    """Give a function that writes rows into a file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with pq.ParquetWriter(file, columns, compression="zstd") as writer:
        yield lambda rows: writer.write_table(pa.Table.from_pylist(rows, schema=columns))


def _schema_of(fields: list[Any]) -> Any:
    import pyarrow as pa

    return pa.schema(fields)


def _folder_of(row: Mapping[str, Any], partition: Sequence[str]) -> Path:
    """Return the folder of a row.

    >>> _folder_of({"axis": "gx", "unit": "a/b"}, ("unit", "axis"))
    PosixPath('unit=a%2Fb/axis=gx')
    """
    values = ((name, row[name]) for name in partition)
    return Path(
        *(f"{name}={_NONE if value is None else quote(value, '')}" for name, value in values)
    )


def _groups(rows: Iterable[Mapping[str, Any]]) -> Iterator[list[Mapping[str, Any]]]:
    group: list[Mapping[str, Any]] = []
    for row in rows:
        group.append(row)
        if len(group) == GROUP_ROWS:
            yield group
            group = []
    if group:
        yield group


def _axis(axis: Mapping[str, Any], remarks: list[str]) -> dict[str, Any]:
    residual = axis.get("residual", {})
    density = axis.get("datasheet", {}).get("density", {})
    level = axis.get("level") or {}  # without rows there is none
    return {
        "level_mean": level.get("mean"),
        "level_stability": level.get("stability"),
        **_curve(axis.get("curves", {}).get("oadev")),
        **_coefficients("", axis.get("coefficients", {})),
        **_coefficients("before_", axis.get("coefficients_before", {})),
        "datasheet_limit": density.get("limit"),
        "datasheet_measured": density.get("measured"),
        "datasheet_verdict": density.get("verdict"),
        **{
            f"residual_{when}_{name}": residual.get(when, {}).get(name)
            for when in ("before", "after")
            for name in _ERROR
        },
        "held_out_nats": residual.get("held_out_nats"),
        "held_out_nats_se": residual.get("held_out_nats_se"),
        "explained": residual.get("explained"),
        "effects": [_effect(one) for one in axis.get("effects", [])],
        "remarks": [*remarks, *residual.get("remarks", [])],
    }


def _curve(found: Mapping[str, Any] | None) -> dict[str, list[float] | None]:
    """Return the Allan deviation and its degrees of freedom at `TAUS`, where it is trusted."""
    if found is None:
        return {"curve": None, "curve_edf": None}
    trusted = np.asarray(found["trusted"], bool)
    columns = (np.asarray(found[name], np.float64) for name in ("tau", "deviation", "edf"))
    tau, deviation, edf = (np.log(column[trusted]) for column in columns)
    if len(tau) < 2:
        return {"curve": None, "curve_edf": None}
    at = np.log(TAUS)
    known = (at >= tau[0] - 1e-9) & (at <= tau[-1] + 1e-9)
    return {
        name: np.where(known, np.exp(np.interp(at, tau, logs)), np.nan).tolist()
        for name, logs in (("curve", deviation), ("curve_edf", edf))
    }


def _coefficients(prefix: str, found: Mapping[str, Any]) -> dict[str, Any]:
    return {
        f"{prefix}{name}_{part}": found.get(name, {}).get(part)
        for name in LETTERS
        for part in _COEFFICIENT
    }


def _effect(effect: Mapping[str, Any]) -> dict[str, Any]:
    parameters = [_parameter(name, one) for name, one in effect["parameters"].items()]
    words = effect["evidence"].get("words")
    return {
        "kind": effect["kind"],
        "parameters": parameters,
        "axes": effect["axes"],
        "equivalent": effect["equivalent"],
        "words": None if words is None else str(words),
    }


def _parameter(name: str, one: Mapping[str, Any]) -> dict[str, Any]:
    """Return one parameter: a number, or a name such as the axis that is coupled to."""
    value = one["value"]
    told = isinstance(value, str)
    return {
        "name": name,
        "value": None if told else value,
        "text": value if told else None,
        "lower": one["lower"],
        "upper": one["upper"],
        "unit": one["unit"],
    }
