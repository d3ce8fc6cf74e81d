"""A real disk that is really full: a tmpfs of a quarter of a megabyte, made larger afterwards."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from allanscope.recording import Chunk, Recorder, Recording

PATIENCE_S = 20.0


def mount(*arguments: str) -> bool:
    try:
        ran = subprocess.run(["mount", *arguments], capture_output=True, check=False)
    except FileNotFoundError:
        return False
    return ran.returncode == 0


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "disk"
    folder.mkdir()
    if not mount("-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)):
        pytest.skip("nobody may mount a tmpfs here: the injected disks of test_recorder stand in")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "did not happen"
        time.sleep(0.005)


def test_a_disk_that_is_full_to_the_end_leaves_a_recording_that_knows_it(
    small_disk: Path,
) -> None:
    assert mount("-o", "remount,size=5m", str(small_disk))
    recorder = Recorder(small_disk, {}, commit_s=0.01, backlog_bytes=6_000_000)
    for index in range(16_000):
        recorder.rx(Chunk(index * 1_000_000, os.urandom(500)))
        if index % 500 == 0:
            time.sleep(0.02)
    wait_until(lambda: recorder.dropped_bytes > 0)
    recorder.close()
    chunks = list(Recording(small_disk).chunks())
    assert [chunk.event for chunk in chunks if chunk.event] == ["hole"]
    assert chunks[-2].event == "hole"
    kept = sum(len(chunk.data) for chunk in chunks)
    assert kept + recorder.dropped_bytes > 16_000 * 500
    assert "were not recorded" in recorder.alarm
    assert [path.name for path in small_disk.iterdir()] == ["session.mcap"]


def test_a_real_full_disk_is_told_once_and_costs_nothing_when_it_gets_room(
    small_disk: Path,
) -> None:
    alarms: list[str] = []
    recorder = Recorder(small_disk, {}, commit_s=0.01, on_alarm=alarms.append)
    for index in range(1000):
        recorder.rx(Chunk(index * 1_000_000, os.urandom(500)))
    wait_until(lambda: any("not recording (No space left on device)" in one for one in alarms))
    for index in range(1000, 1200):
        recorder.rx(Chunk(index * 1_000_000, os.urandom(500)))
        time.sleep(0.001)
    assert sum("not recording" in one for one in alarms) == 1
    kept = sum(1 for _ in Recording(small_disk).chunks())
    assert kept < 1000
    assert mount("-o", "remount,size=4m", str(small_disk))
    wait_until(lambda: "not recording" not in recorder.alarm)
    recorder.close()
    recording = Recording(small_disk)
    assert recording.damage == []
    assert [chunk.host_ns for chunk in recording.chunks()] == [n * 1_000_000 for n in range(1200)]
    assert recorder.dropped_bytes == 0


def test_a_session_on_a_full_disk_ends_with_its_summary_and_what_is_left_is_read(
    small_disk: Path, tmp_path: Path
) -> None:
    """Results find no room there and are left where there is some; recover and analyse go on."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    def allanscope(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "allanscope", *words],
            env={**os.environ, "TMPDIR": str(elsewhere)},
            capture_output=True,
            text=True,
            check=False,
        )

    assert mount("-o", "remount,size=128k", str(small_disk))  # full within a second
    out = small_disk / "S"
    ran = allanscope(
        *("live", "sim", "--rate", "6660", "--for", "6s", "--view", "none", "--out", str(out))
    )
    assert ran.returncode == 6, ran.stderr
    assert "Traceback" not in ran.stderr
    assert "\ngx " in ran.stdout, "the summary"
    assert "not recording (No space left on device)" in ran.stdout
    assert "charts are not saved" in ran.stderr
    (written,) = elsewhere.glob("allanscope-*/result.json")
    assert f"result.json is in {written.parent}" in ran.stderr
    seen = json.loads(written.read_text())["samples"]
    saved, result = tmp_path / "saved.mcap", tmp_path / "saved.json"
    assert allanscope("recover", str(out), str(saved)).returncode == 0
    ran = allanscope("analyse", str(out), "--quiet", "--json", str(result))
    assert ran.returncode == 0, ran.stderr
    assert 0 < json.loads(result.read_text())["samples"] <= seen
    kept = [chunk.data for chunk in Recording(out).chunks()]
    assert [chunk.data for chunk in Recording(saved).chunks()] == kept
