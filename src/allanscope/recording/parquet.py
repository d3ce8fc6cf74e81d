"""Export of samples as Parquet, for those who go on in pandas, polars or DuckDB."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from allanscope.errors import UsageError
from allanscope.recording.export import ExportReport, Table, Unit, tables
from allanscope.samples import Event
from allanscope.whole_file import written_whole

__all__ = ["export_parquet"]

GROUP_ROWS = 1 << 17


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
    with written_whole(out) as part, ExitStack() as opened:
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
