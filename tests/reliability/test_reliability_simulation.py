"""Any output may fail: what is left adds up, and what is missing is said.

`benchmarks/fault_simulation.py` runs as many seeds as one likes.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from allanscope.analysis import Analyser
from allanscope.pipeline.refreshing import LoopProcess
from allanscope.simulator import Simulator
from allanscope.view import TerminalView
from support.fault_invariants import simulate, violations
from support.fault_simulation import Plan, run

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/fd").exists(), reason="which file a call is about is read from /proc"
)

SEEDS = 120


@pytest.mark.parametrize("first", range(0, SEEDS, 12))
def test_whatever_fails_what_is_left_adds_up_and_the_rest_is_said(
    first: int, tmp_path: Path
) -> None:
    found = {seed: simulate(seed, tmp_path) for seed in range(first, first + 12)}
    assert {seed: wrong for seed, wrong in found.items() if wrong} == {}


ALWAYS = (0.0, 9.0, "error")
LATE = (0.5, 9.0, "error")


@pytest.mark.parametrize(
    ("failing", "code", "said"),
    [
        ({}, 0, ""),
        ({"refresh": ALWAYS}, 6, "a result during the run failed: MemoryError"),
        ({"view": LATE}, 6, "a view failed and was closed: RuntimeError"),
        ({"report": ALWAYS}, 6, "report.html is lost: a picture that cannot be drawn"),
        ({"file": ALWAYS}, 6, "result.json is in "),
        ({"file": ALWAYS, "spare": ALWAYS}, 6, "result.json is lost"),
        ({"write": LATE}, 6, "bytes were not recorded"),
        ({"terminal": ALWAYS, "stderr": ALWAYS}, 0, ""),
        ({"write": LATE, "stderr": ALWAYS}, 6, ""),
    ],
)
def test_the_exit_code_and_a_line_say_what_failed(
    tmp_path: Path, failing: dict[str, tuple[float, float, str]], code: int, said: str
) -> None:
    ran = run(Plan(1, dict(failing)), tmp_path)
    assert violations(ran) == []
    assert (ran.code, said in ran.err) == (code, True)
    assert ran.analysis is not None
    assert said in " ".join(ran.analysis.failures)
    assert ran.analysis.samples > 1000


def test_a_search_that_cannot_be_started_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = Simulator(rate=104.0, seed=1)
    analyser = Analyser()
    analyser.feed(sensor.info)
    analyser.feed(sensor.read(104 * 70))
    said: list[str] = []
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    loop = LoopProcess(first_s=60.0, fail=said.append)
    loop.offer(analyser.frozen())
    assert loop._thread is not None
    loop._thread.join(60.0)
    assert len(said) == 1
    assert said[0].startswith("the search for effects during the run failed: FileNotFoundError")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_output_that_the_disk_does_not_take_is_one_line_and_no_success() -> None:
    command = [sys.executable, "-m", "allanscope", "ports"]
    with open("/dev/full", "w") as full:
        ran = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ran.returncode == 1
    assert ran.stderr.count("\n") == 1
    assert os.strerror(28) in ran.stderr


def test_the_times_of_lines_never_run_backwards() -> None:
    """The first result knows less of the run than the clock: it is some reads old."""
    out, now = io.StringIO(), [10.0]
    view = TerminalView("plain", stream=out, clock=lambda: now[0])
    for at in (15.0, 13.0, 16.0):
        now[0] = at
        view.line("a line")
    assert [line.split()[0] for line in out.getvalue().splitlines()] == ["5.0", "5.0", "6.0"]


def test_seeds_that_once_failed(tmp_path: Path) -> None:
    assert {seed: simulate(seed, tmp_path) for seed in (154, 160, 213, 249)} == {
        154: [], 160: [], 213: [], 249: [],
    }  # fmt: skip
