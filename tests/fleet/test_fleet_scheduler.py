"""A scheduler of its own process, as on a cluster: it dies, and what the user sees of that."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from distributed import Client

from allanscope.__main__ import main
from allanscope.errors import ExitCode
from allanscope.fleet.inputs import RecordingInput
from allanscope.fleet.outcome import Outcome, result_key
from allanscope.fleet.store import Store
from allanscope.fleet.work_queue import WorkQueue
from allanscope.pipeline import DeviceSettings

COUNT = 6


@contextmanager
def dask(*arguments: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    call = [sys.executable, "-m", "dask", *arguments, "--host", "127.0.0.1", "--no-dashboard"]
    env = {**os.environ, **environment}
    with subprocess.Popen(call, stderr=subprocess.PIPE, text=True, env=env) as process:
        try:
            yield process
        finally:
            process.kill()


def address_of(scheduler: subprocess.Popen[str]) -> str:
    """Read what the scheduler says until it says where it listens."""
    assert scheduler.stderr is not None
    for line in scheduler.stderr:
        if found := re.search(r"Scheduler at:\s+(tcp://\S+)", line):
            threading.Thread(target=scheduler.stderr.read, daemon=True).start()
            return found[1]
    raise AssertionError("the scheduler ended")


def test_a_scheduler_that_dies_is_one_line_and_what_is_done_is_kept(
    board: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(COUNT):
        board(tmp_path / "lot" / f"{number}.mcap", 40 + number)
    out = tmp_path / "out"
    with dask("scheduler", "--port", "0") as scheduler:
        address = address_of(scheduler)
        with dask("worker", address, "--nthreads", "1", "--no-nanny"):

            def kill_it_after_the_first_result() -> None:
                deadline = time.monotonic() + 200.0
                while not list(out.glob("results/*/*.json.gz")) and time.monotonic() < deadline:
                    time.sleep(0.01)
                scheduler.kill()

            killer = threading.Thread(target=kill_it_after_the_first_result)
            killer.start()
            code = main(["fleet", f"{tmp_path}/lot", "--out", str(out), "--scheduler", address])
            killer.join()
    done = len(list(out.glob("results/*/*.json.gz")))
    assert (code, 1 <= done < COUNT) == (4, True)
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if line.startswith("allanscope")] == [
        f"allanscope: the Dask scheduler disconnected; {done} done, {COUNT - done} left: "
        "repeat the command to continue"
    ]
    assert pq.read_table(out / "lot.parquet").num_rows == 6 * done
    assert os.path.getsize(out / "lot.html") > 0


@contextmanager
def worker_of(version: str, address: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a worker where the metadata of allanscope say another version."""
    metadata = folder / f"allanscope-{version}.dist-info" / "METADATA"
    metadata.parent.mkdir(parents=True)
    metadata.write_text(f"Metadata-Version: 2.1\nName: allanscope\nVersion: {version}\n")
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    with dask("worker", address, "--nthreads", "1", "--no-nanny", PYTHONPATH=path) as process:
        threading.Thread(target=process.stderr.read, daemon=True).start()  # type: ignore[union-attr]
        yield process


def await_workers(address: str, count: int) -> None:
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=200)


def test_a_worker_of_another_version_is_refused(
    board: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(3):
        board(tmp_path / "lot" / f"{number}.mcap", 60 + number)
    out = tmp_path / "out"
    with dask("scheduler", "--port", "0") as scheduler:
        address = address_of(scheduler)
        call = ["fleet", f"{tmp_path}/lot", "--out", str(out), "--scheduler", address]
        with worker_of("9.9", address, tmp_path / "other"):
            await_workers(address, 1)
            assert main(call) == ExitCode.USAGE
            said = capsys.readouterr().err
            assert "has allanscope 9.9, this is" in said
            assert "no worker has allanscope" in said
            assert list(out.glob("results/*/*.json.gz")) == []
            with dask("worker", address, "--nthreads", "1", "--no-nanny"):
                await_workers(address, 2)
                assert main(call) == 0
    assert "it gets no recordings" in capsys.readouterr().err
    assert len(list(out.glob("results/*/*.json.gz"))) == 3


def test_a_result_of_another_version_is_not_kept(tmp_path: Path) -> None:
    place = RecordingInput("/lot/a.mcap", 100, "yesterday")
    store = Store(tmp_path, DeviceSettings())
    queue = WorkQueue(store, [place])
    queue.todo.clear()
    assert not queue.record(place, Outcome(place.url, "00", ("a.mcap",), b"result", version="9.9"))
    assert list(queue.todo) == [place]
    assert not store.has(result_key("00", DeviceSettings()))
    store.close()
