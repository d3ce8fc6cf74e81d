"""The command as a user runs it: two workers, a bad file, Ctrl-C, and going on."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from allanscope.errors import ExitCode
from allanscope.recording import Recording, write_recording

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

COUNT = 6


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "allanscope", "fleet", *map(str, arguments)]


@pytest.fixture(scope="module")
def run(
    lot: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """Return the folder of results of a fleet of two workers, and how the command ended."""
    out = tmp_path_factory.mktemp("result")
    call = command(f"{lot}/**/*.mcap", "--out", out, "--workers", 2)
    return out, subprocess.run(call, capture_output=True, text=True, timeout=200, check=False)


def test_a_bad_file_is_one_line_and_the_rest_goes_on(
    lot: Path, run: tuple[Path, subprocess.CompletedProcess[str]]
) -> None:
    out, ended = run
    assert ended.returncode == 3
    bad = lot / "two" / "bad.mcap"
    assert f"allanscope: not a recording: {bad} is not an MCAP file" in ended.stderr.splitlines()
    assert "dashboard" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert ended.stdout.splitlines() == [
        "3 recordings analysed; 1 failed",
        str(out / "lot.parquet"),
        str(out / "lot.html"),
    ]
    assert str(bad) in (out / "lot.html").read_text()


def test_the_table_is_that_of_single_runs_byte_for_byte(
    lot: Path, run: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    good = [str(path) for path in lot.glob("**/?.mcap")]
    table = tmp_path / "single.parquet"
    script = Path(__file__).with_name("single_runs.py")
    call = [sys.executable, str(script), str(table), *good]
    subprocess.run(call, env={**os.environ, **ONE_THREAD}, check=True, timeout=200)
    fleet = run[0] / "lot.parquet"
    assert str(pq.read_table(fleet).to_pylist()) == str(pq.read_table(table).to_pylist())  # NaN
    assert fleet.read_bytes() == table.read_bytes()
    assert pq.read_table(fleet).num_rows == 18
    assert set(pq.read_table(fleet).column("unit").to_pylist()) == {"0001", "0002"}


def test_ctrl_c_ends_in_order_and_the_same_command_goes_on(
    board: Callable[..., Path], tmp_path: Path
) -> None:
    lot, out = tmp_path / "lot", tmp_path / "out"
    for number in range(COUNT):
        board(lot / f"{number}.mcap", number)
    call = command(lot, "--out", out, "--workers", 1)
    process = subprocess.Popen(
        call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    deadline = time.monotonic() + 200.0
    while not list(out.glob("results/*/*.json.gz")) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    said, complained = process.communicate(timeout=200)
    assert process.returncode == ExitCode.STOPPED, complained
    assert "left: repeat the command to continue" in said
    assert "allanscope: stopped before it was done" in complained
    assert "Traceback" not in complained
    done = {path: path.stat().st_mtime_ns for path in out.glob("results/*/*.json.gz")}
    assert 1 <= len(done) < COUNT
    assert pq.read_table(out / "lot.parquet").num_rows == 6 * len(done)
    again = subprocess.run(call, capture_output=True, text=True, timeout=200, check=False)
    assert again.returncode == 0, again.stderr
    assert f"{COUNT} recordings analysed, {len(done)} of them before" in again.stdout
    assert {path: path.stat().st_mtime_ns for path in done} == done


def test_copies_and_lost_samples_are_named(lot: Path, tmp_path: Path) -> None:
    """One recording under three names, and one of which half of the reads are missing."""
    mine, out = tmp_path / "lot", tmp_path / "out"
    for unit in ("one", "two", "three"):
        (mine / unit).mkdir(parents=True)
        shutil.copy(lot / "one" / "a.mcap", mine / unit / f"{unit}.mcap")
    whole = Recording(lot / "two" / "a.mcap")
    kept = [chunk for number, chunk in enumerate(whole.chunks()) if number < 6 or number % 4 < 2]
    half = write_recording(mine / "half.mcap", kept, whole.metadata)
    call = command(mine, "--out", out, "--workers", 1)
    ended = subprocess.run(call, capture_output=True, text=True, timeout=200, check=False)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith("4 recordings analysed, ")
    assert "2 of them copies; 1 incomplete" in ended.stdout
    first, *others = (str(mine / unit / f"{unit}.mcap") for unit in ("one", "three", "two"))
    for one in others:
        assert f"allanscope: {one} is a copy of {first}: left out of the lot" in ended.stderr
        assert one in (out / "lot.html").read_text()
    [lost] = [line for line in ended.stderr.splitlines() if str(half) in line]
    assert re.search(r"samples lost \((4|5)\d %\)", lost), lost
    table = pq.read_table(out / "lot.parquet")
    assert set(table.column("recording").to_pylist()) == {first, str(half)}
    assert "lost samples" in (out / "lot.html").read_text()
