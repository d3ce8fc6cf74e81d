"""A record of which some rows are missing, as a run keeps it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.history import Record

RATE = 100.0
AXES = ("gx", "gy", "gz", "ax", "ay", "az")


def thinned(
    values: NDArray[np.float64], kept: NDArray[np.bool_] | None = None, lsb: float = 1e-9
) -> Record:
    """Return the rows of a table that are kept, each stretch of them a segment."""
    rows = np.arange(len(values)) if kept is None else np.flatnonzero(kept)
    first = np.flatnonzero(np.diff(rows, prepend=-2) > 1)
    columns = values.shape[1]
    return Record(
        rate_hz=RATE,
        stride=1,
        axes=AXES[:columns],
        values=values[rows],
        lsb=(lsb,) * columns,
        temperature_c=np.full(len(rows), np.nan),
        start_s=rows / RATE,
        segments=np.column_stack([first, np.append(first[1:], len(rows))]),
    )
