"""Recordings are found and read where they are, on this machine or behind fsspec."""

from __future__ import annotations

import gzip
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import fsspec
import numpy as np
import pytest
from fsspec.implementations.local import LocalFileSystem
from fsspec.spec import AbstractBufferedFile

from allanscope.errors import UsageError
from allanscope.fleet import FleetSettings, run_fleet
from allanscope.fleet.inputs import READ_AHEAD_BYTES, find_inputs
from allanscope.fleet.outcome import Outcome
from allanscope.fleet.store import Store
from allanscope.fleet.work_queue import WorkQueue
from allanscope.fleet.worker_tasks import analyse_recording, fingerprint_recording
from allanscope.pipeline import DeviceSettings
from allanscope.recording import Chunk, Recording, write_recording

DEVICE = DeviceSettings()


@pytest.fixture
def memory() -> Iterator[Any]:
    filesystem = fsspec.filesystem("memory")
    yield filesystem
    filesystem.rm("/bench", recursive=True)


def put(filesystem: Any, name: str, data: bytes) -> None:
    with filesystem.open(f"/bench/{name}", "wb") as file:
        file.write(data)


def analysis(outcome: Outcome) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(gzip.decompress(outcome.result))["analysis"]
    del result["input"]["path"]
    return result


def test_a_remote_recording_gives_the_same_result(lot: Path, memory: Any) -> None:
    put(memory, "x/a.mcap", (lot / "one" / "a.mcap").read_bytes())
    [place] = find_inputs(["memory://bench/**/*.mcap"])
    assert place.url == "memory:///bench/x/a.mcap"
    [local] = find_inputs([str(lot / "one" / "a.mcap")])
    there, here = analyse_recording(place, DEVICE), analyse_recording(local, DEVICE)
    assert not there.error
    assert analysis(there) == analysis(here)
    assert there.sha256 == here.sha256 == fingerprint_recording(place, DEVICE).sha256


def test_a_remote_session_of_several_files_is_one(
    memory: Any, session: Callable[[int], Path]
) -> None:
    first = session(20)
    for file in first.parent.glob("*.mcap"):
        put(memory, file.name, file.read_bytes())
    [place] = find_inputs(["memory://bench/*.mcap"])
    remote = Recording(place.open_path())
    assert len(remote.files) == 3
    assert list(remote.chunks()) == list(Recording(first).chunks())


class CountedFile(AbstractBufferedFile):
    """A remote file that notes how much is asked of the other side at a time."""

    asked: ClassVar[list[int]] = []

    def _fetch_range(self, start: int, end: int) -> bytes:
        self.asked.append(end - start)
        with Path(self.path).open("rb") as file:
            file.seek(start)
            return file.read(end - start)


class CountedFiles(LocalFileSystem):
    """A far folder: its files come by ranges, as over HTTP."""

    protocol = "counted"

    def _open(self, path: str, mode: str = "rb", block_size: int = 0, **options: Any) -> Any:
        return CountedFile(self, path, mode, block_size, **options)


def test_a_remote_file_is_read_by_pieces(tmp_path: Path) -> None:
    fsspec.register_implementation("counted", CountedFiles, clobber=True)
    rng = np.random.default_rng(1)
    chunks = [Chunk(1 + n, rng.bytes(20_000)) for n in range(1000)]
    size = write_recording(tmp_path / "a.mcap", chunks, {"wire": "native"}).stat().st_size
    [place] = find_inputs([f"counted://{tmp_path}/*.mcap"])
    assert place.url == f"counted://{tmp_path}/a.mcap"
    CountedFile.asked.clear()
    assert sum(1 for _ in Recording(place.open_path()).chunks()) == len(chunks)
    a_chunk = 4 << 20
    assert max(CountedFile.asked) < a_chunk + 2 * READ_AHEAD_BYTES < size / 3
    assert sum(CountedFile.asked) < 2.5 * size


def test_a_remote_file_that_is_gone_is_one_line(memory: Any) -> None:
    put(memory, "a.mcap", b"x")
    [place] = find_inputs(["memory://bench/a.mcap"])
    memory.rm("/bench/a.mcap")
    put(memory, "b.mcap", b"")
    error = analyse_recording(place, DEVICE).error
    assert error.startswith("cannot read memory:///bench/a.mcap")
    assert "\n" not in error


def test_what_matches_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nothing matches"):
        find_inputs([f"{tmp_path}/*.mcap"])
    with pytest.raises(UsageError, match="cannot look for"):
        find_inputs(["nosuchprotocol://x/*.mcap"])


def test_numbered_files_of_another_session_stand_alone(
    tmp_path: Path, session: Callable[[int], Path]
) -> None:
    first = session(20)
    shutil.copy(first, stranger := first.with_name("session-007.mcap"))
    [place, *rest] = find_inputs([str(first.parent)])
    assert not rest
    assert [one.name for one in place.later] == [
        "session-001.mcap",
        "session-002.mcap",
        "session-007.mcap",
    ]
    store = Store(tmp_path / "out", DEVICE)
    queue = WorkQueue(store, [place])
    queue.todo.clear()
    mine = ("session.mcap", "session-001.mcap", "session-002.mcap")
    assert queue.record(place, Outcome(place.url, "00", mine, b"result"))
    store.close()
    assert [one.url for one in queue.todo] == [str(stranger)]


@pytest.fixture
def session(tmp_path: Path) -> Callable[[int], Path]:
    """Return a function that writes a session over three files."""
    from allanscope.recording import Chunk, SessionWriter

    def write(seconds: int) -> Path:
        folder = tmp_path / "night"
        folder.mkdir()
        writer = SessionWriter(folder / "session.mcap", {"wire": "native"}, max_seconds=8.0)
        for second in range(seconds):
            writer.chunk(Chunk(1 + second * 1_000_000_000, bytes([second]) * 50))
            writer.commit()
        writer.close()
        return folder / "session.mcap"

    return write


@pytest.mark.parametrize("pattern", ["(", "unit"])
def test_a_pattern_of_units_that_is_none_is_refused_before_any_work(
    pattern: str, tmp_path: Path
) -> None:
    (tmp_path / "a.mcap").write_bytes(b"not looked at")
    settings = FleetSettings((str(tmp_path),), tmp_path / "out", unit_pattern=pattern)
    with pytest.raises(UsageError, match="--unit-name"):
        run_fleet(settings, DEVICE)
    assert not (tmp_path / "out").exists()


def test_names_with_brackets_are_names(tmp_path):
    there = tmp_path / "lot[1]" / "b [2026-01-01].mcap"
    there.parent.mkdir()
    there.write_bytes(b"any")
    for named in (there.parent, there, tmp_path / "lot*"):
        pattern = f"{named}/*.mcap" if "*" in named.name else str(named)
        assert [Path(one.url) for one in find_inputs([pattern])] == [there]


def test_a_text_file_is_a_recording_of_a_fleet(tmp_path: Path) -> None:
    rows = np.random.default_rng(3).normal(0.0, 0.04, (300, 1))
    path = tmp_path / "unit.csv"
    np.savetxt(path, rows, "%.5f", header="gx[dps]", comments="")
    (place,) = find_inputs([str(path)])
    device = DeviceSettings(rate_hz=104.0)
    outcome = analyse_recording(place, device)
    assert not outcome.error
    assert fingerprint_recording(place, device).sha256 == outcome.sha256
    unknown = analyse_recording(place, DeviceSettings())
    assert unknown.error.endswith("(or none that go up); give --rate HZ")
