"""What a fleet costs: speed-up, overhead of a task, memory, and the cost model of a large one.

    python benchmarks/fleet.py [--recordings 50] [--hours 0.015] [--night-hours 12] [--quick]
    python benchmarks/fleet.py --recordings 0 --lot 10000

Records simulated boards and a file that is no recording, then measures

* the wall time of all of them, table and report included, on one worker that is held to one core,
  and on two; everything is started and has analysed one recording before the clock starts;
* what a task costs the client and the scheduler, with tasks that do nothing;
* what a run costs in which everything is known: looking, table and report;
* peak memory of the workers, bytes of a recording and of a result;
* with --lot: table and report of so many recordings, made up from one result;
* with --night-hours: CPU time and memory of one night at 104 Hz.

A speed-up means nothing on a busy machine. So the CPU time that the workers had stands beside the
wall time: where that is much more on one worker, others were in the way.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client
from figures import Figure, written

from allanscope.fleet import FleetResult, FleetSettings, run_fleet
from allanscope.fleet.cluster import local_cluster
from allanscope.fleet.inputs import find_inputs
from allanscope.fleet.lot import Lot, rows_of, write_table
from allanscope.fleet.outcome import result_of_bytes
from allanscope.fleet.page import render_lot
from allanscope.fleet.worker_tasks import analyse_recording
from allanscope.pipeline import DeviceSettings, SimulatedSettings, simulate_recording

DEVICE = DeviceSettings(rate_hz=104.0)
ASKED = DeviceSettings()
NOTHINGS = 2000
FEW = 500
"""Recordings with which the memory of a large lot is compared."""
SPEED_UP = 1.8


@dataclass(frozen=True)
class Speed:
    """What all recordings cost on so many workers: seconds, and MB of one worker."""

    start_s: float
    wall_s: float
    cpu_s: float
    peak_mb: float


def nothing(number: int) -> int:
    """Do nothing: what is left is overhead."""
    return number


def usage() -> tuple[float, float]:
    """Return CPU seconds and peak memory in MB of this process."""
    return time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def hold_to_one_core() -> None:
    """Let this process use one core, whatever its libraries start threads for."""
    os.sched_setaffinity(0, {0})


def record(folder: Path, count: int, hours: float) -> Path:
    """Record boards, each with its own seed, and rot; return one more, to warm up with."""
    for seed in range(count + 1):
        where = folder / ("warm" if seed == count else "lot") / f"{seed:03d}.mcap"
        where.parent.mkdir(exist_ok=True)
        simulate_recording(where, hours, DEVICE, SimulatedSettings(seed=seed), quiet=True)
    (folder / "lot" / "rotten.mcap").write_bytes(b"this is no recording" * 1000)
    return folder / "warm" / f"{count:03d}.mcap"


def fleet(recordings: Path, out: Path, address: str) -> tuple[float, FleetResult]:
    """Run the fleet once; return wall seconds and how it ended."""
    began = time.perf_counter()
    settings = FleetSettings((str(recordings),), out, address, quiet=True)
    result = run_fleet(settings, ASKED)
    return time.perf_counter() - began, result


def speed(folder: Path, workers: int, warm: Path, out: Path) -> Speed:
    """Return what all recordings cost on so many workers; say it, too."""
    began = time.perf_counter()
    with local_cluster(workers) as cluster, Client(cluster, set_as_default=False) as client:
        start_s = time.perf_counter() - began
        if workers == 1:
            client.run(hold_to_one_core)
        [place] = find_inputs([str(warm)])
        client.run(analyse_recording, place, ASKED)
        fleet(warm, out.with_name("warmed"), cluster.scheduler_address)
        before = client.run(usage)
        wall_s, result = fleet(folder / "lot", out, cluster.scheduler_address)
        after = client.run(usage)
    assert [Path(url).name for url in result.failures] == ["rotten.mcap"], result.failures
    cpu_s = sum(after[who][0] - before[who][0] for who in after)
    peak_mb = max(memory for _, memory in after.values())
    print(
        f"{workers} worker(s): started in {start_s:.1f} s; {wall_s:.1f} s for {result.done} "
        f"recordings, {cpu_s:.1f} s CPU in the workers, peak {peak_mb:.0f} MB a worker",
        flush=True,
    )
    return Speed(start_s, wall_s, cpu_s, peak_mb)


def after_work(folder: Path, out: Path) -> list[Figure]:
    """Return what a run costs in which everything is done: looking, table and report."""
    with local_cluster(1) as cluster:
        wall_s, result = fleet(folder / "lot", out, cluster.scheduler_address)
    kept = list(out.glob("results/*/*.json.gz"))
    size = sum(path.stat().st_size for path in kept) / len(kept)
    read = sum(path.stat().st_size for path in (folder / "lot").iterdir()) / len(kept)
    table = (out / "lot.parquet").stat().st_size / len(kept)
    return [
        Figure(f"everything known, {len(result.keys)} recordings: table and report", wall_s, "s"),
        Figure("bytes of a recording", read / 1e3, "kB"),
        Figure("bytes of a result", size / 1e3, "kB"),
        Figure("bytes of a recording in the table", table / 1e3, "kB"),
    ]


def overhead() -> list[Figure]:
    """Return what a task costs whoever holds scheduler and client, in CPU and wall time."""
    with local_cluster(2) as cluster, Client(cluster, set_as_default=False) as client:
        client.gather(client.map(nothing, range(100), pure=False))
        began, cpu = time.perf_counter(), time.process_time()
        client.gather(client.map(nothing, range(NOTHINGS), pure=False))
        wall_s, cpu_s = time.perf_counter() - began, time.process_time() - cpu
    return [
        Figure("a task that does nothing, wall", 1e3 * wall_s / NOTHINGS, "ms"),
        Figure("its CPU time in scheduler and client", 1e3 * cpu_s / NOTHINGS, "ms"),
    ]


def night(folder: Path, hours: float) -> list[Figure]:
    """Return the CPU time and memory of one night in a process of its own."""
    path = folder / "night.mcap"
    simulate_recording(path, hours, DEVICE, SimulatedSettings(seed=7), quiet=True)
    with local_cluster(1) as cluster, Client(cluster, set_as_default=False) as client:
        [place] = find_inputs([str(path)])
        before = client.run(usage)
        outcome: Any = client.submit(analyse_recording, place, ASKED).result()
        after = client.run(usage)
    assert not outcome.error, outcome.error
    [who] = after
    return [
        Figure(f"{hours:g} h at 104 Hz, CPU", after[who][0] - before[who][0], "s"),
        Figure("peak memory of its worker", after[who][1], "MB"),
        Figure("its recording", path.stat().st_size / 1e6, "MB"),
        Figure("its result", len(outcome.result) / 1e3, "kB"),
    ]


def made_up_lot(folder: Path, count: int) -> list[Figure]:
    """Return what table and report cost of one result repeated, with N, B and K scattered."""
    path = folder / "one.mcap"
    simulate_recording(path, 0.05, DEVICE, SimulatedSettings(seed=1), quiet=True)
    [place] = find_inputs([str(path)])
    kept = result_of_bytes(analyse_recording(place, ASKED).result)
    rng = np.random.default_rng(1)

    def rows(many: int) -> Iterator[dict[str, Any]]:
        for number in range(many):
            for row in rows_of(f"/lot/{number:06d}.mcap", f"unit-{number // 2:06d}", kept):
                factor = float(np.exp(0.1 * rng.standard_normal()))
                names = [f"{name}_{part}" for name in "NBK" for part in ("value", "lower", "upper")]
                yield row | {name: row[name] and row[name] * factor for name in names}

    table = folder / "made-up.parquet"
    _table_and_report(table, rows(FEW))  # loads what is needed
    before_mb = usage()[1]
    written_s, report_s, page, pages = _table_and_report(table, rows(count))
    more_kb = 1e3 * (usage()[1] - before_mb) / (count - FEW)
    return [
        Figure(f"table of {count} recordings, CPU", written_s, "s"),
        Figure("its size", table.stat().st_size / 1e6, "MB"),
        Figure(f"report and {pages[0]} pages of units, CPU", report_s, "s", goal=60.0),
        Figure("size of the report", page / 1e6, "MB", goal=5.0),
        Figure("of the pages of units", pages[1] / 1e6, "MB"),
        Figure(f"peak memory with {FEW} recordings", before_mb, "MB"),
        Figure("more for each recording beyond", more_kb, "kB"),
    ]


def _table_and_report(
    table: Path, rows: Iterator[dict[str, Any]]
) -> tuple[float, float, int, tuple[int, int]]:
    """Return CPU seconds of both, bytes of the report, number and bytes of the pages of units."""
    began = time.process_time()
    write_table(table, rows)
    written_s, began = time.process_time() - began, time.process_time()
    sizes: list[int] = []
    page = render_lot(Lot.read(table), {}, put_page=lambda _, text: sizes.append(len(text)))
    return written_s, time.process_time() - began, len(page), (len(sizes), sum(sizes))


def speeds(folder: Path, count: int, hours: float) -> list[Figure]:
    """Return what one worker and two make of the recordings."""
    warm = record(folder, count, hours)
    one = speed(folder, 1, warm, folder / "one")
    two = speed(folder, 2, warm, folder / "two")
    return [
        Figure(
            f"speed-up on two workers, {count} recordings",
            one.wall_s / two.wall_s,
            "",
            goal=SPEED_UP,
            bound=2.0,
            more=True,
        ),
        Figure("one worker, wall", one.wall_s, "s", bound=one.cpu_s),
        Figure("two workers, wall", two.wall_s, "s", bound=two.cpu_s / 2.0),
        Figure("a recording, CPU of its worker", one.cpu_s / count, "s"),
        Figure("start of two workers, not counted", two.start_s, "s"),
        Figure("peak memory of a worker", two.peak_mb, "MB"),
    ]


def main() -> None:
    """Measure from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--recordings", type=int, default=50)
    parser.add_argument("--hours", type=float, default=0.015)
    parser.add_argument("--lot", type=int, default=0, help="recordings of a made-up lot")
    parser.add_argument("--night-hours", type=float, default=0.0)
    parser.add_argument("--quick", action="store_true", help="few and short recordings")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    if options.quick:
        options.recordings, options.hours = 6, 0.002
    folder = Path(tempfile.mkdtemp(prefix="fleet-"))
    figures = []
    try:
        if options.recordings:
            figures += speeds(folder, options.recordings, options.hours)
            figures += after_work(folder, folder / "two")
            figures += overhead()
        if options.lot:
            figures += made_up_lot(folder, options.lot)
        if options.night_hours:
            figures += night(folder, options.night_hours)
    finally:
        shutil.rmtree(folder)
    written(figures, options.json)


if __name__ == "__main__":
    main()
