"""Export of samples: a table of times, axes and temperature, as delimited text or as Parquet.

Time is the index of a sample divided by the sample rate, so a gap of known length is a jump in
time. A gap of unknown length is shown as one missing sample: neighbours in the
table that are no neighbours in time must never look like neighbours. The same holds between two
configurations of a device, whose indices have nothing to do with each other.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from allanscope.atomic_write import atomic_write
from allanscope.errors import InputError, UsageError
from allanscope.quantities import counted
from allanscope.samples import Block, Event, Gap, StreamInfo, unit_of

__all__ = ["ExportReport", "Table", "Unit", "export_csv", "export_parquet", "tables"]

Unit = Literal["physical", "lsb"]
GROUP_ROWS = 1 << 17


@dataclass(slots=True)
class ExportReport:
    """What was written.

    Attributes
    ----------
    out : Path
        The file.
    rows : int
        Samples.
    gaps, unknown_gaps : int
        Gaps, and those among them of unknown length.
    """

    out: Path
    rows: int = 0
    gaps: int = 0
    unknown_gaps: int = 0

    def __str__(self) -> str:
        """Return one line for the user."""
        unknown = f" ({self.unknown_gaps} of unknown length)" if self.unknown_gaps else ""
        gaps = f", {counted(self.gaps, 'gap')}{unknown}" if self.gaps else ""
        return f"Saved: {self.out}: {counted(self.rows, 'sample')}{gaps}"


@dataclass(frozen=True, slots=True)
class Table:
    """Some rows of an export.

    Attributes
    ----------
    info : StreamInfo
        What the columns mean.
    time_s : ndarray, shape (n,)
        From the first sample of the export.
    values : ndarray, shape (n, axes)
        Counts, or dps and g.
    temperature_c : ndarray, shape (n,) or None
        The last one received; None in an export without temperature.
    """

    info: StreamInfo
    time_s: NDArray[np.float64]
    values: NDArray[np.generic]
    temperature_c: NDArray[np.float64] | None

    def tokens(self, unit: Unit) -> list[str]:
        """Return the heads of the columns, name and unit."""
        axes = [f"{a}[{'lsb' if unit == 'lsb' else unit_of(a)}]" for a in self.info.axes]
        return ["t[s]", *axes, *(["temp[degC]"] if self.temperature_c is not None else [])]


def tables(
    events: Iterable[Event], report: ExportReport, rate_hz: float | None = None, unit: Unit = "lsb"
) -> Iterator[Table]:
    """Yield the samples of a decoded stream as rows; `report` is brought up to date.

    Parameters
    ----------
    events : iterable of StreamInfo, Block, Gap and Notice
        What a decoder says.
    report : ExportReport
        Counts rows and gaps.
    rate_hz : float, optional
        Measured sample rate; the nominal one if not given.
    unit : {'lsb', 'physical'}
        Counts as they are, or multiplied by their scale.

    Raises
    ------
    InputError
        If a later configuration has other axes or, in counts, other scales: one table cannot hold
        both. If the rate is unknown.
    """
    clock: _SampleClock | None = None
    info: StreamInfo | None = None
    temperature = np.nan
    with_temperature: bool | None = None
    for event in events:
        match event:
            case StreamInfo():
                _compatible(info, event, unit)
                info = event
                clock = _SampleClock(rate_hz or info.nominal_hz, clock)
            case Gap():
                report.gaps += 1
                report.unknown_gaps += event.lost is None
                if clock is not None and event.lost is None:
                    clock.skip()
            case Block() if info is not None and clock is not None and len(event):
                held = _held_temperature(event, temperature)
                if with_temperature is None:
                    with_temperature = bool(np.isfinite(held).any())
                temperature = float(held[-1])
                report.rows += len(event)
                yield Table(
                    info,
                    clock.times(event),
                    event.counts if unit == "lsb" else event.counts * np.asarray(info.scale),
                    held if with_temperature else None,
                )


def export_csv(
    events: Iterable[Event], out: Path, *, rate_hz: float | None = None, unit: Unit = "physical"
) -> ExportReport:
    """Write samples as delimited text that `allanscope analyse` reads back.

    Parameters
    ----------
    events : iterable of StreamInfo, Block, Gap and Notice
        What a decoder says.
    out : Path
        The file; it is replaced when everything has been written.
    rate_hz : float, optional
        Measured sample rate; the nominal one if not given.
    unit : {'physical', 'lsb'}
        dps and g, or counts: exact, but to be read with the right part and full scales.

    Raises
    ------
    InputError
        If one table cannot hold the stream; see `tables`.
    UsageError
        If the file cannot be written.
    """
    report = ExportReport(out)
    with atomic_write(out) as part, part.open("w", encoding="ascii", newline="\n") as file:
        for table in tables(events, report, rate_hz, unit):
            if report.rows == len(table.time_s):
                file.write(",".join(table.tokens(unit)) + "\n")
            file.write(_rows(table, unit))
    return report


class _SampleClock:
    """Times of samples over gaps and restarts: index over rate, plus what cannot be counted."""

    def __init__(self, rate_hz: float, before: _SampleClock | None) -> None:
        if not rate_hz > 0.0:
            raise InputError("nothing tells the sample rate; give it with --rate")
        self.rate_hz = rate_hz
        self._from: int | None = None
        self._start_s: float = 0.0 if before is None else before.next_s + 1.0 / rate_hz
        self.next_s: float = self._start_s

    def skip(self) -> None:
        """Leave out one sample."""
        self._start_s += 1.0 / self.rate_hz

    def times(self, block: Block) -> NDArray[np.float64]:
        if self._from is None:
            self._from = block.index
        index = block.index - self._from + np.arange(len(block))
        times: NDArray[np.float64] = self._start_s + index / self.rate_hz
        self.next_s = float(times[-1]) + 1.0 / self.rate_hz
        return times


def _held_temperature(block: Block, last: float) -> NDArray[np.float64]:
    """Temperature at each sample: the newest that was told, before the first one the first."""
    seen = np.isfinite(block.ticks.temperature_c)
    values, offsets = block.ticks.temperature_c[seen], block.ticks.offset[seen]
    if np.isnan(last) and len(values):
        last = float(values[0])
    bounds = np.concatenate([[0], offsets, [len(block)]])
    return np.repeat(np.concatenate([[last], values]), np.diff(bounds))


def _compatible(before: StreamInfo | None, after: StreamInfo, unit: Unit) -> None:
    if before is None:
        return
    if before.axes != after.axes:
        raise InputError(
            f"the axes change from {' '.join(before.axes)} to {' '.join(after.axes)} on the way; "
            "one table cannot hold both"
        )
    if unit == "lsb" and before.scale != after.scale:
        raise InputError("the scale changes on the way; export physical units instead of counts")


def _rows(table: Table, unit: Unit) -> str:
    """Format rows: nanoseconds, whole counts, and as many digits as a count can need."""
    whole = unit == "lsb" and np.issubdtype(table.values.dtype, np.integer)
    value = "%d" if whole else "%.9g"
    columns = [table.time_s, *table.values.T]
    formats = ["%.9f", *[value] * table.values.shape[1]]
    if table.temperature_c is not None:
        columns.append(table.temperature_c)
        formats.append("%.4f")
    line = ",".join(formats) + "\n"
    return "".join(line % row for row in zip(*(c.tolist() for c in columns), strict=True))


def export_parquet(
    events: Iterable[Event], out: Path, *, rate_hz: float | None = None, unit: Unit = "physical"
) -> ExportReport:
    """Write samples as a Parquet file.

    The columns are named as in the text export. The metadata key ``allanscope`` holds the axes,
    scales, rate, part and wire format as JSON.

    Parameters
    ----------
    events : iterable of StreamInfo, Block, Gap and Notice
        What a decoder says.
    out : Path
        The file; it is replaced when everything has been written.
    rate_hz : float, optional
        Measured sample rate; the nominal one if not given.
    unit : {'physical', 'lsb'}
        dps and g, or counts: smaller, exact, and their scale is in the metadata.

    Raises
    ------
    InputError
        If one table cannot hold the stream.
    UsageError
        If the file cannot be written, or pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise UsageError("Parquet needs pyarrow: pip install pyarrow") from error
    report = ExportReport(out)
    with atomic_write(out) as part, ExitStack() as opened:
        writer: Any = None
        for table in _batches(tables(events, report, rate_hz, unit)):
            rows = pa.table(_columns(table, unit), metadata=_facts(table, rate_hz))
            if writer is None:
                # Opened by us: Arrow takes no names that are not UTF-8.
                file = opened.enter_context(part.open("wb"))
                writer = pq.ParquetWriter(file, rows.schema, compression="zstd")
                opened.enter_context(writer)
            writer.write_table(rows.cast(writer.schema))
        if writer is None:
            raise UsageError("there are no samples to export")
    return report


def _batches(parts: Iterable[Table]) -> Iterator[Table]:
    """Join small tables, because every one that is written becomes a row group of its own."""
    waiting: list[Table] = []
    rows = 0
    for part in parts:
        if waiting and (waiting[0].info is not part.info or rows >= GROUP_ROWS):
            yield _joined(waiting)
            waiting, rows = [], 0
        waiting.append(part)
        rows += len(part.time_s)
    if waiting:
        yield _joined(waiting)


def _joined(parts: list[Table]) -> Table:
    temperatures = [part.temperature_c for part in parts if part.temperature_c is not None]
    return Table(
        parts[0].info,
        np.concatenate([part.time_s for part in parts]),
        np.concatenate([part.values for part in parts]),
        np.concatenate(temperatures) if temperatures else None,
    )


def _columns(table: Table, unit: Unit) -> dict[str, Any]:
    columns = [table.time_s, *table.values.T]
    if table.temperature_c is not None:
        columns.append(table.temperature_c)
    return dict(zip(table.tokens(unit), columns, strict=True))


def _facts(table: Table, rate_hz: float | None) -> dict[str, str]:
    info = table.info
    facts = {
        "axes": info.axes,
        "scale": info.scale,
        "rate_hz": rate_hz or info.nominal_hz,
        "measured": rate_hz is not None or not info.rate_claimed,
        "part": info.part,
        "wire": info.wire,
    }
    return {"allanscope": json.dumps(facts)}
