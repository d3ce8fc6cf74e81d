"""The measured recordings, each analysed once by all tests of a process."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import allanscope
from allanscope import Analysis

MEASURED = Path(__file__).parents[2] / "recordings" / "measured"


@cache
def analysed(name: str) -> Analysis:
    """Return the analysis of a recording, which nobody may change."""
    return allanscope.analyse(MEASURED / f"{name}.parquet")
