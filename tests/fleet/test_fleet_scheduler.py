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

from allanscope.__main__ import main

pytestmark = pytest.mark.timeout(300)
"""Processes are started, and a busy machine takes its time for that."""

COUNT = 6


@contextmanager
def dask(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    call = [sys.executable, "-m", "dask", *arguments, "--host", "127.0.0.1", "--no-dashboard"]
    with subprocess.Popen(call, stderr=subprocess.PIPE, text=True) as process:
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
    assert [line for line in said if "dashboard" not in line] == [
        f"allanscope: the Dask scheduler went away; {done} done, {COUNT - done} left: "
        "the same command goes on"
    ]
    assert pq.read_table(out / "lot.parquet").num_rows == 6 * done
    assert os.path.getsize(out / "lot.html") > 0
