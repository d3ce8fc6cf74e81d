"""The file of the charts is bounded, and ends before the recording has no room; real disks."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from allanscope.recording import Chunk, Recorder, Recording
from allanscope.view import RerunView, chart_sink, rerun_view
from allanscope.view.decimator import ROWS_HZ, LogSpacing, Rows, RowThinner
from support.demo_analysis import demo_analysis
from support.demo_session import perform
from support.readback import read_back

MB = 1 << 20


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Callable[[int], Path]]:
    """Return a function that makes a disk of so many MB."""
    folder = tmp_path / "disk"
    folder.mkdir()

    def of(megabytes: int) -> Path:
        command = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
        try:
            ran = subprocess.run(command, capture_output=True, check=False)
        except FileNotFoundError:
            pytest.skip("there is no mount")
        if ran.returncode:
            pytest.skip("nobody may mount a tmpfs here")
        return folder

    yield of
    subprocess.run(["umount", "-l", str(folder)], capture_output=True, check=False)


def allow_a_look(view: RerunView) -> None:
    """Make the file look at its disk with the next thing that is drawn."""
    for one in view._sinks:
        one._looked_s = -float("inf")


def test_the_file_ends_when_the_disk_gets_full_and_the_recording_goes_on(
    disk: Callable[[int], Path],
) -> None:
    folder = disk(60)
    said: list[str] = []
    recorder = Recorder(folder, {}, commit_s=0.01)
    view = RerunView(folder, "none", say=said.append)
    view.start()
    perform(view, 3.0)
    assert view.flush()
    (folder / "of others").write_bytes(bytes(40 * MB))
    allow_a_look(view)
    view.snapshot(demo_analysis(4.0))
    assert view.settle(60.0)
    file = folder / "session.rrd"
    ended_at = file.stat().st_size
    for second in range(5, 12):
        view.snapshot(demo_analysis(float(second)))
        assert view.settle(60.0)
    for index in range(1000):
        recorder.rx(Chunk(index * 1_000_000, bytes(np.random.default_rng(index).bytes(500))))
    recorder.close()
    view.close(demo_analysis(12.0))
    assert file.stat().st_size == ended_at
    (line,) = [line for line in said if "stops to spare the recording" in line]
    assert "allanscope replay draws them" in line
    assert view.failure in line
    assert read_back(file)["/gx/allan/oadev"][-1].elapsed_s == 3.0
    assert sum(1 for _ in Recording(folder).chunks()) == 1000
    assert recorder.dropped_bytes == 0


def test_a_disk_without_room_gets_no_file_of_charts(disk: Callable[[int], Path]) -> None:
    folder = disk(20)
    said: list[str] = []
    view = RerunView(folder, "none", say=said.append)
    view.start()
    perform(view, 2.0)
    view.close()
    assert list(folder.iterdir()) == []
    assert said == [view.failure]
    assert "MB are reserved for the recording" in view.failure
    assert view.size_notice("abc", None) == ""


def test_a_write_that_fails_ends_the_file_and_not_the_program(disk: Callable[[int], Path]) -> None:
    """Rerun would wait for ever for a writer that has ended, at the end of the program too."""
    folder = disk(1)
    script = (
        "import sys, pathlib; sys.path.insert(0, sys.argv[1])\n"
        "from allanscope.view import RerunView, load_rerun, chart_sink\n"
        "load_rerun()\n"
        "from support.demo_session import perform\n"
        "chart_sink.shutil.disk_usage = lambda folder: type('Room', (), {'free': 1 << 40})\n"
        "view = RerunView(pathlib.Path(sys.argv[2]), 'none'); view.start(); perform(view, 4.0)\n"
        "view.close(); print(view.failure)\n"
    )
    tests = str(Path(__file__).parents[1])
    ran = subprocess.run(
        [sys.executable, "-c", script, tests, str(folder)],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert "session.rrd could not be written" in ran.stdout


def test_the_file_ends_at_its_largest_size_without_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(chart_sink, "MOST_BYTES", MB)
    said: list[str] = []
    view = RerunView(tmp_path, "none", say=said.append)
    view.start()
    for second in range(1, 5):
        allow_a_look(view)
        view.snapshot(demo_analysis(float(second)))
        assert view.settle(60.0)
    view.close()
    assert [line for line in said if "session.rrd has reached 1 MB" in line]
    assert view.failure == ""
    assert (tmp_path / "session.rrd").stat().st_size < 4 * MB


def test_the_line_at_the_start_says_how_large_the_file_becomes(tmp_path: Path) -> None:
    view = RerunView(tmp_path, "none")
    line = view.size_notice("abcdef", 12 * 3600.0)
    assert line.startswith("session.rrd: about 160 MB in 12 h")
    assert ", at most " in line
    assert "about 60 MB in 10 min" in view.size_notice("abcdef", 600.0)
    assert RerunView(None, "none").size_notice("abcdef", None) == ""


def rows_of(start_s: float, seconds: float) -> Rows:
    elapsed_s = start_s + (np.arange(round(seconds * ROWS_HZ)) + 0.5) / ROWS_HZ
    mean = np.sin(elapsed_s)[:, None]
    return Rows(elapsed_s, mean, mean - 1.0, mean + 1.0, 30.0)


def test_rows_of_a_night_become_few_and_keep_every_spike() -> None:
    thinner, hours = RowThinner(), 12.0
    given: list[Rows] = []
    for start in range(0, round(hours * 3600), 60):
        rows = rows_of(start, 60.0)
        rows.high[17, 0] = 100.0 + start
        given += [one for one in [thinner.update(rows)] if one is not None]
    given += [one for one in [thinner.flush()] if one is not None]
    kept = Rows.joined(given)
    assert len(kept.elapsed_s) == pytest.approx(RowThinner.expected(hours * 3600.0), rel=0.1)
    assert len(kept.elapsed_s) < 0.25 * hours * 3600.0 * ROWS_HZ
    assert (np.diff(kept.elapsed_s) > 0.0).all()
    spikes = kept.high[kept.high[:, 0] >= 100.0, 0]
    np.testing.assert_array_equal(spikes, 100.0 + np.arange(0, hours * 3600, 60))
    assert (kept.low <= kept.mean).all()
    assert (kept.mean <= kept.high).all()


def test_longer_rows_do_not_bridge_a_gap() -> None:
    thinner = RowThinner()
    assert thinner.update(rows_of(40_000.0, 8.0)) is None
    assert thinner.update(rows_of(41_000.0, 8.0)) is not None
    thinner.update(rows_of(42_000.0, 8.0))
    thinner.update(rows_of(42_020.0, 8.0))
    rest = thinner.flush()
    assert rest is not None
    inside = (rest.elapsed_s > 42_008.0) & (rest.elapsed_s < 42_020.0)
    assert not inside.any()


def test_the_number_of_results_grows_with_the_logarithm_of_the_run() -> None:
    pace = LogSpacing(share=chart_sink.FILE_SHARE, longest_s=float("inf"))
    drawn = sum(pace.due(float(second)) for second in range(1, 12 * 3600))
    assert drawn == pytest.approx(LogSpacing.expected(12 * 3600.0, chart_sink.FILE_SHARE), rel=0.1)
    assert drawn < 450


def test_a_served_run_keeps_the_minute_that_its_file_does_without() -> None:
    shown, kept = LogSpacing(), LogSpacing(share=chart_sink.FILE_SHARE, longest_s=float("inf"))
    at = range(36_000, 37_000)
    assert sum(map(shown.due, map(float, at))) >= 16
    assert sum(map(kept.due, map(float, at))) <= 2


def test_a_file_alone_is_begun_after_the_first_result_and_has_what_came_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Loading Rerun takes longer than the first curve, which must not wait for it."""
    monkeypatch.setattr(rerun_view, "_DRAWING", "not loaded yet")
    monkeypatch.setattr(rerun_view, "load_rerun", lambda: None)
    view = RerunView(tmp_path, "none")
    view.start()
    view.notice("something before the first result")
    time.sleep(0.1)
    assert not (tmp_path / "session.rrd").exists()
    view.snapshot(demo_analysis(2.0))
    assert view.settle(60.0)
    assert (tmp_path / "session.rrd").exists()
    view.close()
    assert view.failure == ""
    remarks = read_back(tmp_path / "session.rrd")["/log"]
    assert "something before the first result" in str(remarks)


def test_what_is_not_installed_is_told_before_a_run() -> None:
    rerun_view.require_rerun()
    with (
        mock.patch.object(rerun_view, "find_spec", return_value=None),
        pytest.raises(ModuleNotFoundError, match="rerun") as caught,
    ):
        rerun_view.require_rerun()
    assert caught.value.name == "rerun"
