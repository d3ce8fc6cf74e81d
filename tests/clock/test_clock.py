"""The clock under everything that a night brings: stalls, steps, gaps, restarts, two clocks."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from allanscope.clock import Clock
from allanscope.samples import Gap, StreamInfo, Ticks
from support.clocked_stream import Stream, stream


def error_ppm(clock: Clock, true_hz: float) -> float:
    return (clock.rate().hz / true_hz - 1.0) * 1e6


def changed(one: Stream, **fields: np.ndarray) -> Stream:
    return Stream(
        one.true_hz,
        fields.get("index", one.index),
        one.taken_s,
        fields.get("host_s", one.host_s),
    )


def test_until_enough_is_known_the_nominal_rate_is_given_and_named() -> None:
    clock = Clock(104.0)
    rate = clock.rate()
    assert (rate.hz, rate.source, rate.is_measured) == (104.0, "nominal", False)
    assert rate.clock_error is None
    clock.update(0, Ticks(*(np.zeros(1, t) for t in (np.int64, float, float, float))))
    assert clock.rate().source == "nominal"
    stream(1, 104.0, 5.0).feed(clock := Clock(104.0))
    assert clock.rate().source == "host"


def test_the_error_of_the_oscillator_has_an_interval_that_holds_it() -> None:
    one = stream(3, 6660.0, 60.0, frame=16, off=-0.0444)
    clock = Clock(6660.0)
    one.feed(clock)
    error = clock.rate().clock_error
    assert error is not None
    assert error.lower < -0.0444 < error.upper
    assert error.upper - error.lower < 50e-6
    assert error.lower < error.relative < error.upper


@pytest.mark.parametrize("at_s", [0.0, 100.0, 290.0])
def test_a_stall_and_its_burst_change_nothing(at_s: float) -> None:
    """For five seconds nothing is delivered, then everything at once."""
    one = stream(4, 104.0, 300.0, poll_s=1e-3)
    seen = one.host_s.copy()
    held = (seen >= seen[0] + at_s) & (seen < seen[0] + at_s + 5.0)
    seen[held] = seen[0] + at_s + 5.0
    clock = Clock(104.0)
    changed(one, host_s=np.maximum.accumulate(seen)).feed(clock)
    assert abs(error_ppm(clock, one.true_hz)) < 3.0
    assert clock.rate().uncertainty_ppm < 10.0


def test_a_busy_host_that_is_late_most_of_the_time_changes_little() -> None:
    one = stream(5, 104.0, 300.0)
    source = np.random.default_rng(5)
    late = np.where(source.random(len(one.index)) < 0.9, source.exponential(0.1, len(one.index)), 0)
    clock = Clock(104.0)
    changed(one, host_s=np.maximum.accumulate(one.host_s + late)).feed(clock)
    assert abs(error_ppm(clock, one.true_hz)) < 2.0 * clock.rate().uncertainty_ppm


def test_samples_lost_without_a_word_are_a_step_and_no_rate() -> None:
    """The numbers go on as if nothing had been lost: 400 ms at 100 s, 900 ms at 200 s."""
    one = stream(6, 104.0, 300.0, poll_s=1e-3)
    lost = 0.4 * (one.taken_s > 100.0) + 0.9 * (one.taken_s > 200.0)
    clock = Clock(104.0)
    changed(one, host_s=one.host_s + lost).feed(clock)
    rate = clock.rate()
    assert rate.host is not None
    assert rate.host.steps == 2
    assert abs(error_ppm(clock, one.true_hz)) < 10.0


def test_a_hole_of_unknown_length_breaks_the_line_and_keeps_the_rate() -> None:
    one, other = stream(7, 104.0, 100.0, off=0.03), stream(8, 104.0, 100.0, off=0.03)
    clock = Clock(104.0)
    one.feed(clock)
    clock.gap(Gap("link", None))
    changed(other, host_s=other.host_s + 1234.5, index=other.index + 17).feed(clock)
    assert abs(error_ppm(clock, one.true_hz)) < 5.0


def test_a_hole_of_known_length_joins_both_sides_to_a_longer_line() -> None:
    one = stream(9, 104.0, 1000.0)
    clock, apart = Clock(104.0), Clock(104.0)
    half = len(one.index) // 2
    kept = np.r_[0 : half - 3000, half : len(one.index)]
    pieces = (kept[: half - 3000], kept[half - 3000 :])
    for each, lost in ((clock, 3000), (apart, None)):
        for rows in pieces:
            Stream(one.true_hz, one.index[rows], one.taken_s[rows], one.host_s[rows]).feed(each)
            each.gap(Gap("disconnected", lost))
    assert 900.0 < clock.rate().span_s <= 1000.0
    assert abs(error_ppm(clock, one.true_hz)) < 1.0
    assert abs(error_ppm(apart, one.true_hz)) < 2.0


def test_numbers_that_start_anew_are_a_new_line() -> None:
    one = stream(10, 104.0, 60.0)
    clock = Clock(104.0)
    one.feed(clock)
    clock.gap(Gap("restarted", 12))
    changed(one, host_s=one.host_s + 100.0).feed(clock)
    assert abs(error_ppm(clock, one.true_hz)) < 5.0
    fit = clock.rate().host
    assert fit is not None
    assert fit.steps == 0, "what was announced is no surprise"


def test_a_host_that_was_started_anew_is_a_new_line_by_itself() -> None:
    one = stream(11, 104.0, 60.0)
    clock = Clock(104.0)
    one.feed(clock)
    changed(one, host_s=one.host_s - 50_000.0, index=one.index + 10_000_000).feed(clock)
    assert abs(error_ppm(clock, one.true_hz)) < 5.0


def test_restart_forgets() -> None:
    clock = Clock(104.0)
    stream(12, 104.0, 60.0).feed(clock)
    clock.restart(208.0)
    assert (clock.rate().source, clock.rate().hz) == ("nominal", 208.0)
    one = stream(13, 208.0, 60.0)
    one.feed(clock)
    assert abs(error_ppm(clock, one.true_hz)) < 5.0


def test_with_both_clocks_the_host_is_the_truth_and_the_crystal_is_compared() -> None:
    one = stream(14, 104.0, 600.0, poll_s=1e-3)
    clock = Clock(104.0)
    one.feed(clock, device_s=one.taken_s * (1.0 + 30e-6))
    rate = clock.rate()
    assert rate.source == "host"
    assert rate.device is not None
    assert rate.device_against_host == pytest.approx(30e-6, abs=1e-6)
    assert abs(error_ppm(clock, one.true_hz)) < 1.0


def test_the_sensors_own_time_is_no_clock() -> None:
    one = stream(15, 104.0, 60.0, off=0.05)
    clock = Clock.of(StreamInfo(("gx",), (1.0,), nominal_hz=104.0, device_clock=False))
    one.feed(clock, device_s=one.index / 104.0, host=False)
    assert clock.rate().source == "nominal"
    assert clock.rate().device is None


def test_a_device_time_that_jumps_back_is_a_new_line() -> None:
    one = stream(16, 104.0, 100.0)
    device = one.taken_s - 40.0 * (one.taken_s > 50.0)
    clock = Clock(104.0)
    one.feed(clock, device_s=device, host=False)
    assert abs(error_ppm(clock, one.true_hz)) < 1.0


def test_memory_does_not_grow_with_time_nor_with_gaps() -> None:
    clock = Clock(104.0)
    one = stream(17, 104.0, 20.0)
    sizes = []
    for part in range(60):
        changed(one, host_s=one.host_s + 21.0 * part, index=one.index + 3000 * part).feed(clock)
        clock.gap(Gap("link", None))
        clock.rate()
        sizes.append(len(pickle.dumps(clock)))
    assert max(sizes) < 120_000
    assert max(sizes) - min(sizes) < 2_000
    assert abs(error_ppm(clock, one.true_hz)) < 10.0


def test_a_computer_that_sleeps_is_a_step_and_no_rate() -> None:
    """For an hour its clock stands still and nothing is read; the device numbers on."""
    one = stream(21, 104.0, 600.0, poll_s=1e-3)
    asleep = one.taken_s > 300.0
    clock = Clock(104.0)
    awake = Stream(one.true_hz, one.index[~asleep], one.taken_s[~asleep], one.host_s[~asleep])
    awake.feed(clock)
    clock.gap(Gap("device", 374_400))
    after = Stream(
        one.true_hz, one.index[asleep] + 374_400, one.taken_s[asleep], one.host_s[asleep]
    )
    after.feed(clock)
    rate = clock.rate()
    assert rate.steps == 1
    assert abs(error_ppm(clock, one.true_hz)) < 2.0 * rate.uncertainty_ppm < 20.0


@pytest.mark.parametrize("wave", ["warm-up", "day"])
def test_a_rate_that_follows_the_temperature_is_told_per_degree(wave: str) -> None:
    z = []
    for seed in range(12):
        one = stream(seed, 104.0, 3600.0, frame=4, poll_s=1e-3, off=0.03)
        share = one.taken_s / one.taken_s[-1]
        above = 8.0 * (1.0 - np.exp(-4.0 * share)) if wave == "warm-up" else np.sin(9.0 * share)
        late = -np.cumsum(20e-6 * (above - above.mean())) * 4.0 / one.true_hz
        nothing = np.full(len(one.index), np.nan)
        measured = 25.0 + above + np.random.default_rng(seed).normal(0.0, 0.05, len(above))
        clock = Clock(104.0)
        clock.update(0, Ticks(one.index, nothing, one.host_s + late, measured))
        rate = clock.rate()
        z.append((rate.ppm_per_degc - 20.0) / rate.ppm_per_degc_uncertainty)
        assert rate.ppm_per_degc_uncertainty < 4.0
    assert np.mean(np.abs(z) < 2.0) >= 0.9


def test_a_temperature_that_hardly_moves_explains_nothing() -> None:
    one = stream(22, 104.0, 300.0)
    nothing = np.full(len(one.index), np.nan)
    for spread in (0.0, 0.2):
        clock = Clock(104.0)
        degrees = 25.0 + spread * np.sin(one.taken_s)
        clock.update(0, Ticks(one.index, nothing, one.host_s, degrees))
        assert np.isnan(clock.rate().ppm_per_degc)


def test_thousands_of_tiny_segments_do_no_harm() -> None:
    clock = Clock(104.0)
    one = stream(18, 104.0, 300.0)
    one.feed(clock)
    for part in range(3000):
        at = np.array([0, 5], np.int64)
        nothing = np.full(2, np.nan)
        clock.update(part * 10, Ticks(at, nothing, 1e6 + part + at / one.true_hz, nothing))
        clock.gap(Gap("link", None))
    assert abs(error_ppm(clock, one.true_hz)) < 20.0


def test_a_copy_is_independent() -> None:
    one = stream(19, 104.0, 60.0)
    clock = Clock(104.0)
    one.feed(clock)
    frozen = copy.deepcopy(clock)
    before = frozen.rate().hz
    changed(one, host_s=one.host_s + 60.5, index=one.index + 7000).feed(clock)
    assert frozen.rate().hz == before != clock.rate().hz


@pytest.mark.parametrize("block_s", [0.02, 0.5, 30.0, 1e4])
def test_the_size_of_blocks_does_not_matter(block_s: float) -> None:
    one = stream(20, 416.0, 120.0, frame=8, poll_s=1e-3)
    clock = Clock(416.0)
    one.feed(clock, block_s=block_s)
    assert abs(error_ppm(clock, one.true_hz)) < 1.0


def test_ticks_without_any_time_are_passed_over() -> None:
    one = stream(21, 104.0, 60.0)
    seen = one.host_s.copy()
    seen[::3] = np.nan
    clock = Clock(104.0)
    changed(one, host_s=seen).feed(clock)
    assert abs(error_ppm(clock, one.true_hz)) < 5.0
    clock.update(0, Ticks.none())


@settings(max_examples=150, deadline=None)
@given(
    hnp.arrays(np.int64, st.integers(0, 900), elements=st.integers(0, 2**40)),
    st.data(),
    st.sampled_from([0.0, 104.0, 6660.0]),
)
def test_no_ticks_make_it_fail(index: np.ndarray, data: st.DataObject, nominal_hz: float) -> None:
    times = data.draw(
        hnp.arrays(float, len(index), elements=st.floats(-1e7, 1e7) | st.just(np.nan))
    )
    if data.draw(st.booleans()):
        times = np.sort(times)
    clock = Clock(nominal_hz)
    clock.update(0, Ticks(np.sort(index), times, times, times))
    rate = clock.rate()
    assert np.isfinite(rate.hz)
    assert rate.uncertainty_ppm > 0.0


@pytest.mark.parametrize("catching_up_hz", [500.0, 736.0])
def test_a_crystal_is_believed_against_a_host_that_read_late(catching_up_hz):
    """Ten seconds in time, thirty of silence, and what had waited comes in a rush."""
    number = np.arange(0, 12_000, 9)
    device_s = number / 416.0
    caught = 40.0 + (device_s - 10.0) * 416.0 / catching_up_hz
    host_s = np.where(device_s < 10.0, device_s, np.maximum(caught, device_s))
    unknown = np.full(len(number), np.nan)
    rates = {}
    for crystal in (False, True):
        clock = Clock(416.0, True, 1e-6, crystal)
        clock.update(0, Ticks(number, device_s, host_s, unknown))
        rates[crystal] = clock.rate()
    late = rates[False].host
    assert late is not None
    assert abs(late.hz / 416.0 - 1.0) > 1e-3, "the host has read late"
    assert rates[True].source == "device"
    assert rates[True].hz == pytest.approx(416.0, rel=1e-5)


def test_a_host_that_differs_by_what_crystals_do_stays_the_truth():
    number = np.arange(0, 200_000, 9)
    unknown = np.full(len(number), np.nan)
    clock = Clock(416.0, True, 1e-6, crystal=True)
    clock.update(0, Ticks(number, number / 416.0, number / 416.0 * (1.0 + 90e-6), unknown))
    assert clock.rate().source == "host"


@pytest.mark.parametrize(("rows", "off"), [(400, 10e-6), (1000, -8e-6)])
def test_even_times_of_a_table_know_the_rate_no_better_than_their_decimals(
    rows: int, off: float
) -> None:
    """Stamps in ms, 50 apart all the time: no row says that the period is another."""
    hz = 20.0 * (1.0 + off)
    offset, unknown = np.arange(rows), np.full(rows, np.nan)
    stamps = np.round(offset / hz, 3)
    assert np.ptp(np.diff(stamps)) < 1e-9
    info = StreamInfo(("gx",), (1.0,), time_resolution_s=1e-6, device_clock=True, tabular=True)
    (clock := Clock.of(info)).update(0, Ticks(offset, stamps, unknown, unknown))
    rate = clock.rate()
    sigma = rate.uncertainty_ppm * 1e-6
    assert rate.hz / hz - 1.0 == pytest.approx(0.0, abs=2.0 * sigma)
    assert sigma == pytest.approx(0.01 / 12**0.5 * 20.0 / rows, rel=0.05)
