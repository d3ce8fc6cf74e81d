"""Parquet: columns called as in text, and the scales that our own export writes beside them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.errors import UsageError
from allanscope.pipeline.columns import columns_of_mapping, known_names
from allanscope.pipeline.table_files import MOST_BYTES, MOST_COLUMNS, TableFile
from allanscope.recording import most_unpacked
from allanscope.samples import AXES

__all__ = ["read"]


def read(path: Path, stream: str = "") -> TableFile:
    """Return the columns whose names are known."""
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
            known = known_names(
                [
                    one.name
                    for one in schema
                    if pa.types.is_integer(one.type) or pa.types.is_floating(one.type)
                ]
            )
            most = min(MOST_BYTES, most_unpacked(path.stat().st_size))
            if file.metadata.num_rows * max(len(known), 1) * 8 > most:
                raise ValueError(f"{file.metadata.num_rows} rows: too many for a file of its size")
            arrays = _columns_of_parquet(file, list(known), most)
            facts = _facts(schema.metadata)
    except pa.ArrowException as error:
        raise ValueError(f"not a valid Parquet file: {error}") from None
    columns = columns_of_mapping({known[name]: values for name, values in arrays.items()})
    scales = _numbers(facts.get("axes"), facts.get("scale"))
    rate = facts.get("rate_hz")
    return TableFile(
        replace(columns, scales={a: s for a, s in scales.items() if a in columns.axes}),
        "parquet",
        float(rate) if columns.time_s is None and isinstance(rate, int | float) else None,
        part if isinstance(part := facts.get("part"), str) else "",
    )


def _columns_of_parquet(file: Any, names: list[str], most: int) -> dict[str, NDArray[Any]]:
    """Return the columns, read a batch at a time: what rows there are, whatever is claimed."""
    parts: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
    held = 0
    for batch in file.iter_batches(columns=names):
        for name in names:
            part = batch.column(name).to_numpy(zero_copy_only=False)
            held += part.nbytes
            parts[name].append(part)
        if held > most:
            raise ValueError(f"more than {most >> 20} MiB of samples")
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
