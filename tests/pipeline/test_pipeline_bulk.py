"""A recording in megabytes on two cores gives what the same reads gave one by one, bit for bit."""

import json
from contextlib import closing
from dataclasses import asdict
from functools import cache

import numpy as np
import pytest

from allanscope.analysis import Analyser, AnalyserSettings, summarise
from allanscope.pipeline import Decoding
from allanscope.pipeline.replaying import feed_analyser, joined
from allanscope.recording import Chunk, Fingerprint, Recording, SessionWriter
from allanscope.samples import Block, Gap, Notice, Ticks
from allanscope.simulator import Simulator, simulate_blocks
from allanscope.wire import WireSettings

SECONDS = 20.0


@cache
def reads(wire, rate):
    """Return what a host reads from the simulated device in some seconds."""
    sensor = Simulator(rate=rate, seed=5, duration_s=SECONDS)
    made = simulate_blocks(SECONDS / 3600, sensor, wire, start_ns=1)
    return tuple(Chunk(host_ns, data) for host_ns, data in made)


def damaged(chunks, rng):
    """Lose reads, turn bits, unplug once, and leave a hole where the disk was full."""
    out = []
    for number, chunk in enumerate(chunks):
        data = bytearray(chunk.data)
        if number > 20 and rng.random() < 0.01:
            continue
        if number > 20 and data and rng.random() < 0.02:
            data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        if number == len(chunks) // 3:
            out += [
                Chunk(chunk.host_ns, event="disconnected"),
                Chunk(chunk.host_ns, event="reconnected"),
            ]
        out.append(Chunk(chunk.host_ns, bytes(data)))
    return out


def written(folder, chunks, max_bytes=float("inf")):
    """Write a session, over several files when these are to be small."""
    folder.mkdir()
    with closing(SessionWriter(folder, {}, max_bytes=max_bytes, max_seconds=1e9)) as writer:
        for number, chunk in enumerate(chunks):
            if number == len(chunks) // 2:
                writer.missed(3)
            writer.chunk(chunk)
            writer.commit()
    return folder


def one_by_one(folder, settings):
    """Take every read by itself."""
    decoding, analyser = Decoding(WireSettings()), Analyser(settings)
    for chunk in Recording(folder).chunks():
        for event in decoding.feed(chunk):
            analyser.feed(event)
    for event in decoding.finish():
        analyser.feed(event)
    return decoding, analyser


def in_bulk(folder, settings):
    """Take everything in megabytes."""
    decoding, analyser = Decoding(WireSettings()), Analyser(settings)
    return decoding, feed_analyser(folder, decoding, analyser, quiet=True)


def sums(analyser):
    """Return everything that an analyser has summed up, as plain arrays and numbers."""
    found = []
    for state in analyser.configurations:
        state.settle()
        history = state.history.record(1.0, state.info.axes, state.info.scale)
        held = {**state.bank.state(), **state.spectrum.state(), **asdict(history)}
        held |= {"rate": asdict(state.clock.rate()), "temperature": state.temperature.summary()}
        for name in ("samples", "lost", "unknown_losses", "segments", "counted"):
            held[name] = getattr(state, name)
        held |= {"low": state.lowest, "high": state.highest, "full": state.saturated}
        found.append({name: _plain(value) for name, value in held.items()})
    return found


def _plain(value):
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    return repr(value)


@pytest.mark.parametrize(
    ("wire", "rate"),
    [("native", 6660.0), ("native", 104.0), ("datalog", 104.0), ("tmsg", 104.0), ("text", 416.0)],
)
def test_a_sound_recording_gives_the_same_in_bulk(wire, rate, tmp_path):
    folder = written(tmp_path / "session", reads(wire, rate))
    settings = AnalyserSettings(history_rows=1 << 10, buffered_rows=1 << 9)
    (slow, expected), (fast, found) = one_by_one(folder, settings), in_bulk(folder, settings)
    assert expected.state.samples > 1500
    assert sums(found) == sums(expected)
    assert fast.stats == slow.stats
    assert fast.wire == slow.wire == wire


@pytest.mark.parametrize(("wire", "rate"), [("native", 1666.0), ("tmsg", 104.0), ("text", 104.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_damaged_recording_in_several_files_gives_the_same_in_bulk(wire, rate, seed, tmp_path):
    chunks = damaged(reads(wire, rate), np.random.default_rng(seed))
    folder = written(tmp_path / "session", chunks, max_bytes=1 << 14)
    assert len(Recording(folder).files) > 2
    settings = AnalyserSettings(history_rows=1 << 10)
    (slow, expected), (fast, found) = one_by_one(folder, settings), in_bulk(folder, settings)
    assert expected.state.segments > 5
    assert sums(found) == sums(expected)
    assert fast.stats == slow.stats
    assert (found.errors, found.marks) == (expected.errors, expected.marks)


def test_how_many_rows_are_gathered_changes_no_bit_of_the_result(tmp_path):
    folder = written(tmp_path / "session", reads("native", 6660.0))
    results = []
    for rows in (1, 100, 1 << 13, 1 << 17):
        decoding, analyser = in_bulk(folder, AnalyserSettings(buffered_rows=rows))
        analysis = summarise(analyser, decoding.stats, "live", {})
        results.append(json.dumps(analysis.to_dict()))
    assert len(set(results)) == 1


def test_buffers_of_any_size_give_the_same_events(tmp_path):
    folder = written(
        tmp_path / "session", damaged(reads("native", 416.0), np.random.default_rng(3))
    )
    seen = []
    for size in (1, 999, 1 << 22):
        decoding, analyser = Decoding(WireSettings()), Analyser()
        for buffer in Recording(folder).buffers(size):
            for event in decoding.feed_buffer(buffer):
                analyser.feed(event)
        seen.append(sums(analyser))
    assert seen[0] == seen[1] == seen[2]


def test_a_look_in_between_changes_nothing(tmp_path):
    """A refresh sums up a copy of what has been gathered; the run itself goes on untouched."""
    folder = written(tmp_path / "session", reads("native", 416.0))
    settings = AnalyserSettings(history_rows=1 << 10)
    _, undisturbed = one_by_one(folder, settings)
    decoding, analyser = Decoding(WireSettings()), Analyser(settings)
    for number, chunk in enumerate(Recording(folder).chunks()):
        for event in decoding.feed(chunk):
            analyser.feed(event)
        if number % 200 == 199:
            summarise(analyser.frozen(), decoding.stats, "live", {})
    assert sums(analyser) == sums(undisturbed)


def test_the_fingerprint_does_not_depend_on_the_pieces(tmp_path):
    folder = written(tmp_path / "session", reads("native", 104.0), max_bytes=1 << 14)
    expected = Recording(folder).sha256()
    for size in (1, 5000):
        fingerprint = Fingerprint()
        for buffer in Recording(folder).buffers(size):
            fingerprint.add(buffer)
        assert fingerprint.hexdigest() == expected


def block(index, rows, kind=np.int16):
    """Return a Block whose samples and times are their numbers, with a tick at every second."""
    number = np.arange(index, index + rows)
    offset = np.arange(0, rows, 2)
    return Block(
        index,
        number[:, np.newaxis].astype(kind),
        Ticks(offset, *np.tile(number[offset] / 1.0, (3, 1))),
    )


def test_blocks_about_a_status_are_joined_with_their_ticks():
    status = Notice("status", "sent 3")
    first, whole = joined([block(0, 3), status, block(3, 4), block(7, 1)], rows=8)
    assert first is status
    assert whole.index == 0
    assert whole.counts.ravel().tolist() == list(range(8))
    assert whole.ticks.offset.tolist() == [0, 2, 3, 5, 7]
    assert whole.ticks.host_s.tolist() == whole.ticks.device_s.tolist() == [0, 2, 3, 5, 7]


def test_nothing_is_joined_across_a_gap_a_mark_or_another_type():
    apart = [Gap("link", 2), Notice("mark", "lid opened")]
    for between in apart:
        events = [block(0, 3), between, block(5, 3)]
        found = list(joined(events, rows=100))
        assert [type(one) for one in found] == [Block, type(between), Block]
    found = list(joined([block(0, 3), block(3, 3, np.float64)], rows=100))
    assert [one.counts.dtype for one in found] == [np.int16, np.float64]


def test_joined_blocks_are_no_longer_than_asked_for_and_one_block_more():
    found = list(joined([block(4 * i, 4) for i in range(5)], rows=8))
    assert [len(one) for one in found] == [8, 8, 4]
