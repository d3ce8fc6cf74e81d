"""What every reader of a file of arrays returns, and what none of them exceeds."""

from __future__ import annotations

from dataclasses import dataclass

from allanscope.pipeline.columns import Columns

__all__ = ["MOST_BYTES", "MOST_COLUMNS", "MOST_MEMBERS", "TableFile"]

MOST_BYTES = 1 << 31
"""Of arrays in memory: six axes as float64 over 11 h at 1 kHz."""
MOST_MEMBERS = 256
MOST_COLUMNS = 4096
"""More than this is no table of sensors."""


@dataclass(frozen=True, slots=True)
class TableFile:
    """What a file of arrays holds.

    Attributes
    ----------
    columns : Columns
        Its samples.
    kind : str
        What it is, by its name in the registry.
    rate_hz : float or None
        Rate that it states.
    part : str
        Part that it names.
    """

    columns: Columns
    kind: str
    rate_hz: float | None = None
    part: str = ""
