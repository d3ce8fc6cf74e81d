"""What the disk does is told, and stops nothing; what it holds in pieces is one session."""

from __future__ import annotations

import errno
import json
import os
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from allanscope.pipeline import DeviceSettings, analyse_input, report_sessions
from allanscope.recording import Chunk, Recording, SessionWriter, write_recording
from allanscope.recording import segment as segment_module
from allanscope.simulator import Simulator, simulate_blocks
from support.device_process import DeviceProcess
from support.live_session import watch_in_full
from support.survey import survey

Plug = Callable[..., DeviceProcess]


def test_a_full_disk_is_one_line_at_once_and_monitoring_goes_on(
    plug_in: Plug,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    device = plug_in({"rate": 104.0, "axes": ["gz"]})
    writes, write = list[float](), segment_module._write_all

    def write_all(fd: int, data: bytearray) -> None:
        writes.append(time.monotonic())
        if 1.0 < writes[-1] - writes[0] < 4.0:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(fd, data)

    monkeypatch.setattr(segment_module, "_write_all", write_all)
    analysis = watch_in_full(device.url, tmp_path / "S", 5.5)
    lines = capsys.readouterr().err.splitlines()
    assert len([line for line in lines if "not recording (No space left on device)" in line]) == 1
    assert any("monitoring continues" in remark for remark in analysis.remarks)
    (whole,) = survey(tmp_path / "S")
    assert analysis.samples == whole.received > 300, "room came in time: nothing was lost"
    assert (tmp_path / "S" / "report.html").exists()


def test_results_that_find_no_room_are_left_where_there_is_some(
    plug_in: Plug,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = plug_in({"rate": 104.0, "axes": ["gz"]})
    fsync = os.fsync

    def full(fd: int) -> None:
        place = os.readlink(f"/proc/self/fd/{fd}")
        if place.startswith(str(tmp_path)) and place.endswith(".part"):
            raise OSError(errno.ENOSPC, "No space left on device")
        fsync(fd)

    monkeypatch.setattr("allanscope.atomic_write.os.fsync", full)
    monkeypatch.setenv("TMPDIR", str(tmp_path.parent))
    monkeypatch.setattr("tempfile.tempdir", None)
    analysis = watch_in_full(device.url, tmp_path / "S", 3.0)
    said = "\n".join(analysis.failures)
    (place,) = map(Path, set(re.findall(r"No space left on device; \S+ is in (\S+)", said)))
    assert {path.name for path in place.iterdir()} == {"result.json", "report.html"}
    written = json.loads((place / "result.json").read_text())
    assert len(written["failures"]) == 2


@pytest.fixture(scope="module")
def whole_and_pieces(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a recording in one file, and the same in the files of a folder."""
    folder = tmp_path_factory.mktemp("rotation")
    sensor = Simulator(rate=104.0, axes=("gz",), duration_s=120.0)
    chunks = [Chunk(at, data) for at, data in simulate_blocks(120 / 3600, sensor, start_ns=1)]
    write_recording(folder / "whole.mcap", chunks, {})
    (folder / "pieces").mkdir()
    session = SessionWriter(folder / "pieces", {}, max_seconds=25.0)
    for chunk in chunks:
        session.chunk(chunk)
        session.commit()
    session.close()
    return folder / "whole.mcap", folder / "pieces"


def test_the_files_of_a_session_are_analysed_as_one(whole_and_pieces: tuple[Path, Path]) -> None:
    whole, pieces = whole_and_pieces
    names = sorted(path.name for path in pieces.iterdir())
    assert names == [*(f"session-00{n}.mcap" for n in range(1, 5)), "session.mcap"]
    assert Recording(pieces).sha256() == Recording(whole).sha256()
    one, many = (analyse_input(path, DeviceSettings(), quiet=True) for path in whole_and_pieces)
    assert (many.segments, many.samples, many.lost_samples) == (1, one.samples, 0)
    assert many.to_dict()["axes"] == one.to_dict()["axes"]
    assert many.rate == one.rate


def test_the_files_of_a_session_are_reported_as_one(
    whole_and_pieces: tuple[Path, Path], tmp_path: Path
) -> None:
    report = report_sessions([whole_and_pieces[1]], tmp_path / "report.html", DeviceSettings())
    text = report.read_text()
    assert "per axis, no gaps" in text
