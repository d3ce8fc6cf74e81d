"""Events: the same live, replayed and analysed, to the sample; told once, while the run goes on."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from allanscope.analysis import Analyser, AnalyserSettings
from allanscope.pipeline import Decoding, DeviceSettings, SimulatedSettings, simulate_recording
from allanscope.pipeline.replaying import feed_analyser
from allanscope.pipeline.session import Session
from allanscope.recording import Recording
from allanscope.samples import Notice
from allanscope.sources import RecordedSource
from allanscope.watch import Event

EFFECTS = ("step:size=0.1,time=300,axis=gx", "sinusoid:frequency=21,amplitude=0.1,time=360,axis=gz")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("events") / "night.mcap"
    settings = SimulatedSettings(seed=4, effects=EFFECTS)
    simulate_recording(path, 450 / 3600, DeviceSettings(), settings, quiet=True)
    return path


class Listener:
    """A listener that keeps remarks."""

    def __init__(self) -> None:
        self.notices: list[Notice] = []

    def info(self, info: object) -> None: ...
    def samples(self, info: object, block: object) -> None: ...
    def gap(self, gap: object) -> None: ...
    def snapshot(self, analysis: object) -> None: ...

    def notice(self, notice: Notice) -> None:
        self.notices.append(notice)


def events(analyser: Analyser) -> tuple[Event, ...]:
    state = analyser.state
    assert state is not None
    assert not state.watch_failure
    return state.watch.events(100.0)


def test_replay_finds_what_live_found(recording: Path):
    """Read by read as a port is, in megabytes as a file is, and through a session."""
    live, decoding = Analyser(), Decoding(DeviceSettings().for_wire())
    for chunk in Recording(recording).chunks():
        for event in decoding.feed(chunk):
            live.feed(event)
    quick = Analyser(AnalyserSettings(buffered_rows=1 << 17))
    feed_analyser(recording, Decoding(DeviceSettings().for_wire()), quick, quiet=True)
    listener = Listener()
    source = RecordedSource(recording, math.inf)
    replayed = Analyser()
    session = Session(source, Decoding(DeviceSettings().for_wire()), replayed, listeners=[listener])
    session.run()
    assert events(live) == events(quick) == events(replayed)
    assert [event.kind for event in events(live)] == ["step", "sinusoid"]
    told = [one for one in listener.notices if one.kind == "event"]
    assert [one.fields["news"] for one in told] == ["found", "found"]
    first = json.loads(str(told[0].fields["event"]))
    assert first["kind"] == "step"
    assert first["axes"] == ["gx"]
    assert first["occurrences"][0]["onset_s"] == pytest.approx(300, abs=3)


def test_what_was_found_before_a_crash_is_no_news(recording: Path):
    """A session that goes on has its events, and tells only those that are new."""
    decoding, listener = Decoding(DeviceSettings().for_wire()), Listener()
    past = [
        event for buffer in Recording(recording).buffers() for event in decoding.feed_buffer(buffer)
    ]
    source = RecordedSource(recording, math.inf)
    source.close()
    session = Session(source, decoding, Analyser(), listeners=[listener], earlier=past)
    session.run()
    assert len(events(session.analyser)) == 2
    assert not [one for one in listener.notices if one.kind == "event"]
