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

from allanscope.__main__ import main
from allanscope.errors import ExitCode
from allanscope.recording import Recording, write_recording

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

COUNT = 4


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


@pytest.fixture(scope="module")
def whole(
    board: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """Return a lot of several units, and the folder of its results; nobody writes to them."""
    lot, out = tmp_path_factory.mktemp("units"), tmp_path_factory.mktemp("whole")
    for number in range(COUNT):
        board(lot / f"{number}.mcap", 70 + number)
    call = command(lot, "--out", out, "--workers", 1)
    subprocess.run(call, capture_output=True, timeout=200, check=True)
    return lot, out


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
        f"Saved: {out / 'lot.parquet'}",
        f"Saved: {out / 'lot.html'}",
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
    whole: tuple[Path, Path], tmp_path: Path
) -> None:
    lot, out = whole[0], tmp_path / "out"
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
    assert f"{COUNT} recordings analysed, {len(done)} of them earlier" in again.stdout
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


def results(out: Path) -> list[Path]:
    return sorted(out.glob("results/*/*.json.gz"))


def test_a_client_that_is_killed_leaves_no_orphan_and_goes_on(
    whole: tuple[Path, Path], tmp_path: Path
) -> None:
    """Killed with -9: what it had stored is not done again, and the lot is that of one run."""
    (lot, once), out = whole, tmp_path / "out"
    call = command(lot, "--out", out, "--workers", 1)
    with subprocess.Popen(call, stderr=subprocess.DEVNULL, start_new_session=True) as client:
        while not results(out):
            assert client.poll() is None
            time.sleep(0.005)
        os.kill(client.pid, signal.SIGKILL)
    kept = len(results(out))
    assert kept >= 1
    deadline = time.monotonic() + 60.0
    while (left := of_group(client.pid)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert left == []
    assert not (out / "lot.parquet").exists()
    again = subprocess.run(call, capture_output=True, text=True, timeout=200, check=False)
    assert again.returncode == 0, again.stderr
    before = f", {kept} of them earlier" if kept < COUNT else " earlier"
    assert again.stdout.splitlines()[0] == f"{COUNT} recordings analysed{before}"
    assert (out / "lot.parquet").read_bytes() == (once / "lot.parquet").read_bytes()
    assert (out / "lot.html").read_bytes() == (once / "lot.html").read_bytes()


def of_group(group: int) -> list[int]:
    """Return the processes of a group that still run."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, _, of = (folder / "stat").read_text().rsplit(")", 1)[1].split()[:3]
        except OSError:
            continue
        if int(of) == group and state != "Z":
            found.append(int(folder.name))
    return found


def test_a_lot_is_held_against_limits_and_against_another(
    whole: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lot, earlier = whole
    shutil.copytree(earlier, out := tmp_path / "out")
    spec = tmp_path / "spec.toml"
    spec.write_text("[gyro]\nN = 1e-5\n")
    call = command(lot, "--out", out, "--workers", 1)
    call += ["--against", str(spec), "--compare", str(earlier), "--partition", "axis"]
    ended = subprocess.run(call, capture_output=True, text=True, timeout=200, check=False)
    assert ended.returncode == ExitCode.CHECK_FAILED, ended.stderr
    assert ended.stdout.splitlines()[1].startswith(f"0 of {COUNT} units accepted: 0 % [0")
    page = (out / "lot.html").read_text()
    assert f"against {earlier}:</b> no difference; " in page
    assert len(list((out / "lot.parquet").glob("axis=*/*.parquet"))) == 6
    assert len(list((out / "units").iterdir())) == COUNT
    for bad in ("--compare", "--against"):
        call = command(lot, "--out", out, bad, tmp_path / "no.toml")[3:]
        assert main(call) == ExitCode.INPUT
        assert len(capsys.readouterr().err.splitlines()) == 1
