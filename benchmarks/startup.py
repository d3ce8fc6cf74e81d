"""How long it takes to begin: the help, the first curve, and the first run ever on a machine.

    python benchmarks/startup.py [--json FILE] [--quick]

Wall time of whole processes, the least of several, and processor time beside it, which tells how
much of the wall time was waiting for a busy machine; ``live sim`` is stopped when a first curve is
handed to the listeners. In the first run ever Python finds no bytecode of any package, as after an
installation without it, and compiles all of it.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from figures import Figure, written

FIRST_CURVE = """
import os, sys
from allanscope.__main__ import main
from allanscope.view import TerminalView
def snapshot(self, analysis):
    if any(axis.curves for axis in analysis.axes.values()):
        os._exit(0)
TerminalView.snapshot = snapshot
sys.exit(main(["live", "sim", "--view", "none", "--out", sys.argv[1], "--for", "60s"]) or 1)
"""
"""`live` as the command line runs it, ended at the first result that has a curve."""


Times = tuple[float, float]


def seconds(command: list[str], cache: Path | None = None) -> Times:
    """Return wall and processor time of a process."""
    env = dict(os.environ, **({"PYTHONPYCACHEPREFIX": str(cache)} if cache else {}))
    began, before = time.monotonic(), _children_s()
    subprocess.run(command, env=env, capture_output=True, check=True)
    return time.monotonic() - began, _children_s() - before


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def first_curve(cache: Path | None = None) -> Times:
    """Return how long ``live sim`` takes to its first curve."""
    with tempfile.TemporaryDirectory() as folder:
        return seconds([sys.executable, "-c", FIRST_CURVE, f"{folder}/session"], cache)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results here too")
    options = parser.parse_args()
    times = 2 if options.quick else 5
    python = min(seconds([sys.executable, "-c", "pass"]) for _ in range(times))
    shown = min(seconds([sys.executable, "-m", "allanscope", "--help"]) for _ in range(times))
    with tempfile.TemporaryDirectory() as cache:
        cold = first_curve(Path(cache))
        again = first_curve(Path(cache))
    warm = min(again, *(first_curve() for _ in range(times - 1)))
    figures = [
        Figure("--help", shown[0], "s", goal=0.3, peer=python[0], peer_name="bare python"),
        Figure("live to first curve", warm[0], "s", goal=5.0),
        Figure("live to first curve, processor time", warm[1], "s"),
        Figure("live to first curve, first run ever", cold[0], "s", goal=5.0),
        Figure("first run ever, processor time", cold[1], "s"),
    ]
    written(figures, options.json)


if __name__ == "__main__":
    main()
