"""A night of faults in small: every kind of fault, held against the truth, with nothing growing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SOAK = Path(__file__).parents[2] / "benchmarks" / "soak.py"


def test_a_night_of_faults_in_small() -> None:
    """Lost is what is reported lost, sums are those of the undisturbed run, nothing grows."""
    command = [sys.executable, str(SOAK), "--hours", "0.08", "--faults", "10", "--seed", "5"]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=110, check=False)
    lines = ran.stdout.splitlines()
    assert ran.returncode == 0, ran.stdout + ran.stderr
    for expected in (
        "lost by the board's ledger",
        "gaps of unknown length",
        "reconnections",
        "memory grew by",
        "handles",
        "the undisturbed run on what survived",
        "a replay of the recording",
    ):
        assert any(line.startswith("ok") and expected in line for line in lines), expected
