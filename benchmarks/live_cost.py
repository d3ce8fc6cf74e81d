"""What a live run costs: processor, delays and losses at the highest rate over a virtual port.

    python benchmarks/live_cost.py [--seconds 60] [--rate 6660] [--json FILE] [--quick]

The delay is measured in a second run, of a third of this time, paced as with a viewer.

A simulated SensorTile in a process of its own streams six axes over a pseudo-terminal. This process
does what ``allanscope live --view none`` does: it reads, records, decodes, sums up, refreshes the
result, and looks for effects. Measured are its processor time per second of stream (the device is
another process and not in it; nor are the children that look for effects) and what its threads
have of it, its memory, how long the reader was kept from the port at most (by what this process did
meanwhile, and by the machine), and how long it took from the arrival of a byte until its sample was
handed to the charts, which draw ten times a second.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from figures import Figure, written

from allanscope.analysis import Analyser
from allanscope.pipeline import Decoding
from allanscope.pipeline.outputs import made_folder
from allanscope.pipeline.process import configure_malloc
from allanscope.pipeline.refreshing import IN_VIEWER, UNWATCHED, LoopProcess, RefreshPolicy
from allanscope.pipeline.session import Session
from allanscope.recording import Recorder
from allanscope.sources import open_source
from allanscope.view import RerunView, TerminalView, load_rerun
from allanscope.wire import WireSettings

WARM_S = 5.0
"""Until all code is loaded and the first result was shown."""

PAINTED_S = 0.1
"""Rows of the time series are drawn this often: see `allanscope.view.rerun_view`."""

BATCHED_S = 0.02
"""The reader lets bytes gather for so long on purpose: see `allanscope.sources.serial_port`."""


class Threads:
    """What each thread of this process has used, and how often it was woken; Linux only."""

    def __init__(self) -> None:
        self._tasks = Path("/proc/self/task")
        self._began_s = time.monotonic()
        self._first = self._now()

    def _now(self) -> dict[str, tuple[float, int]]:
        named = {str(one.native_id): one.name for one in threading.enumerate()}
        used = {}
        for task in self._tasks.iterdir() if self._tasks.exists() else ():
            with contextlib.suppress(OSError):  # it has just ended
                fields = (task / "schedstat").read_text().split()
                woken = (task / "status").read_text().partition("\nvoluntary_ctxt_switches:")[2]
                name = named.get(task.name) or (task / "comm").read_text().strip()
                used[f"{name} {task.name}"] = float(fields[0]) * 1e-9, int(woken.split()[0])
        return used

    def table(self) -> dict[str, dict[str, float]]:
        """Return per cent of a core, and voluntary waits in a second, of the busiest threads."""
        passed_s = time.monotonic() - self._began_s
        rows = {}
        for name, (cpu_s, woken) in self._now().items():
            cpu_0, woken_0 = self._first.get(name, (0.0, 0))
            percent, waits = 100.0 * (cpu_s - cpu_0) / passed_s, (woken - woken_0) / passed_s
            if percent > 0.05 or waits > 5.0:
                rows[name] = {"core_percent": round(percent, 2), "waits_per_s": round(waits, 1)}
        return dict(sorted(rows.items(), key=lambda row: -row[1]["core_percent"]))


class Watch:
    """A listener that looks at the clock."""

    def __init__(self) -> None:
        self.began_cpu_s = self.began_s = math.nan
        self.late_s: list[float] = []
        self.snapshots = 0
        self.table: dict[str, dict[str, float]] = {}
        self.memory_mb = math.nan

    def info(self, info: object) -> None:
        """Begin to wait until everything is warm."""
        self.heard_s = time.monotonic()

    def samples(self, info: object, block: Any) -> None:
        """Note how long ago the bytes of a block arrived."""
        now = time.monotonic()
        if math.isnan(self.began_s) and now - self.heard_s > WARM_S:
            self.began_cpu_s, self.began_s = time.process_time(), now
            self.threads = Threads()
        if not math.isnan(self.began_s) and len(block.ticks.host_s):
            self.late_s.append(now - float(block.ticks.host_s[0]))

    def snapshot(self, analysis: object) -> None:
        """Count results; look at the threads while they are there."""
        self.snapshots += 1
        if not math.isnan(self.began_s):
            self.table = self.threads.table()
            self.memory_mb = _resident_mb()

    def gap(self, gap: object) -> None:
        """Losses are counted by the link."""

    def notice(self, notice: object) -> None:
        """Nothing to measure."""


class Timed:
    """A source that notes how long the reader was away, and what this process did meanwhile."""

    def __init__(self, source: Any) -> None:
        self._source = source
        self._left = math.nan, math.nan
        self.away_s: list[tuple[float, float]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    def read(self) -> Any:
        """Read, and note when."""
        now = time.monotonic(), time.process_time()
        if not math.isnan(self._left[0]):
            self.away_s.append((now[0] - self._left[0], now[1] - self._left[1]))
        chunk = self._source.read()
        self._left = time.monotonic(), time.process_time()
        return chunk


def _resident_mb() -> float:
    """Return what the process holds at present; NaN where there is no /proc."""
    status = Path("/proc/self/status")
    text = status.read_text() if status.exists() else "VmRSS: nan"
    return float(text.partition("VmRSS:")[2].split()[0]) / 1024.0


def run(
    port: str, seconds: float, folder: Path, policy: RefreshPolicy = UNWATCHED
) -> dict[str, Any]:
    """Watch a port for some seconds and return what it cost."""
    configure_malloc()
    load_rerun()
    watch, source = Watch(), Timed(open_source(port))
    recorder = Recorder(folder, {"name": "benchmark"})
    decoding = Decoding(WireSettings(), write=source.write)
    whole_s = WARM_S + seconds
    session = Session(
        source, decoding, Analyser(), recorder=recorder, duration_s=whole_s, policy=policy
    )
    session.loop_process = LoopProcess(
        first_s=WARM_S + seconds / 2
    )  # one look falls into every run
    viewer = RerunView(folder, "none", {"name": "benchmark"}, lambda line, level="info": None)
    session.listeners = (watch, TerminalView("quiet"), viewer)
    viewer.start()
    session.run()
    spent_s, passed_s = time.process_time() - watch.began_cpu_s, time.monotonic() - watch.began_s
    recorder.close()
    looks = session.loop_process.searches
    viewer.close(None)
    stats = decoding.stats
    late_ms, away_ms = 1e3 * np.array(watch.late_s), 1e3 * np.array(source.away_s)
    return {
        "core_percent": 100.0 * spent_s / passed_s,
        "late_ms_median": float(np.median(late_ms)),
        "late_ms_99": float(np.percentile(late_ms, 99)),
        "late_ms_most": float(late_ms.max()),
        "reader_away_ms_99": float(np.percentile(away_ms[:, 0], 99)),
        "reader_away_ms_most": float(away_ms[:, 0].max()),
        "reader_kept_ms_most": float(away_ms[:, 1].max()),
        "samples": stats.samples,
        "lost_samples": stats.lost_samples,
        "snapshots": watch.snapshots,
        "looks": looks,
        "memory_mb": watch.memory_mb,
        "threads": watch.table,
    }


def main() -> None:
    """Start a device, watch it, print and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=6660.0)
    parser.add_argument("--quick", action="store_true", help="15 seconds")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results here too")
    options = parser.parse_args()
    seconds = 15.0 if options.quick else options.seconds
    command = [sys.executable, "-m", "allanscope", "device", "--rate", f"{options.rate:g}"]
    device = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert device.stdout is not None
    try:
        port = device.stdout.readline().strip()
        with tempfile.TemporaryDirectory() as folder:
            cost = run(port, seconds, made_folder(Path(folder) / "unseen"))
            viewed = made_folder(Path(folder) / "viewed")
            seen = run(port, seconds / 3.0, viewed, IN_VIEWER)
    finally:
        device.terminate()
        device.wait()
    to_chart_ms = seen["late_ms_99"] + 1e3 * (BATCHED_S + PAINTED_S)
    figures = [
        Figure("live, six axes", cost["core_percent"], "% of a core", goal=3.0),
        Figure("byte to chart, 99 of 100", to_chart_ms, "ms", goal=250.0),
        Figure("reader kept from the port by us, at most", cost["reader_kept_ms_most"], "ms", 40.0),
        Figure("reader away from the port, at most", cost["reader_away_ms_most"], "ms"),
        Figure("memory of the process at the end", cost["memory_mb"], "MB", goal=400.0),
        Figure("samples lost", cost["lost_samples"], "", goal=0.0),
    ]
    written(figures, options.json, rate_hz=options.rate, seconds=seconds, **cost)
    print(json.dumps(cost, indent=1))


if __name__ == "__main__":
    main()
