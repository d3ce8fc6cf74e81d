"""Single runs in a process of their own, with one thread for algebra as a worker has.

Usage: single_runs.py TABLE RECORDING... (writes the table that a fleet of them should write)
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from allanscope.fleet.lot import rows_of, write_table
from allanscope.pipeline import DeviceSettings, analyse_input
from allanscope.recording import Recording


def rows(paths: list[str]) -> Iterator[dict[str, Any]]:
    for path in sorted(paths):
        known = Recording(Path(path)).metadata
        analysis = analyse_input(Path(path), DeviceSettings(), quiet=True)
        circumstances = {
            "started": known["started"],
            "serial_number": known["serial_number"],
            "firmware": "allanscope simulator",
            "damaged_places": 0,
        }
        result = {"analysis": analysis.to_dict(), "circumstances": circumstances}
        yield from rows_of(path, known["serial_number"], result)


if __name__ == "__main__":
    write_table(Path(sys.argv[1]), rows(sys.argv[2:]))
