"""Cost in counted operations: calls, terms, transforms and bytes, which no machine can change."""

import copy
import threading
from collections import Counter

import numpy as np
import pytest

from allanscope.allan import AllanBank
from allanscope.analysis import Analyser, AnalyserSettings, StreamState, summarise, summary
from allanscope.analysis.row_buffer import WORTH_IT, BackgroundTask, RowBuffer
from allanscope.noise import fit_noise
from allanscope.pipeline import Decoding
from allanscope.recording import Chunk, Recording, write_recording
from allanscope.samples import Block, StreamInfo, Ticks
from allanscope.simulator import Simulator, simulate_blocks
from allanscope.spectrum import SEGMENT, SpectrumBank
from allanscope.wire import LinkStats, WireSettings
from allanscope.wire.native import NativeDecoder

ROOM = 1000


def counts(n, axes=1):
    return np.random.default_rng(1).normal(0, 12, (n, axes)).round().astype(np.int16)


def test_three_rows_at_a_time_reach_the_sums_by_the_roomful(monkeypatch):
    """A live port must not pay for every read what a thousand rows cost."""
    calls = Counter()
    for bank in (AllanBank, SpectrumBank):
        plain = bank.update

        def counted(self, rows, plain=plain, name=bank.__name__):
            calls[name] += 1
            plain(self, rows)

        monkeypatch.setattr(bank, "update", counted)
    analyser = Analyser(AnalyserSettings(buffered_rows=ROOM))
    analyser.feed(StreamInfo(("gx",), (1.0,), nominal_hz=104.0))
    rows = counts(9000)
    for index in range(0, len(rows), 3):
        analyser.feed(Block(index, rows[index : index + 3], Ticks.none()))
    roomfuls = -(-len(rows) // (ROOM // 3 * 3)) - 1  # the last one is still waiting
    assert calls == {"AllanBank": roomfuls, "SpectrumBank": roomfuls}


def test_large_blocks_pass_by_without_a_copy(monkeypatch):
    seen = []
    monkeypatch.setattr(AllanBank, "update", lambda self, rows: seen.append(rows))
    analyser = Analyser(AnalyserSettings(buffered_rows=ROOM))
    analyser.feed(StreamInfo(("gx",), (1.0,), nominal_hz=104.0))
    rows = counts(ROOM)
    analyser.feed(Block(0, rows, Ticks.none()))
    assert len(seen) == 1
    assert seen[0] is rows


def test_terms_per_sample_do_not_grow_with_the_length_of_the_run():
    """Rung 0 costs its 19 averaging times, all rungs above it together no more than four."""
    per_sample = {}
    for n in (1000, 10_000, 100_000, 1_000_000):
        bank = AllanBank(100.0, axes=1)
        bank.update(counts(n))
        per_sample[n] = bank.deviation("oadev").terms.sum() / n
    assert per_sample[1_000_000] < 28
    assert per_sample[1_000_000] < 1.02 * per_sample[100_000]
    assert per_sample[100_000] < 1.10 * per_sample[10_000]


@pytest.mark.parametrize("per_octave", [1, 2, 4, 8])
def test_terms_grow_at_most_in_proportion_to_the_averaging_times(per_octave):
    bank, plain = AllanBank(100.0, axes=1, per_octave=per_octave), AllanBank(100.0, 1, 1)
    for one in (bank, plain):
        one.update(counts(100_000))
    ratio = bank.deviation("oadev").terms.sum() / plain.deviation("oadev").terms.sum()
    assert ratio <= per_octave


def test_transforms_per_sample_do_not_grow_with_the_length_of_the_run():
    """Half-overlapping segments twice, and all lower rates together a third of that."""
    for n in (20_000, 200_000, 2_000_000):
        bank = SpectrumBank(100.0, axes=1)
        bank.update(counts(n))
        segments = int(np.sum(bank.state()["count"]))
        assert segments * SEGMENT / n < 2 * 4 / 3


def test_what_is_held_does_not_grow_with_the_length_of_the_run():
    held = {}
    for n in (200_000, 2_000_000):
        analyser = Analyser(AnalyserSettings(history_rows=1 << 14))
        analyser.feed(StreamInfo(("gx",), (1.0,), nominal_hz=6660.0))
        rows = counts(100_000)
        for index in range(0, n, len(rows)):
            analyser.feed(Block(index, rows, Ticks.none()))
        state = analyser.state
        spectrum = sum(array.nbytes for array in state.spectrum.state().values())
        held[n] = state.bank.nbytes + spectrum + len(state.history.means()) * 32
    assert held[2_000_000] < 1.5 * held[200_000]
    assert held[2_000_000] < 4 << 20, "half of it for the deviation over time"


def test_a_recording_is_decoded_by_the_buffer_and_not_by_the_read(tmp_path, monkeypatch):
    sensor = Simulator(rate=6660.0, seed=1, duration_s=10.0)
    reads = [Chunk(*read) for read in simulate_blocks(10 / 3600, sensor, start_ns=1)]
    path = write_recording(tmp_path / "session.mcap", reads, {})
    calls = Counter()
    plain = NativeDecoder.feed_chunks

    def counted(self, *arguments):
        calls["feed"] += 1
        return plain(self, *arguments)

    monkeypatch.setattr(NativeDecoder, "feed_chunks", counted)
    decoding = Decoding(WireSettings(), "native")
    buffers = list(Recording(path).buffers())
    for buffer in buffers:
        decoding.feed_buffer(buffer)
    assert len(reads) > 200
    assert calls["feed"] == len(buffers) == 1


def test_a_second_thread_is_used_for_large_pieces_only():
    def thread_of(rows):
        names, behind = [], BackgroundTask()
        behind.do(rows, lambda: names.append(threading.current_thread().name))
        behind.wait()
        return names[0]

    assert thread_of(10) == threading.current_thread().name
    assert thread_of(WORTH_IT).startswith("sums")


def test_work_that_lags_behind_is_done_in_order_and_its_error_is_raised():
    behind, order = BackgroundTask(), []
    may_end = threading.Event()

    def first():
        may_end.wait(30)
        order.append("first")

    behind.do(WORTH_IT, first)
    assert order == []
    may_end.set()
    behind.do(1, lambda: order.append("second"))
    assert order == ["first", "second"]

    def fails():
        raise ValueError("broken")

    behind.do(WORTH_IT, fails)
    with pytest.raises(ValueError, match="broken"):
        behind.wait()
    behind.wait()  # once


def test_a_copy_of_sums_that_lag_behind_has_all_samples():
    state = StreamState(StreamInfo(("gx",), (0.01,), nominal_hz=6660.0), 4, 1 << 12)
    rows = np.random.default_rng(3).integers(-99, 99, (3 * WORTH_IT, 1)).astype(np.int16)
    kept_from_me = rows[: 2 * WORTH_IT]
    state.block(Block(0, kept_from_me, Ticks.none()))
    copied = copy.deepcopy(state)
    copied.settle()
    state.settle()
    for one in (state, copied):
        assert one.bank.samples == one.spectrum.samples == 2 * WORTH_IT
    expected = AllanBank(6660.0, axes=1)
    expected.update(kept_from_me)
    for one in (state, copied):
        found = one.bank.deviation("oadev").deviation
        assert found.tobytes() == expected.deviation("oadev").deviation.tobytes()


def test_rows_that_another_thread_works_on_are_not_written_over():
    buffer = RowBuffer(size=2 * WORTH_IT)
    rows = np.arange(WORTH_IT - 1, dtype=np.int16)[:, np.newaxis]
    yielded = [piece for _ in range(5) for piece in buffer.feed(rows, None)]
    assert len(yielded) == 2
    for counts, _ in yielded:
        assert len(counts) == 2 * len(rows)
        np.testing.assert_array_equal(counts, np.tile(rows, (2, 1)))


def test_a_refresh_fits_to_fewer_rows_and_finds_the_same_noise(monkeypatch):
    """Two minutes at 6.66 kHz are 2^18 rows, of which eight make one: N is the same within 1 %."""
    analyser = Analyser()
    analyser.feed(StreamInfo(("gx",), (0.01,), nominal_hz=6660.0))
    rng = np.random.default_rng(7)
    walk = np.cumsum(0.002 * rng.normal(size=1 << 18))
    rows = np.rint(12 * rng.normal(size=1 << 18) + walk).astype(np.int16)
    analyser.feed(Block(0, rows[:, np.newaxis], Ticks.none()))
    fitted = []

    def counted(record, *given, **named):
        fitted.append(len(record.values))
        return fit_noise(record, *given, **named)

    monkeypatch.setattr(summary, "fit_noise", counted)
    few = summarise(analyser, LinkStats(), "live", {}).axes["gx"].coefficients["N"]
    monkeypatch.setattr(summary, "LIVE_ROWS", 1 << 18)
    all_of_them = summarise(analyser, LinkStats(), "live", {}).axes["gx"].coefficients["N"]
    assert fitted == [1 << 15, 1 << 18]
    assert few.value == pytest.approx(all_of_them.value, rel=0.01)
    truth = 12 * 0.01 / 6660.0**0.5
    assert few.lower < truth < few.upper
