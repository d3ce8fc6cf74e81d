"""The plan of a split, in one process: first pass, parts and join give what one pass gives."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from distributed import Future, LocalCluster

from allanscope.analysis import Analyser, AnalyserSettings
from allanscope.fleet import FleetSettings, run_fleet, split, work_queue
from allanscope.fleet.cluster import WorkerPool
from allanscope.fleet.inputs import RecordingInput, find_inputs
from allanscope.fleet.split import FirstPass, first_pass, join, submit_split, sum_part
from allanscope.fleet.worker_tasks import analyse_recording
from allanscope.pipeline import DeviceSettings
from allanscope.recording import Chunk, Recording, write_recording
from allanscope.samples import Block, StreamInfo, Ticks

DEVICE = DeviceSettings()


@pytest.fixture
def torn(lot: Path, tmp_path: Path) -> Path:
    """Return a recording in which reads are missing: gaps of known length."""
    whole = Recording(lot / "one" / "a.mcap")
    chunks = list(whole.chunks())
    kept = [one for number, one in enumerate(chunks) if number % 90 not in (40, 41)]
    path = tmp_path / "torn.mcap"
    chunks_of_some = (Chunk(one.host_ns, one.data) for one in kept)
    return write_recording(path, chunks_of_some, whole.metadata)


def test_a_short_recording_is_not_split(lot: Path) -> None:
    [place] = find_inputs([str(lot / "two" / "a.mcap")])
    seen = first_pass(place, DEVICE, 2)
    assert seen == FirstPass(place)
    assert sum_part(place, None, 0, 2) is None
    assert join(seen, [None, None], DEVICE) == analyse_recording(place, DEVICE)


@pytest.mark.parametrize("parts", [2, 5])
def test_joined_parts_are_the_whole(
    torn: Path, parts: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # So short a run is split for the sake of the test: all of it is rest, and rests are exact.
    monkeypatch.setattr(split, "_is_splittable", lambda analyser: True)
    [place] = find_inputs([str(torn)])
    seen = first_pass(place, DEVICE, parts)
    assert len(seen.cuts) == parts
    sums = [sum_part(place, cut, number, parts) for number, cut in enumerate(seen.cuts)]
    joined, whole = join(seen, sums, DEVICE), analyse_recording(place, DEVICE)
    assert not whole.error
    assert joined == whole


def test_a_recording_that_is_padded_is_not_split(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(split, "ROWS", 0)  # a recording as short as this one is split too
    rows = np.random.default_rng(1).integers(-99, 99, (1 << 16, 1)).astype(np.int16)
    padded = rows.copy()
    padded[-200:] = 0
    for counts, splits in ((rows, True), (padded, False)):
        analyser = Analyser(AnalyserSettings())
        analyser.feed(StreamInfo(("gx",), (1.0,), nominal_hz=104.0))
        split._disable_sums(analyser)
        analyser.feed(Block(0, counts, Ticks.none()))
        assert analyser.state is not None
        analyser.state.settle()
        assert split._is_splittable(analyser) is splits


@pytest.fixture
def threads() -> Iterator[LocalCluster]:
    """Return four workers in this process, which see what a test has changed."""
    with LocalCluster(
        n_workers=4,
        threads_per_worker=1,
        processes=False,
        dashboard_address="127.0.0.1:0",  # None is the port 8787, which another may hold
        silence_logs=50,
    ) as one:
        yield one


def test_a_large_recording_is_split_by_itself_through_to_the_report(
    threads: LocalCluster, torn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def written(out: Path) -> tuple[bytes, bytes]:
        settings = FleetSettings((str(torn),), out, threads.scheduler_address, quiet=True)
        result = run_fleet(settings, DEVICE)
        assert (result.done, result.failures) == (1, {})
        return (out / "lot.parquet").read_bytes(), (out / "lot.html").read_bytes()

    whole = written(tmp_path / "whole")
    parts: list[int] = []

    def handed_out(
        pool: WorkerPool, place: RecordingInput, device: DeviceSettings, count: int
    ) -> Future:
        parts.append(count)
        return submit_split(pool, place, device, count)

    monkeypatch.setattr(split, "_is_splittable", lambda analyser: True)
    monkeypatch.setattr(split, "submit_split", handed_out)
    monkeypatch.setattr(work_queue, "PART_BYTES", torn.stat().st_size // 3)
    assert written(tmp_path / "split") == whole
    assert parts == [3]


def test_what_cannot_be_read_fails_once(tmp_path: Path, board: Callable[..., Path]) -> None:
    path = tmp_path / "empty.mcap"
    write_recording(path, [], {"wire": "native"})
    [place] = find_inputs([str(path)])
    assert "contains no samples" in join(first_pass(place, DEVICE, 2), [None, None], DEVICE).error


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text elsewhere")
def test_a_name_that_is_no_text_ends_no_fleet(
    threads: LocalCluster, lot: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "lot"
    folder.mkdir()
    for name in (b"good.mcap", b"b\xffd.mcap"):
        place = Path(os.fsdecode(os.fsencode(folder) + b"/" + name))
        place.write_bytes((lot / "two" / "a.mcap").read_bytes())
    out = tmp_path / "out"
    settings = FleetSettings((str(folder),), out, threads.scheduler_address, quiet=True)
    result = run_fleet(settings, DEVICE)
    assert (result.done, result.failures) == (2, {})
    assert "good.mcap" in (out / "lot.html").read_text("utf-8")
