"""Marks that the user set while a run went on are there again whenever the run is taken up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from allanscope.analysis import Analyser, summarise
from allanscope.pipeline import Decoding, DeviceSettings, SessionSettings, analyse_input, run_replay
from allanscope.pipeline.run import earlier_events
from allanscope.recording import Recorder, Recording
from allanscope.samples import Block, Gap, Notice, StreamInfo, Ticks
from allanscope.simulator import Simulator
from allanscope.sources import Chunk
from allanscope.wire import LinkStats, WireSettings, format_named

RATE = 104.0
SECONDS = 6
MARKED = {2: "fan off", 5: "door"}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds, with a mark after two of them and one after five."""
    folder = tmp_path_factory.mktemp("marked")
    encoder, sensor = (
        format_named("native").encoder(),
        Simulator(rate=RATE, seed=3, clock_error=0.0),
    )
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


def test_a_mark_stands_where_the_series_has_that_moment() -> None:
    """On the axis of the rows: at the true rate, 6 % slow here, and with the hole counted."""
    analyser, true_hz, unknown = Analyser(), RATE / 1.06, np.full(1, np.nan)
    analyser.feed(Notice("mark", "before the first sample"))
    analyser.feed(StreamInfo(("gx",), (1e-3,), RATE))
    counts = np.random.default_rng(1).integers(-50, 50, (22000, 1)).astype(np.int16)
    for first in [*range(0, 6000, 100), *range(16000, 22000, 100)]:
        if first == 16000:
            analyser.feed(Gap("link", 10000))
        at_s = np.array([(first + 99) / true_hz])
        analyser.feed(
            Block(first, counts[first : first + 100], Ticks(np.array([99]), unknown, at_s, unknown))
        )
    analyser.feed(Notice("mark", "at the end"))
    found = summarise(analyser, LinkStats(), "live", {})
    assert found.rate.measured_hz == pytest.approx(true_hz, rel=1e-4)
    assert [text for _, text in found.marks] == ["before the first sample", "at the end"]
    times = [time_s for time_s, _ in found.marks]
    assert times == pytest.approx([0.0, 22000 / true_hz], rel=1e-4)
    assert analyser.state is not None
    rows = analyser.state.history.record(found.rate.best_hz, ("gx",), (1e-3,))
    assert times[1] == pytest.approx(rows.start_s[-1], abs=2.0 / true_hz)


def test_a_mark_is_no_part_of_what_was_measured(session: Path, tmp_path: Path) -> None:
    """The fingerprint is that of the bytes, and a mark survives being copied chunk by chunk."""
    from allanscope.recording import write_recording

    chunks = list(Recording(session).chunks())
    copy = write_recording(tmp_path / "copy.mcap", chunks, {})
    bare = [chunk for chunk in chunks if chunk.event != "mark"]
    without = write_recording(tmp_path / "bare.mcap", bare, {})
    assert list(Recording(copy).chunks()) == chunks
    assert Recording(without).sha256() == Recording(session).sha256()
