"""Recordings and plain files as sources, and the names that mean them."""

from __future__ import annotations

import gzip
import math
import os
import threading
from pathlib import Path

import pytest

from allanscope.errors import DeviceError, InputError
from allanscope.recording import Chunk, write_recording
from allanscope.sources import FileSource, RecordedSource, Source, SourceSettings, open_source
from allanscope.sources import file as file_module


def drain(source: Source) -> list[Chunk]:
    chunks = []
    while (chunk := source.read()).event != "end":
        chunks.append(chunk)
    return chunks


CHUNKS = [
    Chunk(5_000_000_000, b"a"),
    Chunk(6_000_000_000, b"b"),
    Chunk(6_500_000_000, b"", "disconnected"),
    Chunk(8_000_000_000, b"", "reconnected"),
    Chunk(8_000_000_001, b"c"),
]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "session.mcap", CHUNKS, {"part": "LSM6DSL"})


def test_a_replay_gives_exactly_what_was_recorded(recording: Path) -> None:
    source = open_source(str(recording))
    assert isinstance(source, RecordedSource)
    assert drain(source) == CHUNKS
    assert source.read() == Chunk(8_000_000_001, event="end")
    assert source.identity["part"] == "LSM6DSL"
    assert drain(open_source(str(recording.parent))) == CHUNKS


class Time:
    """Time that passes only when someone waits for it."""

    def __init__(self) -> None:
        self.now = 0.0

    def clock(self) -> float:
        return self.now

    def wait(self, seconds: float) -> bool:
        self.now += seconds
        return False


@pytest.mark.parametrize("speed", [1.0, 10.0, 0.5])
def test_a_replay_takes_its_time(recording: Path, speed: float) -> None:
    time = Time()
    source = RecordedSource(recording, speed, time.clock)
    source._closing.wait = time.wait  # type: ignore[method-assign, assignment]
    stamps: list[int] = []
    came: list[tuple[float, Chunk]] = []
    while (chunk := source.read()).event != "end":
        stamps.append(chunk.host_ns)
        if chunk.data or chunk.event:
            came.append((time.now, chunk))
    assert [chunk for _, chunk in came] == CHUNKS
    wanted = [(chunk.host_ns - CHUNKS[0].host_ns) * 1e-9 / speed for chunk in CHUNKS]
    assert [at for at, _ in came] == pytest.approx(wanted, abs=1e-6)
    assert stamps == sorted(stamps)
    assert len(stamps) >= 3.0 / speed / 0.05


def test_a_replay_does_not_wait_for_a_clock_that_was_set_back(tmp_path: Path) -> None:
    chunks = [Chunk(9_000_000_000, b"a"), Chunk(1_000, b"b"), Chunk(2_000_001_000, b"c")]
    time = Time()
    source = RecordedSource(write_recording(tmp_path / "a.mcap", chunks, {}), 1.0, time.clock)
    source._closing.wait = time.wait  # type: ignore[method-assign, assignment]
    assert [chunk for chunk in drain(source) if chunk.data] == chunks
    assert time.now == pytest.approx(2.0, abs=0.06)


def test_a_replay_ends_when_it_is_closed(recording: Path) -> None:
    source = RecordedSource(recording, speed=1e-9)
    events: list[str] = []

    def run() -> None:
        while not events or events[-1] != "end":
            events.append(source.read().event)

    reader = threading.Thread(target=run, daemon=True)
    reader.start()
    source.write(b"ignored")
    source.close()
    reader.join(20.0)
    assert not reader.is_alive()


def test_a_file_gives_its_bytes_without_any_time(tmp_path: Path) -> None:
    content = os.urandom(700_000)
    (tmp_path / "capture.bin").write_bytes(content)
    source = open_source(str(tmp_path / "capture.bin"))
    assert isinstance(source, FileSource)
    assert source.identity["file_bytes"] == "700000"
    chunks = drain(source)
    assert b"".join(chunk.data for chunk in chunks) == content
    assert {chunk.host_ns for chunk in chunks} == {0}
    assert source.read().event == "end"


def test_a_compressed_file_is_unpacked_on_the_way(tmp_path: Path) -> None:
    content = b"gx[dps],gy[dps]\n" + b"1.0,2.0\n" * 100_000
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(content[:50]) + gzip.compress(content[50:]))
    found = drain(open_source(str(tmp_path / "log.csv.gz")))
    assert b"".join(chunk.data for chunk in found) == content


@pytest.mark.parametrize("cut", [1, 100, 5000])
def test_a_torn_compressed_file_says_where(tmp_path: Path, cut: int) -> None:
    packed = gzip.compress(os.urandom(300_000))
    (tmp_path / "log.gz").write_bytes(packed[:-cut])
    source = FileSource(tmp_path / "log.gz")
    assert source.size is None
    with pytest.raises(InputError, match="compressed data is damaged after"):
        drain(source)
    source.close()


def test_a_compression_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("allanscope.recording.records.FREE_UNPACKED_BYTES", 1 << 20)
    (tmp_path / "log.gz").write_bytes(gzip.compress(bytes(1 << 22)))
    source = FileSource(tmp_path / "log.gz")
    with pytest.raises(InputError, match="unpack to more than"):
        drain(source)
    source.close()


def test_an_empty_file_is_told_so(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").touch()
    with pytest.raises(InputError, match=r"empty\.csv is empty"):
        open_source(str(tmp_path / "empty.csv"))


def test_a_folder_without_a_session_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="contains no recording"):
        open_source(str(tmp_path))
    with pytest.raises(InputError, match="Is a directory"):
        FileSource(tmp_path)


@pytest.mark.parametrize("name", ["missing.csv", "missing.mcap", "no/such.bin"])
def test_a_missing_file_is_no_missing_port(name: str) -> None:
    with pytest.raises(InputError, match=r"cannot read .*: No such file"):
        open_source(name)


@pytest.mark.parametrize("name", ["/dev/ttyACM77", "COM77", "/dev/cu.usbmodem77"])
def test_a_missing_port_is_no_missing_file(name: str) -> None:
    with pytest.raises(DeviceError, match="no such port"):
        open_source(name)


def test_a_file_that_cannot_be_read_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.csv"
    path.write_text("x")

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(file_module, "_opened", refuse)
    with pytest.raises(InputError, match=r"cannot read .*log\.csv: Permission denied"):
        FileSource(path)


def test_a_file_can_be_closed_half_way(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(bytes(1_000_000))
    source = FileSource(tmp_path / "a.bin")
    assert source.size == (tmp_path / "a.bin").stat().st_size
    source.read()
    source.write(b"ignored")
    source.close()
    assert source.read() == Chunk(0, event="end")


def test_speed_is_a_setting(recording: Path) -> None:
    source = open_source(str(recording), SourceSettings(speed=2.0))
    assert isinstance(source, RecordedSource)
    assert source._speed == 2.0
    assert math.isinf(SourceSettings().speed)
