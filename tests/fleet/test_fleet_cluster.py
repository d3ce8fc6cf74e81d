"""An existing cluster: killed workers, rot among many files, results known under another name."""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from urllib.request import urlopen

import dask
import pytest
from distributed import Client, LocalCluster

from allanscope.errors import UsageError
from allanscope.fleet import FleetResult, FleetSettings, run_fleet
from allanscope.fleet.cluster import connected, dashboard_line, local_cluster
from allanscope.fleet.inputs import find_inputs
from allanscope.fleet.outcome import Outcome
from allanscope.fleet.run import TASKS_PER_WORKER
from allanscope.fleet.split import submit_split
from allanscope.fleet.worker_tasks import analyse_recording
from allanscope.pipeline import DeviceSettings

DEVICE = DeviceSettings()


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with local_cluster(2) as one:
        yield one


def test_a_worker_is_not_looked_at_fifty_times_a_second(cluster: LocalCluster) -> None:
    with Client(cluster.scheduler_address, set_as_default=False) as client:
        ticks = client.run(dask.config.get, "distributed.admin.tick.interval")
    assert len(ticks) == 2
    assert set(ticks.values()) == {"1s"}


def fleet(cluster: LocalCluster, out: Path, *patterns: object) -> FleetResult:
    settings = FleetSettings(tuple(map(str, patterns)), out, cluster.scheduler_address, quiet=True)
    return run_fleet(settings, DEVICE)


def test_a_killed_worker_costs_nothing(
    cluster: LocalCluster, board: Callable[..., Path], tmp_path: Path
) -> None:
    for number in range(4):
        board(tmp_path / "lot" / f"{number}.mcap", 20 + number)
    killed = threading.Event()

    def kill_a_busy_worker() -> None:
        with Client(cluster.scheduler_address, set_as_default=False) as client:
            while not (busy := [who for who, tasks in client.processing().items() if tasks]):
                time.sleep(0.01)
            pid = client.run(os.getpid, workers=busy[:1])[busy[0]]
            os.kill(pid, signal.SIGKILL)
            killed.set()

    killer = threading.Thread(target=kill_a_busy_worker)
    killer.start()
    result = fleet(cluster, tmp_path / "out", tmp_path / "lot")
    killer.join(timeout=60)
    assert killed.is_set()
    assert (result.done, result.failures, result.left) == (4, {}, 0)


def test_what_is_done_is_not_done_again(cluster: LocalCluster, lot: Path, tmp_path: Path) -> None:
    mine, out = tmp_path / "lot", tmp_path / "out"
    shutil.copytree(lot / "one", mine)
    assert fleet(cluster, out, f"file://{mine}/*.mcap").done == 2
    # Another name and another time of change, but the same content.
    shutil.copy(mine / "a.mcap", mine / "again.mcap")
    os.utime(mine / "b.mcap", (1, 1))
    again = fleet(cluster, out, mine)
    assert (again.done, len(again.keys)) == (0, 3)
    assert again.keys[str(mine / "again.mcap")] == again.keys[str(mine / "a.mcap")]


def test_one_rotten_file_among_fifty_is_named_and_the_rest_goes_on(
    cluster: LocalCluster, lot: Path, tmp_path: Path
) -> None:
    mine = tmp_path / "lot"
    for number in range(49):
        shutil.copytree(lot / "one", mine / f"unit-{number:02d}", ignore=lambda *_: ["b.mcap"])
    shutil.copy(lot / "two" / "bad.mcap", bad := mine / "unit-20" / "bad.mcap")
    result = fleet(cluster, tmp_path / "out", mine)
    assert result.failures == {str(bad): f"not a recording: {bad} is not an MCAP file"}
    assert (len(result.keys), result.left) == (49, 0)
    # Copies are known by their content: only those that were handed out before the first result.
    assert 1 <= result.done <= 2 * TASKS_PER_WORKER


def test_workers_clear_no_pages_for_every_array(cluster: LocalCluster) -> None:
    with Client(cluster.scheduler_address, set_as_default=False) as client:
        for environment in client.run(lambda: dict(os.environ)).values():
            assert "MALLOC_TRIM_THRESHOLD_" not in environment
            assert environment["OMP_NUM_THREADS"] == "1"


def test_a_recording_in_parts_is_the_recording(cluster: LocalCluster, lot: Path) -> None:
    [place] = find_inputs([str(lot / "one" / "a.mcap")])
    [bad] = find_inputs([str(lot / "two" / "bad.mcap")])
    with connected(cluster.scheduler_address, None) as client:
        outcome: Outcome = submit_split(client, place, DEVICE, 3).result()
        failed: Outcome = submit_split(client, bad, DEVICE, 2).result()
        whole: Outcome = client.submit(analyse_recording, place, DEVICE).result()
    assert outcome == whole
    assert failed.error == f"not a recording: {bad.url} is not an MCAP file"


def test_the_dashboard_answers_or_the_line_says_why_not(cluster: LocalCluster) -> None:
    with connected(cluster.scheduler_address, None) as client:
        line = dashboard_line(client)
    if find_spec("bokeh") is None:
        assert "pip install bokeh" in line
        return
    with urlopen(line.removeprefix("dashboard: "), timeout=60) as page:
        assert page.status == 200


def test_a_scheduler_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no Dask scheduler answers at nonsense"):
        connected("nonsense", None).__enter__()


HOG = """
import time

from allanscope.fleet import worker_tasks

plain = getattr(worker_tasks.Recording, "plain", worker_tasks.Recording)  # loaded twice


def recording(path):
    if path.name == "huge.mcap":
        hoard = [bytearray(1 << 24) for _ in range(100)]  # 1.7 GB, no more if nobody looks
        time.sleep(600 + len(hoard))
    return plain(path)


recording.plain = plain
worker_tasks.Recording = recording
"""


def test_a_recording_that_takes_more_memory_than_a_worker_may_is_named_and_the_rest_goes_on(
    board: Callable[..., Path], tmp_path: Path
) -> None:
    """The worker's nanny ends it at its limit, again and again; then the recording has failed.

    What waited for the same worker, and is blamed by Dask as well, is done all the same.
    """
    for seed, name in enumerate(("a", "huge", "z")):  # three contents: a copy is not done again
        board(tmp_path / "lot" / f"{name}.mcap", seed)
    (tmp_path / "hog.py").write_text(HOG)
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        local_cluster(1, memory_limit="1GB", preload=[str(tmp_path / "hog.py")]) as cluster,
    ):
        result = fleet(cluster, tmp_path / "out", tmp_path / "lot")
        with Client(cluster, set_as_default=False) as client:
            client.wait_for_workers(1)  # a cluster that is closed meanwhile may never end
    url = str(tmp_path / "lot" / "huge.mcap")
    assert result.failures == {
        url: f"{url}: its worker died repeatedly, perhaps for lack of memory"
    }
    assert (result.done, result.left) == (2, 0)
