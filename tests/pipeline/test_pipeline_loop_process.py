"""Looks for effects while a run goes on: in a child, announced with the next result."""

import threading
import time
import tracemalloc

import numpy as np
import pytest

from allanscope.analysis import Analyser, summarise, verdict
from allanscope.pipeline.read_queue import LIVE_ROOM, ReadQueue, joined
from allanscope.pipeline.refreshing import LoopProcess
from allanscope.recording import Buffer
from allanscope.samples import Block, StreamInfo, Ticks
from allanscope.sources import Chunk
from allanscope.view.change_log import ChangeLog
from allanscope.wire import LinkStats

RATE = 52.0


@pytest.fixture
def analyser():
    """Return what has seen three minutes of one axis with a line that nobody could miss."""
    taken = Analyser()
    taken.feed(StreamInfo(("gx",), (0.004375,), nominal_hz=RATE))
    time_s = np.arange(int(180 * RATE)) / RATE
    noise = np.random.default_rng(1).normal(0.0, 10.0, len(time_s))
    counts = np.rint(noise + 8.0 * np.sin(2 * np.pi * 3.3 * time_s)).astype(np.int16)
    taken.feed(Block(0, counts[:, np.newaxis], Ticks.none()))
    return taken


def finished(process):
    """Wait for the look that is under way."""
    process._thread.join(60.0)
    assert not process.busy


def test_a_line_is_found_by_the_child_and_announced_once(analyser):
    process, log = LoopProcess(first_s=120.0), ChangeLog()
    before = summarise(analyser.frozen(), LinkStats(), "live", {}, known=process.explanation)
    assert not any("found" in text for _, text in log.update(before))
    process.offer(analyser.frozen())
    finished(process)
    assert process.trouble == ""
    told = []
    for _ in range(2):
        result = summarise(analyser.frozen(), LinkStats(), "live", {}, known=process.explanation)
        told += [text for _, text in log.update(result) if "found" in text]
    assert len(told) == 1
    assert "3.3" in told[0]
    explanation = result.axes["gx"].explanation
    assert [effect.kind for effect in explanation.effects] == ["sinusoid"]
    assert explanation.after.rms_percent < explanation.before.rms_percent


def test_of_a_search_only_what_a_result_needs_is_held(analyser):
    """As long as the record are one signal an effect, in single precision, and nothing else."""
    process = LoopProcess(first_s=120.0)
    process.offer(analyser.frozen())
    finished(process)
    known = process.explanation
    assert not known.cleaned
    assert not known.signals
    assert all(part.raw.size == 0 for part in known.fits["gx"].evidence)
    (line,) = known.held.accepted["gx"]
    assert line.signal.dtype == np.float32
    result = summarise(analyser.frozen(), LinkStats(), "live", {}, known=known)
    assert "sinusoid" in result.axes["gx"].model.components


def more(analyser, seconds, sigma):
    """Let so many seconds pass with noise of another size, the line going on."""
    state = analyser.state
    time_s = (state.samples + np.arange(int(seconds * RATE))) / RATE
    noise = np.random.default_rng(2).normal(0.0, sigma, len(time_s))
    counts = np.rint(noise + 8.0 * np.sin(2 * np.pi * 3.3 * time_s)).astype(np.int16)
    analyser.feed(Block(state.samples, counts[:, np.newaxis], Ticks.none()))


def test_coefficients_follow_the_run_while_effects_are_held(analyser):
    """Between two searches N grows with the noise, and says of when it is."""
    process = LoopProcess(first_s=120.0)
    process.offer(analyser.frozen())
    finished(process)
    results = []
    for seconds in (0.0, 60.0, 60.0):
        more(analyser, seconds, sigma=20.0)
        frozen = analyser.frozen()
        results.append(summarise(frozen, LinkStats(), "live", {}, known=process.explanation))
    axes = [result.axes["gx"] for result in results]
    assert [[e.kind for e in axis.explanation.effects] for axis in axes] == 3 * [["sinusoid"]]
    sizes = [axis.coefficients["N"].value for axis in axes]
    assert sizes[0] < 0.95 * sizes[1] < 0.9 * sizes[2]
    assert [axis.coefficients_as_of.samples for axis in axes] == [r.samples for r in results]
    assert {axis.explanation_as_of.samples for axis in axes} == {results[0].samples}
    said = results[-1].to_dict()["axes"]["gx"]
    assert said["coefficients_as_of"] == {"time_s": 300.0, "samples": int(300 * RATE)}
    assert said["effects_as_of"]["time_s"] == 180.0
    # The line is still no noise: what is known of it is taken out of the longer record too.
    assert "sinusoid" in axes[-1].model.components


def test_the_error_of_a_clock_is_one_finding_and_explains_no_axis():
    """Both axes have it; their coefficients are those of the fit to all that there is."""
    taken = Analyser()
    taken.feed(StreamInfo(("gx", "gy"), (0.004, 0.004), nominal_hz=50.0))
    noise = np.random.default_rng(3).normal(0.0, 10.0, (int(180 * RATE), 2))
    unknown = np.full(len(noise), np.nan)
    offset = np.arange(len(noise))
    host_s = offset / RATE
    ticks = Ticks(offset, unknown, host_s, unknown)
    taken.feed(Block(0, np.rint(noise).astype(np.int16), ticks))
    process = LoopProcess(first_s=120.0)
    process.offer(taken.frozen())
    finished(process)
    result = summarise(taken.frozen(), LinkStats(), "live", {}, known=process.explanation)
    (effect,) = result.effects
    assert effect.kind == "clock_error"
    assert effect.parameters["relative"].value == pytest.approx(0.04, abs=1e-4)
    assert [line.text for line in verdict(result).details if line.head == "Clock"] == [
        "4.00 % fast"
    ]
    assert verdict(result).lines[1].head == "No additional effects"
    assert [text for _, text in ChangeLog().update(result) if "clock" in text] == [
        "found: clock 4.00 % fast"
    ]
    said = result.to_dict()
    assert [one["kind"] for one in said["effects"]] == ["clock_error"]
    assert [one["kind"] for one in said["axes"]["gy"]["effects"]] == ["clock_error"]
    for axis in result.axes.values():
        assert axis.explanation.own_effects == ()
        assert axis.coefficients_as_of.samples == result.samples


def test_nobody_looks_again_before_the_run_has_doubled(analyser):
    process = LoopProcess(first_s=120.0)
    process.offer(analyser.frozen())
    finished(process)
    thread = process._thread
    process.offer(analyser.frozen())
    assert process._thread is thread


def test_nobody_looks_at_a_run_that_is_too_short(analyser):
    process = LoopProcess(first_s=200.0)
    process.offer(analyser.frozen())
    assert not process.busy
    assert process.explanation is None


def test_the_end_of_the_run_ends_a_look_at_once(analyser):
    process = LoopProcess(first_s=120.0)
    process.offer(analyser.frozen())
    while (worker := process._worker) is None:
        process._thread.join(0.01)
    process.close()
    assert worker._process.poll() is not None
    assert process.explanation is None
    process.offer(analyser.frozen())
    assert not process.busy


def test_what_the_child_was_given_is_not_held_while_it_searches():
    taken = Analyser()
    taken.feed(StreamInfo(("gx",), (0.004375,), nominal_hz=RATE))
    counts = np.random.default_rng(4).integers(-30, 30, (100_000, 1)).astype(np.int16)
    taken.feed(Block(0, counts, Ticks.none()))
    process, frozen = LoopProcess(first_s=120.0), taken.frozen()
    tracemalloc.start()
    process.offer(frozen)
    deadline = time.monotonic() + 60.0
    while tracemalloc.get_traced_memory()[0] > 400_000 and time.monotonic() < deadline:
        time.sleep(0.01)
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert process.busy
    process.close()
    assert peak > 800_000
    assert held < 400_000


def test_a_look_that_fails_says_why_and_harms_nothing(analyser):
    process = LoopProcess(first_s=120.0)
    analyser.state.history._sums[:10] = np.nan
    process.offer(analyser.frozen())
    finished(process)
    assert "not finite" in process.trouble
    assert process.explanation is None


def test_reads_that_come_together_are_taken_together_and_in_order():
    inbox = ReadQueue(together_s=0.05)
    chunks = [Chunk(1, b"a"), Chunk(2, b"b"), Chunk(3, event="disconnected"), Chunk(4, b"c")]
    for chunk in chunks:
        inbox.put(chunk)
    inbox.end()
    taken = inbox.get_all()
    assert taken[:-1] == chunks
    assert taken[-1].event == "end"
    first, event, last = joined(chunks)
    assert isinstance(first, Buffer)
    assert list(first.chunks()) == chunks[:2]
    assert event == chunks[2]
    assert list(last.chunks()) == chunks[3:]


def test_what_was_read_long_ago_is_taken_at_once_and_the_end_of_a_run_waits_for_nothing():
    late = ReadQueue(together_s=3600.0, live=True)
    late.put(Chunk(time.monotonic_ns() - 3600 * 10**9, b"a"))
    assert [chunk.data for chunk in late.get_all()] == [b"a"]  # else the test takes an hour
    ended = ReadQueue(together_s=3600.0, live=True)
    ended.put(Chunk(time.monotonic_ns(), b"a"))
    threading.Timer(0.01, ended.end).start()
    assert ended.get_all()[0].data == b"a"


def test_what_happens_to_the_link_is_passed_on_at_once():
    """A board that is back may wait for a word, and loses what it samples until then."""
    inbox = ReadQueue(together_s=3600.0, live=True)
    inbox.put(Chunk(time.monotonic_ns(), b"a"))
    back = Chunk(time.monotonic_ns(), event="reconnected")
    threading.Timer(0.01, inbox.put, [back]).start()
    taken = inbox.get_all()  # else the test takes an hour
    assert [chunk.data for chunk in taken] in ([b"a"], [b"a", b""])
    if back not in taken:
        assert inbox.get_all() == [back]


def test_a_reader_waits_when_there_is_no_room_and_is_let_go_at_the_end():
    inbox = ReadQueue(room=1, together_s=0.0)
    inbox.put(Chunk(1, b"a"))
    reader = threading.Thread(target=inbox.put, args=(Chunk(2, b"b"),), daemon=True)
    reader.start()
    reader.join(0.05)
    assert reader.is_alive()
    assert inbox.get_all()[0].data == b"a"
    reader.join(10.0)
    assert not reader.is_alive()
    blocked = threading.Thread(target=inbox.put, args=(Chunk(3, b"c"),), daemon=True)
    blocked.start()
    inbox.release_reader()
    blocked.join(10.0)
    assert not blocked.is_alive()


def test_a_port_at_its_fastest_is_read_for_half_an_hour_while_nobody_decodes():
    inbox = ReadQueue(LIVE_ROOM)
    reads = [Chunk(number, bytes(1900)) for number in range(50 * 1800)]  # 6.66 kHz, six axes
    reader = threading.Thread(target=lambda: [inbox.put(read) for read in reads], daemon=True)
    reader.start()
    reader.join(30.0)
    assert not reader.is_alive()


def test_the_rows_about_an_event_are_searched_when_it_has_settled():
    taken = Analyser()
    taken.feed(StreamInfo(("gx",), (0.004375,), nominal_hz=RATE))
    counts = np.random.default_rng(3).normal(0.0, 10.0, int(500 * RATE))
    counts[int(380 * RATE) :] += 12.0
    block = Block(0, np.rint(counts).astype(np.int16)[:, np.newaxis], Ticks.none())
    taken.feed(block)
    told = []
    process = LoopProcess(first_s=1e6, report=told.append)
    process.offer(taken.frozen())
    finished(process)
    assert process.trouble == ""
    assert len(told) == 1
    assert told[0].startswith("search about the event at 6 min 20 s")
    assert "step" in told[0] or "level" in told[0]
    process.offer(taken.frozen())
    assert len(told) == 1
