"""Formats without numbers: losses told by time stamps, and proven to the sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from allanscope.clock import Clock
from allanscope.samples import AXES, Block, Event, Gap, Notice, StreamInfo, Ticks
from allanscope.wire import LinkStats, WireSettings, format_named
from allanscope.wire.continuity import PeriodTracker, losses_of
from allanscope.wire.row_events import RowEvents
from allanscope.wire.rows import Interpretation, Row
from allanscope.wire.timestamps import WrappingCounter, comb_of, period_of, resolution_of

RATE = 50.0
INFO = StreamInfo(AXES, (70e-3,) * 3 + (0.061e-3,) * 3, RATE)
SAMPLES = 300


def _stream(name: str) -> tuple[bytes, int]:
    """Return a stream and where its first sample starts."""
    counts = np.random.default_rng(1).normal(0.0, 30.0, (SAMPLES, 6)).astype(np.int16)
    encoder = format_named(name).encoder()
    head = encoder.describe(INFO)
    times = Ticks(np.array([0]), np.array([100.0]), np.array([np.nan]), np.array([21.0]))
    return head + encoder.encode(Block(0, counts, times)), len(head)


STREAMS = {name: _stream(name) for name in ("datalog", "tmsg", "text")}


def _span(events: list[Event]) -> int:
    """Count the samples put in from the first delivered one to the last, by their time."""
    times = np.concatenate([e.ticks.device_s for e in events if isinstance(e, Block)])
    return round(float(times[-1] - times[0]) * RATE) + 1


@pytest.mark.parametrize("name", STREAMS)
@settings(max_examples=60, deadline=None)
@given(
    faults=st.lists(
        st.tuples(
            st.sampled_from(["flip", "drop", "insert", "lose"]),
            st.integers(0, 1 << 30),
            st.integers(0, 255),
            st.sampled_from([1, 7, 64, 300]),
        ),
        max_size=4,
    )
)
def test_damage_is_accounted_to_the_sample(
    name: str, faults: list[tuple[str, int, int, int]], accounted: Callable[..., None]
) -> None:
    data, first = STREAMS[name]
    stream = bytearray(data)
    # One fault in each quarter: what two of them at one place do to a stamp, nothing can tell.
    quarter = (len(stream) - first) // 4
    for number, (fault, where, byte, size) in reversed(list(enumerate(faults))):
        place = first + number * quarter + where % (quarter // 2)
        if fault == "flip":
            stream[place] ^= 1 << (byte % 8)
        elif fault == "drop":
            del stream[place]
        elif fault == "insert":
            stream.insert(place, byte)
        else:
            del stream[place : place + size]
    decoder = format_named(name).decoder(WireSettings())
    events = decoder.feed(bytes(stream), 0.0) + decoder.finish()
    accounted(decoder, events, _span(events))
    assert decoder.stats.unknown_losses == 0
    assert decoder.stats.samples >= SAMPLES - 10 * len(faults) - 5


@pytest.mark.parametrize("name", STREAMS)
def test_damage_on_the_way_is_told_from_samples_never_sent(name: str) -> None:
    data, first = STREAMS[name]
    middle = (len(data) + first) // 2
    damaged = data[:middle] + b"\x07" + data[middle + 1 :]
    events = format_named(name).decoder(WireSettings()).feed(damaged, 0.0)
    assert [e.reason for e in events if isinstance(e, Gap)] == ["link"]
    encoder = format_named(name).encoder()
    encoder.describe(INFO)
    counts = np.zeros((60, 6), np.int16)
    jump = encoder.describe(INFO) + encoder.encode(Block(0, counts, Ticks.none()))
    jump += encoder.encode(Block(62, counts, Ticks.none()))
    events = format_named(name).decoder(WireSettings()).feed(jump, 0.0)
    assert [e for e in events if isinstance(e, Gap)] == [Gap("device", 2)]


@pytest.mark.parametrize("name", STREAMS)
def test_a_clock_that_goes_back_is_a_restart(name: str) -> None:
    data, _ = STREAMS[name]
    decoder = format_named(name).decoder(WireSettings())
    encoder = format_named(name).encoder()
    encoder.describe(INFO)
    again = encoder.encode(Block(0, np.zeros((60, 6), np.int16), Ticks.none()))
    events = decoder.feed(data + again, 0.0) + decoder.finish()
    assert [e for e in events if isinstance(e, Gap)] == [Gap("restarted", None)]
    assert decoder.stats.samples == SAMPLES + 60


@pytest.mark.parametrize("name", STREAMS)
def test_a_hole_too_long_to_count_has_no_number(name: str) -> None:
    encoder = format_named(name).encoder()
    counts = np.zeros((60, 6), np.int16)
    data = encoder.describe(INFO) + encoder.encode(Block(0, counts, Ticks.none()))
    data += encoder.encode(Block(10_000, counts, Ticks.none()))
    decoder = format_named(name).decoder(WireSettings())
    events = decoder.feed(data, 0.0) + decoder.finish()
    assert [e for e in events if isinstance(e, Gap)] == [Gap("device", None)]
    assert decoder.stats.unknown_losses == 1


def _updated(tracker: PeriodTracker, times: NDArray[np.float64]) -> list[Any]:
    found: list[Any] = []
    for time in times:
        found.append(tracker.missing(time))
        tracker.update(time, found[-1])
    return found


@pytest.mark.parametrize("jitter", [0.0, 0.3, 0.6])
def test_late_stamps_are_not_taken_for_losses(jitter: float) -> None:
    """A polling loop reads each sample up to `jitter` periods late."""
    generator = np.random.default_rng(2)
    true = 0.0096 * np.arange(5000) * 1.03
    kept = np.delete(true, [700, 701, 1500, 3000, 3001, 3002])
    stamps = kept + generator.uniform(0.0, jitter * 0.0096, len(kept))
    tracker = PeriodTracker(period_of(stamps[:25].tolist()) or 0.0)
    found = [n for n in _updated(tracker, stamps) if n != 0]
    assert sum(found) == 6
    if jitter < 0.5:
        assert found == [2, 1, 3]


def test_the_longer_a_stream_has_run_the_longer_a_hole_can_be_counted() -> None:
    times = 0.01 * np.arange(4000)
    assert _updated(PeriodTracker(0.01), np.append(times[:100], 1.0 + 0.2))[-1] == 20
    assert _updated(PeriodTracker(0.01), np.append(times[:100], 1.0 + 0.4))[-1] is None
    assert _updated(PeriodTracker(0.01), np.append(times, 40.0 + 9.0))[-1] == 900


def test_what_was_learnt_of_the_period_outlives_a_restart() -> None:
    times = 0.01 * np.arange(4000)
    again = np.concatenate([times, times[:30], [0.3 + 5.0]])
    assert _updated(PeriodTracker(0.0101), again)[-1] == 500


def test_a_frozen_clock_does_no_harm() -> None:
    tracker = PeriodTracker(0.01)
    assert set(_updated(tracker, np.zeros(10_000))) == {0}
    assert tracker.missing(1e12) is None


@pytest.mark.parametrize(
    ("times", "period"),
    [
        ([0.0, 0.02, 0.04, 0.06, 0.08, 0.1], 0.02),
        ([0.0, 0.02, 0.04, 0.3, 0.32, 0.34, 0.36], 0.02),
        ([0.0, 0.02], None),
        ([0.0, float("nan"), 0.04, 0.06, 0.08, 0.1], None),
        ([0.0] * 20, None),
        ([0.0, 0.0, 0.0, 0.04] * 4, None),
        ([1.0, 0.9, 0.8, 0.7, 0.6, 0.5], None),
    ],
)
def test_a_period_is_found_where_there_is_one(times: list[float], period: float | None) -> None:
    assert period_of(times) == period


def test_coarse_stamps_have_the_right_mean_period() -> None:
    times = np.floor(np.arange(200) * 0.96) / 100
    assert period_of(times.tolist()) == pytest.approx(0.0096, rel=0.01)
    assert resolution_of(times.tolist()) == 0.01


def test_a_stamp_wraps_and_goes_negative() -> None:
    stamps = WrappingCounter(1 << 32, 1000.0)
    raw = [2**31 - 20, 2**31 - 1 - 2**32 + 1, -(2**31) + 20, -20, 0, 20]
    seconds = [stamps.seconds(number) for number in raw]
    assert np.all(np.diff(seconds) > 0)
    assert seconds[-1] == pytest.approx((2**32 + 20) / 1000.0)


def test_a_clock_of_the_day_goes_on_after_midnight() -> None:
    stamps = WrappingCounter(8_640_000, 100.0)
    assert stamps.seconds(8_639_999) == 86_399.99
    assert stamps.seconds(1) == pytest.approx(86_400.01)


def _limited(rows: list[Row]) -> Interpretation:
    """Rows below ten mean one thing, rows below a hundred another."""
    limit = 10.0 if rows[0].values[0] < 10.0 else 100.0
    return Interpretation(
        StreamInfo(("gx",), (limit,)), lambda v: (v.astype(np.int32), v[:, 0] < limit)
    )


def test_a_meaning_that_no_longer_fits_is_replaced() -> None:
    stats = LinkStats()
    rows = RowEvents(stats, _limited)
    for i in range(60):
        rows.add((5.0 if i < 30 else 50.0,), 0.01 * i, 0.0)
    events = rows.events(final=True)
    assert [type(e) for e in events] == [StreamInfo, Block, StreamInfo, Gap, Block]
    assert events[3] == Gap("restarted", None)
    assert [len(e) for e in events if isinstance(e, Block)] == [30, 25]
    assert stats.resyncs == 5


def test_a_row_that_does_not_fit_is_damaged_and_lost() -> None:
    stats = LinkStats()
    rows = RowEvents(stats, _limited)
    for i in range(5000):
        rows.add((50.0 if i % 1500 == 700 else 5.0,), 0.01 * i, 0.0)
    events = rows.events(final=True)
    assert [e for e in events if isinstance(e, Gap)] == 3 * [Gap("link", 1)]
    assert stats.samples == 4997


def test_rows_that_mean_nothing_are_counted_and_dropped() -> None:
    stats = LinkStats()
    rows = RowEvents(stats, lambda _: None)
    for i in range(60):
        rows.add((1.0,), 0.01 * i, 0.0)
    assert rows.events(final=True) == []
    assert stats.unknown == 60


def test_the_first_rows_are_held_back_until_it_is_clear_what_they_mean() -> None:
    decoder = format_named("tmsg").decoder(WireSettings())
    data, _ = STREAMS["tmsg"]
    messages = [message + b"\xf0" for message in data.split(b"\xf0")[:30]]
    counts = [decoder.stats.samples for m in messages if decoder.feed(m, 0.0) is not None]
    assert counts[23] == 0
    assert counts[24] == 25
    assert counts[-1] == 30


def _stamped(loss: float, double: float, seed: int) -> tuple[bytes, int, int]:
    """Rows at 100 Hz stamped by a host, 2 ms rms; how many samples were lost, how many doubled."""
    rng = np.random.default_rng(seed)
    kept = np.flatnonzero(rng.random(20_000) >= loss)
    row = np.repeat(kept, 1 + (rng.random(len(kept)) < double))
    values = rng.normal(0.0, 0.05, 20_000)[row]
    times = 0.01 * row + rng.normal(0.0, 0.002, len(row))
    text = "".join(f"{t:.3f},{v:.6f}\n" for t, v in zip(times, values, strict=True))
    span = int(kept[-1] - kept[0]) + 1
    return b"t[s],gz[dps]\n" + text.encode(), span - len(kept), len(row) - len(kept)


@pytest.mark.parametrize(("loss", "double"), [(0.0, 0.0), (0.03, 0.0), (0.03, 0.01), (0.1, 0.01)])
def test_losses_are_counted_where_stamps_scatter(loss: float, double: float) -> None:
    """Within 6 % of all, at the right rate; before, 16 % were counted where 3 % were lost."""
    data, lost, doubled = _stamped(loss, double, 5)
    decoder = format_named("text").decoder(WireSettings())
    info, *events = decoder.feed(data, float("nan")) + decoder.finish()
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == pytest.approx(100.0, rel=2e-4)
    assert decoder.stats.lost_samples == pytest.approx(lost, rel=0.06, abs=2)
    assert decoder.stats.unknown_losses == 0
    left_out = data.count(b"\n") - 1 - decoder.stats.samples
    assert left_out == pytest.approx(doubled, rel=0.3 if loss < 0.1 else 0.6, abs=2)
    counted = [e for e in events if isinstance(e, Block)][-1]
    span = counted.index + len(counted) - 1
    last = float(counted.ticks.device_s[-1])
    assert span / last == pytest.approx(100.0, rel=1e-3)


def test_bursts_with_one_stamp_each_are_no_gaps() -> None:
    """Eight rows at a time under one stamp, some lost: 7400 gaps of unknown length before."""
    rng = np.random.default_rng(7)
    kept = np.flatnonzero(rng.random(20_000) >= 0.03)
    ends = np.minimum(np.arange(len(kept)) // 8 * 8 + 7, len(kept) - 1)
    stamps = 0.01 * kept[ends]
    rows = "".join(
        f"{t:.3f},{v:.6f}\n" for t, v in zip(stamps, rng.normal(size=len(kept)), strict=True)
    )
    decoder = format_named("text").decoder(WireSettings())
    events = decoder.feed(f"t[s],gz[dps]\n{rows}".encode(), float("nan")) + decoder.finish()
    assert not [event for event in events if isinstance(event, Gap)]
    assert any("single lost samples do not show" in e.text for e in events if isinstance(e, Notice))


def test_losses_are_counted_in_arrays_where_stamps_scatter() -> None:
    rng = np.random.default_rng(6)
    kept = np.flatnonzero(rng.random(20_000) >= 0.03)
    times = 0.01 * kept + rng.normal(0.0, 0.002, len(kept))
    lost = losses_of(times)
    assert lost is not None
    assert sum(lost.values()) == pytest.approx(20_000 - len(kept), abs=5)
    assert losses_of(0.01 * kept) is None


def test_the_comb_of_rough_stamps_is_looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is a tenth of a second, in which a live stream waits."""
    rng = np.random.default_rng(1)
    kept = np.flatnonzero(rng.random(1000) > 0.1)
    times = (0.01 * kept + rng.normal(0.0, 0.002, len(kept))).tolist()
    looked = []

    def counted(stamps: Any) -> Any:
        looked.append(len(stamps))
        return comb_of(stamps)

    monkeypatch.setattr("allanscope.wire.continuity.comb_of", counted)
    monkeypatch.setattr("allanscope.wire.timestamps.comb_of", counted)
    tracker = PeriodTracker.of(times, 0.0)
    assert tracker is not None
    assert tracker.lookahead > 4, "the scatter of the comb decides"
    assert looked == [len(times)]


def _loop(name: str, n: int = 6000) -> NDArray[np.float64]:
    """Return the steps in s of a loop that polls a sensor, prints, and begins anew."""
    rng = np.random.default_rng(7)
    polls = np.cumsum(rng.normal(0.016, 0.002, n))
    steps = {
        "a USB that is polled": np.diff(polls[np.searchsorted(polls, np.arange(n) / 104.0)]),
        "alternating": np.where(np.arange(n) % 2, 0.012, 0.020) + rng.normal(0.0, 1e-3, n),
        "anything between": rng.uniform(0.012, 0.020, n),
        "now and then longer": np.where(rng.random(n) < 0.1, 0.020, 0.012),
        "every fourth longer": np.where(np.arange(n) % 4, 0.012, 0.020),
        "every tenth much longer": np.where(np.arange(n) % 10, 0.010, 0.035),
        "prints": 0.0105 + rng.lognormal(np.log(0.002), 0.8, n),
        "slower and slower": np.linspace(0.012, 0.020, n) + rng.normal(0.0, 5e-4, n),
    }
    return steps[name]


def _read(times: NDArray[np.float64], header: str = "time [s]") -> tuple[list[Event], StreamInfo]:
    rows = "".join(f"{time:.6f},{i % 7 - 3}.5\n" for i, time in enumerate(times.tolist()))
    decoder = format_named("text").decoder(WireSettings())
    events = decoder.feed(f"{header},gx [dps]\n{rows}".encode(), np.nan) + decoder.finish()
    return events, next(event for event in events if isinstance(event, StreamInfo))


@pytest.mark.parametrize(
    "name",
    [
        *("alternating", "anything between", "now and then longer", "every fourth longer"),
        *("every tenth much longer", "prints", "slower and slower", "a USB that is polled"),
    ],
)
def test_a_polling_loop_loses_nothing_however_long_it_takes(name: str) -> None:
    times = np.cumsum(_loop(name))
    events, info = _read(times)
    assert [event for event in events if isinstance(event, Gap)] == []
    assert sum(len(event) for event in events if isinstance(event, Block)) == len(times)
    clock = Clock.of(info)
    for event in events:
        if isinstance(event, Block):
            clock.update(event.index, event.ticks)
    # Where the period itself wanders the line through early rows is not that from end to end.
    within = 0.02 if name == "slower and slower" else 0.01
    assert clock.rate().hz == pytest.approx((len(times) - 1) / np.ptp(times), rel=within)


def test_stamps_that_come_late_in_a_rush_are_no_losses() -> None:
    rng = np.random.default_rng(5)
    events, info = _read(np.sort(0.01 * np.arange(6000) + rng.exponential(0.007, 6000)))
    assert [event for event in events if isinstance(event, Gap)] == []
    assert info.nominal_hz == pytest.approx(100.0, rel=0.01)


def test_names_of_clocks_tell_the_unit() -> None:
    for header, unit in (("millis", 1e3), ("micros", 1e6), ("SampleTimeFine", 1e4)):
        _, info = _read(0.01 * unit * np.arange(200), header)
        assert info.nominal_hz == pytest.approx(100.0)
