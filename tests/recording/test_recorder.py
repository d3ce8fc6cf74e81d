"""The live recorder: it never holds up a reading, whatever the disk does, and it says so."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from allanscope.errors import UsageError
from allanscope.recording import Chunk, Recorder, Recording
from allanscope.recording import segment as segment_module

PATIENCE_S = 20.0


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "did not happen"
        time.sleep(0.005)


class Disk:
    """A disk whose room can be set; a write beyond it takes what fits and then fails."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.room = 1 << 40
        self.gate = threading.Event()
        self.gate.set()
        self._write = os.write
        monkeypatch.setattr(segment_module.os, "write", self.write)

    def write(self, fd: int, data: memoryview) -> int:
        self.gate.wait(PATIENCE_S)
        if self.room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = self._write(fd, data[: self.room])
        self.room -= written
        return written


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    made = Disk(monkeypatch)
    yield made
    made.gate.set()


def noise(index: int, size: int = 400) -> Chunk:
    return Chunk(index * 1_000_000, index.to_bytes(4, "little") + os.urandom(size - 4))


def numbers(path: Path) -> list[int]:
    chunks = Recording(path).chunks()
    return [int.from_bytes(chunk.data[:4], "little") for chunk in chunks if chunk.data]


def test_a_live_session_is_recorded_in_order_with_its_remarks(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, {"part": "LSM6DSL"}, commit_s=0.01, sync_s=0.02)
    recorder.tx(b"start", 1)
    for index in range(200):
        recorder.rx(noise(index))
    recorder.rx(Chunk(7, b"", "disconnected"))
    recorder.mark("door opened", 8)
    recorder.describe(wire="native")
    recorder.close()
    recording = Recording(tmp_path)
    assert numbers(tmp_path) == list(range(200))
    assert [chunk.data for chunk in recording.tx()] == [b"start"]
    assert (8, {"kind": "mark", "text": "door opened"}) in list(recording.events())
    assert recording.metadata["wire"] == "native"
    assert recording.damage == []
    assert (recorder.alarm, recorder.dropped_bytes) == ("", 0)
    assert recorder.bytes_written == (tmp_path / "session.mcap").stat().st_size


def test_what_was_committed_is_on_the_disk_while_recording_goes_on(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", {}, commit_s=0.01)
    recorder.rx(noise(5))
    wait_until(lambda: numbers(tmp_path / "a.mcap") == [5])
    recorder.close()


def test_a_source_that_is_faster_than_any_port_does_not_wait_for_the_next_commit(
    tmp_path: Path,
) -> None:
    recorder = Recorder(tmp_path, {}, commit_s=1e4)
    for index in range(40):
        recorder.rx(noise(index, 1 << 18))
        wait_until(lambda: recorder._queued_bytes < 1 << 20)
    recorder.close()
    assert recorder.dropped_bytes == 0
    assert numbers(tmp_path) == list(range(40))


def test_a_full_disk_that_gets_room_again_costs_nothing(tmp_path: Path, disk: Disk) -> None:
    alarms: list[str] = []
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, {}, commit_s=0.01, on_alarm=alarms.append)
    recorder.rx(noise(0))
    wait_until(lambda: numbers(path) == [0])
    sound = path.stat().st_size
    disk.room = 150
    for index in range(1, 100):
        recorder.rx(noise(index))
    wait_until(lambda: bool(recorder.alarm))
    assert "not recording (No space left on device)" in recorder.alarm
    assert "\n" not in recorder.alarm
    assert path.stat().st_size in (sound, sound + 150)
    disk.room = 1 << 40
    wait_until(lambda: not recorder.alarm)
    recorder.close()
    assert numbers(path) == list(range(100))
    assert Recording(path).damage == []
    assert alarms[-1] == ""
    assert recorder.dropped_bytes == 0


def test_a_disk_that_stays_full_keeps_every_whole_second_and_counts_the_rest(
    tmp_path: Path, disk: Disk
) -> None:
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, {}, commit_s=0.01, backlog_bytes=20_000)
    recorder.rx(noise(0))
    wait_until(lambda: numbers(path) == [0])
    disk.room = 0
    for index in range(1, 200):
        recorder.rx(noise(index))
        wait_until(lambda: recorder._queued_bytes == 0)
    wait_until(lambda: recorder.dropped_bytes > 0 and "new data are lost" in recorder.alarm)
    recorder.close()
    assert numbers(path) == [0]
    assert [one.what.split(":")[0] for one in Recording(path).damage] == ["never closed"]


def test_reads_that_were_dropped_are_a_hole_in_the_replay(tmp_path: Path, disk: Disk) -> None:
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, {}, commit_s=0.01, backlog_bytes=2_000)
    disk.gate.clear()
    read = 0
    while recorder.dropped_bytes < 5 * 400:
        assert read < 10_000
        recorder.rx(noise(read))
        read += 1
        time.sleep(0.001)  # the writer takes all there is until it comes to the disk
    disk.gate.set()
    wait_until(lambda: len(numbers(path)) > 0)
    wait_until(lambda: recorder._queued_bytes + recorder._session.pending == 0)
    recorder.rx(noise(10_000))
    wait_until(lambda: 10_000 in numbers(path))
    assert "bytes were not recorded" in recorder.alarm
    recorder.close()
    # The writer may have taken some between two that found no room: then there are two holes.
    kept = numbers(path)
    assert kept == sorted(set(kept))
    assert (kept[0], kept[-1]) == (0, 10_000)
    holes = [chunk.event for chunk in Recording(path).chunks() if chunk.event]
    dropped = [fields for _, fields in Recording(path).events() if fields["kind"] == "dropped"]
    assert holes == ["hole"] * len(dropped)
    assert len(dropped) in (1, 2)
    assert sum(fields["reads"] for fields in dropped) == read - (len(kept) - 1)
    assert recorder.dropped_bytes == 400 * (read - (len(kept) - 1))


def test_a_disk_that_hangs_does_not_hold_up_the_reader(tmp_path: Path, disk: Disk) -> None:
    recorder = Recorder(tmp_path / "a.mcap", {}, commit_s=0.001)
    disk.gate.clear()
    for index in range(500):
        recorder.rx(noise(index))
    recorder.mark("still here")
    recorder.close(timeout_s=0.05)
    assert "does not answer" in recorder.alarm
    disk.gate.set()
    recorder._thread.join(PATIENCE_S)
    assert numbers(tmp_path / "a.mcap") == list(range(500))


def test_the_real_limit_of_a_file_keeps_whole_seconds(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    recorder = Recorder(path, {}, commit_s=0.01)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, hard))
        for index in range(1000):
            recorder.rx(noise(index))
        wait_until(lambda: "not recording" in recorder.alarm)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    wait_until(lambda: not recorder.alarm)
    recorder.close()
    assert numbers(path) == list(range(1000))


def test_a_file_that_is_deleted_or_replaced_is_saved_again(tmp_path: Path) -> None:
    folder = tmp_path / "night"
    folder.mkdir()
    recorder = Recorder(folder, {}, commit_s=0.01)
    recorder.rx(noise(0))
    wait_until(lambda: numbers(folder) == [0])
    shutil.rmtree(folder)
    recorder.rx(noise(1))
    wait_until(lambda: "another program has removed session.mcap" in recorder.alarm)
    wait_until(lambda: numbers(folder) == [0, 1])
    (folder / "session.mcap").rename(tmp_path / "moved.mcap")
    (folder / "session.mcap").write_bytes(b"something else")
    recorder.rx(noise(2))
    wait_until(lambda: "saved again as session-001.mcap" in recorder.alarm)
    recorder.close()
    assert (folder / "session.mcap").read_bytes() == b"something else"
    assert numbers(folder / "session-001.mcap") == [0, 1, 2]


@pytest.mark.parametrize("left", [0, -100])
def test_a_file_that_is_cut_keeps_the_rest_and_recording_goes_on(tmp_path: Path, left: int) -> None:
    recorder = Recorder(tmp_path, {}, commit_s=0.01)
    for index in range(3):
        recorder.rx(noise(index))
        wait_until(lambda index=index: numbers(tmp_path) == list(range(index + 1)))
    path = tmp_path / "session.mcap"
    os.truncate(path, left if left == 0 else path.stat().st_size + left)
    recorder.rx(noise(3))
    wait_until(lambda: "bytes off session.mcap: recording continues in" in recorder.alarm)
    recorder.rx(noise(4))
    recorder.close()
    assert numbers(tmp_path / "session-001.mcap") == [3, 4]
    assert numbers(tmp_path) == ([3, 4] if left == 0 else [0, 1, 3, 4])


def test_scarce_space_is_told_with_the_time_left(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", {}, commit_s=0.01, free_bytes=lambda _: 2000)
    recorder.rx(noise(1))
    wait_until(lambda: bool(recorder.alarm))
    assert "will be full in" in recorder.alarm
    assert recorder.space_left_s is not None
    assert recorder.space_left_s < 600
    recorder.close()
    assert numbers(tmp_path / "a.mcap") == [1]


def test_what_grows_beside_the_recording_takes_room_too(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, {}, commit_s=0.01, free_bytes=lambda _: 1_000_000)
    recorder.rx(noise(0))
    (tmp_path / "session.rrd").write_bytes(bytes(100_000))
    wait_until(lambda: 0 < (recorder.space_left_s or 0) < 11)
    recorder.close()


def test_a_bug_in_the_writer_is_an_alarm_and_no_crash(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", {}, commit_s=0.01)
    recorder.event({"kind": "mark", "what": object()})
    wait_until(lambda: "recording has stopped" in recorder.alarm)
    recorder.rx(noise(1))
    assert recorder.dropped_bytes == 400
    recorder.close()


def test_a_folder_that_does_not_exist_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"cannot record to .*: No such file or directory"):
        Recorder(tmp_path / "nowhere" / "a.mcap", {})


def test_a_disk_that_is_full_at_the_start_is_one_clear_line(tmp_path: Path, disk: Disk) -> None:
    disk.room = 100
    with pytest.raises(UsageError, match="No space left"):
        Recorder(tmp_path / "a.mcap", {})
    assert list(tmp_path.iterdir()) == []


def test_rotation_goes_on_in_the_old_file_when_the_new_one_cannot_be_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path / "a.mcap", {}, commit_s=0.01, max_seconds=0.05)
    (tmp_path / "a-001.mcap").mkdir()
    for index in range(100):
        recorder.rx(noise(index))
    wait_until(lambda: "File exists" in recorder.alarm)
    (tmp_path / "a-001.mcap").rmdir()
    wait_until(lambda: not recorder.alarm)
    recorder.rx(noise(100))
    recorder.close()
    assert numbers(tmp_path / "a.mcap") == list(range(101))
    assert recorder.path.name == "a-001.mcap"
