"""What a fleet costs: speed-up, overhead of a task, memory, and the cost model of a large one.

    python benchmarks/fleet.py [--recordings 50] [--hours 0.02] [--night-hours 12]

Records simulated boards, then measures

* the wall time of all of them on one worker and on two, workers started and warm;
* what a task costs the client and the scheduler, with tasks that do nothing;
* what a result costs to keep and to put into table and report;
* peak memory of the workers, bytes of a recording and of a result;
* with --night-hours: CPU time and memory of one night at 104 Hz.

It prints the load of the machine before and after, because a speed-up means nothing on a busy one,
and beside the wall time the CPU time that the workers had: where wall time on one worker is much
more than its CPU time, others were in the way.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from distributed import Client, LocalCluster

from allanscope.fleet import FleetResult, FleetSettings, run_fleet
from allanscope.fleet.places import find_places
from allanscope.fleet.work import analyse_place
from allanscope.pipeline.settings import DeviceSettings, SimulatedSettings
from allanscope.pipeline.simulate import simulate_recording

DEVICE = DeviceSettings(rate_hz=104.0)
ASKED = DeviceSettings()
NOTHINGS = 2000


def nothing(number: int) -> int:
    """Do nothing: what is left is overhead."""
    return number


def usage() -> tuple[float, float]:
    """Return CPU seconds and peak memory in MB of this process."""
    return time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def load() -> str:
    """Return the load of the machine."""
    return f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


def record(folder: Path, count: int, hours: float) -> Path:
    """Record boards, each with its own seed; return one more, to warm up with."""
    for seed in range(count + 1):
        where = folder / ("warm" if seed == count else "lot") / f"{seed:03d}.mcap"
        where.parent.mkdir(exist_ok=True)
        simulate_recording(where, hours, DEVICE, SimulatedSettings(seed=seed), quiet=True)
    return folder / "warm" / f"{count:03d}.mcap"


def cluster_of(workers: int) -> Any:
    """Return a cluster like that of the command."""
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        silence_logs=50,
    )


def fleet(folder: Path, out: Path, address: str) -> tuple[float, FleetResult]:
    """Run the fleet once; return wall seconds and how it ended."""
    began = time.perf_counter()
    settings = FleetSettings((str(folder / "lot"),), out, address, quiet=True)
    result = run_fleet(settings, ASKED)
    return time.perf_counter() - began, result


def speed(folder: Path, workers: int, warm: Path, out: Path) -> float:
    """Print and return the wall seconds of all recordings on so many workers."""
    with cluster_of(workers) as cluster, Client(cluster, set_as_default=False) as client:
        [place] = find_places([str(warm)])
        client.run(analyse_place, place, ASKED)
        before = client.run(usage)
        wall_s, result = fleet(folder, out, cluster.scheduler_address)
        after = client.run(usage)
    assert not result.failures, result.failures
    cpu_s = sum(after[who][0] - before[who][0] for who in after)
    peak = max(memory for _, memory in after.values())
    print(
        f"{workers} worker(s): {wall_s:.1f} s for {result.done} recordings, "
        f"{cpu_s:.1f} s CPU in the workers, peak {peak:.0f} MB a worker; {load()}"
    )
    return wall_s


def after_work(folder: Path, out: Path) -> None:
    """Print what a run costs in which everything is done: looking, table and report."""
    with cluster_of(1) as cluster:
        wall_s, result = fleet(folder, out, cluster.scheduler_address)
    kept = list(out.glob("results/*/*.json.gz"))
    size = sum(path.stat().st_size for path in kept) / len(kept)
    read = sum(path.stat().st_size for path in (folder / "lot").iterdir()) / len(kept)
    table = (out / "lot.parquet").stat().st_size / len(kept)
    print(
        f"everything known: {wall_s:.2f} s for {len(result.keys)}, table and report included; "
        f"bytes a recording {read:.0f}, a result {size:.0f}, in the table {table:.0f}"
    )


def overhead() -> None:
    """Print what a task costs whoever holds scheduler and client, in CPU and wall time."""
    with cluster_of(2) as cluster, Client(cluster, set_as_default=False) as client:
        client.gather(client.map(nothing, range(100), pure=False))
        began, cpu = time.perf_counter(), time.process_time()
        client.gather(client.map(nothing, range(NOTHINGS), pure=False))
        wall_s, cpu_s = time.perf_counter() - began, time.process_time() - cpu
    print(
        f"a task that does nothing: {1e3 * wall_s / NOTHINGS:.2f} ms wall, "
        f"{1e3 * cpu_s / NOTHINGS:.2f} ms CPU of scheduler and client; {load()}"
    )


def night(folder: Path, hours: float) -> None:
    """Print the CPU time and memory of one night in a process of its own."""
    path = folder / "night.mcap"
    simulate_recording(path, hours, DEVICE, SimulatedSettings(seed=7), quiet=True)
    with cluster_of(1) as cluster, Client(cluster, set_as_default=False) as client:
        [place] = find_places([str(path)])
        client.run(nothing, 0)
        before = client.run(usage)
        outcome = client.submit(analyse_place, place, ASKED).result()
        after = client.run(usage)
    [who] = after
    print(
        f"a night of {hours:g} h at 104 Hz: {after[who][0] - before[who][0]:.1f} s CPU, "
        f"peak {after[who][1]:.0f} MB, {path.stat().st_size / 1e6:.1f} MB read, "
        f"{len(outcome.result) / 1e3:.0f} kB result {outcome.error}; {load()}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=50)
    parser.add_argument("--hours", type=float, default=0.02)
    parser.add_argument("--night-hours", type=float, default=0.0)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="fleet-"))
    try:
        print(load())
        if options.recordings:
            warm = record(folder, options.recordings, options.hours)
            one = speed(folder, 1, warm, folder / "one")
            two = speed(folder, 2, warm, folder / "two")
            print(f"speed-up on two workers: {one / two:.2f}")
            after_work(folder, folder / "two")
            overhead()
        if options.night_hours:
            night(folder, options.night_hours)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
