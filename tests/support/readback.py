"""Reads a recording of the viewer back: what was logged to which entity, and when."""

from __future__ import annotations

import warnings
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["Row", "read_back"]


@dataclass(frozen=True)
class Row:
    """One row of one entity: time since the start (None when static), and its components."""

    elapsed_s: float | None
    values: dict[str, Any]
    clock_s: float | None = None

    def strips(self) -> list[np.ndarray]:
        """Line strips as arrays of world positions."""
        return [np.array(strip) for strip in self.values["LineStrips2D:strips"]]

    def dots(self) -> np.ndarray:
        """Positions of the points."""
        return np.array(self.values["Points2D:positions"])


def read_back(path: Path) -> dict[str, list[Row]]:
    """Return all rows of a recording by entity, in the order of time."""
    from rerun.chunk import RrdReader

    rows: dict[str, list[Row]] = defaultdict(list)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file without a footer is what a crash leaves
        chunks = RrdReader(str(path)).stream()
        for chunk in chunks:
            batch = chunk.to_record_batch()
            columns = {
                name: batch.column(name).to_pylist() for name in batch.schema.names if ":" in name
            }
            times, clock = (_seconds(batch, name) for name in ("elapsed", "clock"))
            for i in range(batch.num_rows):
                known = {k: v[i] for k, v in columns.items() if v[i] is not None}
                rows[chunk.entity_path].append(Row(times[i], known, clock[i]))
    for of_entity in rows.values():
        of_entity.sort(key=lambda row: -1.0 if row.elapsed_s is None else row.elapsed_s)
    return dict(rows)


def _seconds(batch: Any, timeline: str) -> list[float | None]:
    """Return the times of a chunk on one timeline; static data have none."""
    if timeline not in batch.schema.names:
        return [None] * batch.num_rows
    return [float(ns) / 1e9 for ns in batch.column(timeline).cast("int64").to_pylist()]
