"""Marks that the user set while a run went on are there again whenever the run is taken up."""

from __future__ import annotations

from pathlib import Path

import pytest

from allanscope.pipeline.analyse import analyse_input
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.live import run_replay
from allanscope.pipeline.resuming import earlier_events
from allanscope.pipeline.settings import DeviceSettings, SessionSettings
from allanscope.recording import Recorder, Recording
from allanscope.samples import Block, Notice
from allanscope.simulator import Simulator
from allanscope.sources import Chunk
from allanscope.wire import format_named
from allanscope.wire.base import WireSettings

RATE = 104.0
SECONDS = 6
MARKED = {2: "fan off", 5: "door"}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds, with a mark after two of them and one after five."""
    folder = tmp_path_factory.mktemp("marked")
    encoder, sensor = format_named("native").encoder(), Simulator(rate=RATE, seed=3)
    recorder = Recorder(folder, {"wire": "native"})
    hello = encoder.describe(sensor.info)
    for second in range(SECONDS):
        if second in MARKED:
            recorder.mark(MARKED[second], second * 1_000_000_000)
        data = hello + encoder.encode(sensor.read(round(RATE)))
        recorder.rx(Chunk((second + 1) * 1_000_000_000, data))
    recorder.close()
    return folder


def test_a_session_that_is_taken_up_has_its_marks_where_they_were_set(session: Path) -> None:
    decoding = Decoding(WireSettings(), "native")
    samples, marks = 0, {}
    for event in earlier_events(Recording(session), decoding, lambda data: None):
        if isinstance(event, Block):
            samples += len(event)
        elif isinstance(event, Notice) and event.kind == "mark":
            marks[round(samples / RATE)] = event.text
    assert marks == MARKED


def test_a_replay_and_an_analysis_have_them_too(session: Path) -> None:
    expected = pytest.approx(list(MARKED), abs=1.0 / RATE)
    replayed = run_replay(session, 1e3, DeviceSettings(), SessionSettings(view="none", quiet=True))
    analysed = analyse_input(session, DeviceSettings(), quiet=True)
    for analysis in (replayed, analysed):
        assert [text for _, text in analysis.marks] == list(MARKED.values())
        assert [time_s for time_s, _ in analysis.marks] == expected


def test_a_mark_is_no_part_of_what_was_measured(session: Path, tmp_path: Path) -> None:
    """The fingerprint is that of the bytes, and a mark survives being copied chunk by chunk."""
    from allanscope.recording import write_recording

    chunks = list(Recording(session).chunks())
    copy = write_recording(tmp_path / "copy.mcap", chunks, {})
    bare = [chunk for chunk in chunks if chunk.event != "mark"]
    without = write_recording(tmp_path / "bare.mcap", bare, {})
    assert list(Recording(copy).chunks()) == chunks
    assert Recording(without).sha256() == Recording(session).sha256()
