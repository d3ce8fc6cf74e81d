"""A shock is one event on every axis that it moves, and no steps and excursions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import median_filter
from scipy.signal import butter, lfilter

from allanscope.explain import explain
from allanscope.explain.heldout import _contradiction
from allanscope.explain.shock_removal import _tail, quiet_rows
from allanscope.explain.shock_rows import Levelled, _running_median, find_shock_rows

SIGMA = 4e-3 * 52.0**0.5
AT_S, LASTS_S = 130.0, 1.5


def ringing(t, peak, at=AT_S, lasts=LASTS_S):
    """Return a decaying oscillation of six cycles."""
    late = np.maximum(t - at, 0.0) / lasts
    return peak * np.exp(-4.6 * late) * np.sin(2 * np.pi * 6 * late) * (t >= at)


def coarse(seed, jump):
    """Return rows in steps of 1, their time, and a level halfway between two that jumps at 15 s."""
    t = np.arange(28_800) / 960.0
    noise = np.random.default_rng(seed).normal(20.5, 2.8, len(t))
    return np.round(noise + jump * (t > 15.0)), t


@pytest.fixture(scope="module")
def knocked(bench):
    """Knock two axes hard, a third lightly; gx has another level afterwards."""
    b = bench(610, 300.0)
    step = np.where(b.t >= AT_S + 0.7, 4 * SIGMA, 0.0)
    return explain(
        b.record(
            b.noise() + ringing(b.t, 30 * SIGMA) + step,
            b.noise() + ringing(b.t, -25 * SIGMA),
            b.noise() + ringing(b.t, 9 * SIGMA),
            b.noise(),
        )
    )


def test_a_knock_is_one_shock_at_one_time_on_the_axes_that_it_moves(knocked):
    shocks = {
        axis: [e for e in found.effects if e.kind == "shock"]
        for axis, found in knocked.axes.items()
    }
    assert {axis: len(found) for axis, found in shocks.items()} == {
        "gx": 1, "gy": 1, "gz": 1, "ax": 0
    }  # fmt: skip
    times = {effect.parameters["time"].value for found in shocks.values() for effect in found}
    assert len(times) == 1
    assert times.pop() == pytest.approx(AT_S, abs=0.25)
    assert shocks["gx"][0].axes == ("gx", "gy", "gz")


@pytest.mark.parametrize(
    ("lasts_s", "kind"), [(1.2, "shock"), (1.6, "shock"), (20.0, "excursion"), (900.0, "step")]
)
@pytest.mark.parametrize("seed", [630, 631])
def test_what_is_over_with_a_shock_of_other_axes_is_that_shock(bench, seed, lasts_s, kind):
    """It was an excursion or steps of its own where no row is loud."""
    b = bench(seed, 300.0)
    moved = 1.2 * SIGMA * ((b.t >= AT_S) & (b.t < AT_S + lasts_s))
    shaken = [b.noise() + ringing(b.t, peak * SIGMA) for peak in (30, 40)]
    axes = explain(b.record(*shaken, b.noise() + moved, b.noise())).axes
    (found,) = axes["gz"].effects
    assert found.kind == kind
    if lasts_s > 1.5:  # a shorter one may be found by its power, and look higher
        size = found.parameters["peak" if kind == "shock" else "size"]
        assert size.lower < 1.2 * SIGMA < size.upper
    assert found.axes == (("gx", "gy", "gz") if kind == "shock" else ("gz",))
    assert not axes["ax"].effects


@pytest.mark.parametrize("seed", [632, 633])
def test_a_pulse_that_outlasts_the_shock_on_other_axes_is_part_of_it(bench, seed):
    """It was an excursion, and a shock in what that had left."""
    b = bench(seed, 300.0)
    pulse = 8 * SIGMA * ((b.t >= AT_S) & (b.t < AT_S + 2.2))
    shaken = [b.noise() + ringing(b.t, peak * SIGMA, lasts=0.6) for peak in (30, 40)]
    (found,) = explain(b.record(*shaken, b.noise() + pulse)).axes["gz"].effects
    assert found.kind == "shock"
    assert found.parameters["duration"].value == pytest.approx(2.2, abs=0.35)


def test_beside_it_stands_the_level_that_it_leaves_and_nothing_else(knocked):
    kinds = {axis: [e.kind for e in found.effects] for axis, found in knocked.axes.items()}
    assert kinds == {"gx": ["shock", "step"], "gy": ["shock"], "gz": ["shock"], "ax": []}
    size = knocked.axes["gx"].effects[1].parameters["size"]
    assert size.value == pytest.approx(4 * SIGMA, rel=0.1)


def test_the_error_of_the_step_is_below_its_gain(knocked):
    evidence = knocked.axes["gx"].effects[1].evidence
    assert evidence["held_out_nats"] > 3 * evidence["held_out_nats_se"]


def test_levels_beside_a_shock_are_finer_than_a_step_of_the_values():
    """Of the medians one was 20 and the other 21: steps of 1 within every third shock."""
    first, stop, error = 14_000, 15_920, 2.8 * np.sqrt(1.19 / 1920)
    ends = []
    for seed in range(50):
        rows = coarse(seed, 0.0)[0]
        _, level = quiet_rows(rows, first, stop, 2.8, np.zeros(len(rows), bool))
        ends.append((level[0], level[-1]))
    assert np.std(ends) == pytest.approx(error, rel=0.2)
    assert np.mean(ends) == pytest.approx(20.5, abs=0.03)


@pytest.mark.parametrize("seed", [642, 645, 646])
def test_the_step_with_a_shock_has_its_size_in_coarse_values(bench, seed):
    """It was up to 1.4 steps of the values where it is 1."""
    rows, t = coarse(seed, 1.0)
    ring = 60 * np.exp(-(t - 15.0) / 0.4) * np.cos(2 * np.pi * 144 * (t - 15.0)) * (t >= 15.0)
    record = bench(seed, 1.0).record(np.zeros(52), lsb=1.0)
    values = np.round(rows + ring)[:, np.newaxis]
    record = replace(
        record,
        rate_hz=960.0,
        values=values,
        temperature_c=np.full(len(t), np.nan),
        start_s=t,
        segments=np.array([[0, len(t)]], np.int64),
    )
    shock, step = explain(record).axes["gx"].effects
    assert (shock.kind, step.kind) == ("shock", "step")
    assert step.parameters["size"].value == pytest.approx(1.0, abs=0.15)


def test_a_shock_of_a_fiftieth_of_a_second_is_no_steps(bench):
    b = bench(611, 60.0)
    t = np.arange(len(b.t)) / 1000.0
    record = b.record(b.noise() + ringing(t, 30 * SIGMA, at=1.5, lasts=0.02))
    record = replace(record, rate_hz=1000.0, start_s=t)
    stretched = replace(
        record,
        values=np.vstack([record.values] + [b.record(b.noise()).values] * 6),
        temperature_c=np.full(7 * len(t), np.nan),
        start_s=np.arange(7 * len(t)) / 1000.0,
        segments=np.array([[0, 7 * len(t)]], np.int64),
    )
    found = explain(stretched).axes["gx"].effects
    assert [e.kind for e in found if e.kind in {"shock", "step", "excursion"}] == ["shock"]


def test_a_level_that_leaves_and_returns_on_three_axes_is_no_shock(bench):
    b = bench(612, 300.0)
    box = np.where((b.t >= 100) & (b.t < 102), 12 * SIGMA, 0.0)
    axes = {axis: b.noise() + box for axis in ("gx", "gy", "gz")}
    assert shocks_of(axes, 52.0, 1e-4) == []


def test_pieces_of_a_shock_contradict_a_step_and_a_true_step_does_not(bench):
    b = bench(613, 300.0)
    white = b.rng.normal(size=len(b.t))
    pulse = np.exp(-np.abs(b.t - 150.0) / 0.2)[np.newaxis]
    swing = 30 * np.exp(-np.abs(b.t - 150.0) / 0.3) * np.cos(2 * np.pi * 3 * (b.t - 150.0))
    assert _contradiction(pulse, white + 8 * pulse[0], 52.0) < 2
    assert _contradiction(pulse, white + swing, 52.0) > 20


RATE = 104.0


@pytest.mark.parametrize("peak", [12.0, 30.0, 100.0])
def test_what_rings_on_below_what_is_loud_is_taken_out_too(peak):
    """Of a peak of 12 deviations a ringing of three was left: a band of noise at its frequency."""
    rng, block, first = np.random.default_rng(5), 32, 2000
    late = np.maximum(np.arange(6000) - first, 0) / (0.4 * RATE)
    ring = peak * np.exp(-late) * np.cos(2 * np.pi * 0.15 * np.arange(6000)) * (late > 0)
    stop = first + int(0.4 * RATE * np.log(peak / 6))
    for _ in range(20):
        data = ring + rng.standard_normal(6000)
        end = stop + _tail(data, first - block, stop, block) + block
        assert np.sum(ring[end:] ** 2) / 2 < 3  # nats


def test_a_slope_and_noise_that_stays_loud_are_no_ringing():
    rows = np.arange(6000)
    noise = np.random.default_rng(6).standard_normal(6000)
    loud = noise * np.where(rows > 2000, 5.0, 1.0)
    assert _tail(noise + 0.2 * np.maximum(rows - 2000, 0), 2000, 2050, 32) <= 32
    assert _tail(loud, 2000, 2050, 32) <= 4 * 32
    assert _tail(noise, 10, 2050, 32) == 0  # nothing before it tells how loud noise is


def soft(rng, peak, decay_s=0.4, hz=15.6, at=20.0, seconds=40.0):
    """Return white noise of deviation 1 in which something rings softly."""
    t = np.arange(int(seconds * RATE)) / RATE
    late = np.maximum(t - at, 0.0)
    ring = np.exp(-late / decay_s) * np.cos(2 * np.pi * hz * late) * (t >= at)
    return np.round(8 * (peak * ring + rng.standard_normal(len(t)))) / 8


def shocks(*axes, rate=RATE, step=0.125):
    """Return what is found in rows of some axes."""
    return shocks_of(dict(zip(("gx", "gy", "gz"), axes, strict=False)), rate, step)


def shocks_of(axes, rate, step):
    """Return the same of axes with their names."""
    levelled = [Levelled(axis, rows, rate, step) for axis, rows in axes.items()]
    rows = np.array(list(axes.values()))
    repeated = np.append(False, np.all(rows[:, 1:] == rows[:, :-1], axis=0))
    return find_shock_rows(levelled, repeated)


def test_what_rings_for_many_rows_is_a_shock_though_none_is_loud():
    rng = np.random.default_rng(620)
    found = [shocks(soft(rng, 3.0)) for _ in range(12)]
    assert sum(len(one) == 1 for one in found) >= 11
    assert all(len(one) <= 1 for one in found)
    firm = [one[0] for one in found if one]
    held = [s.onset[1] <= 20.0 * RATE - 0.5 <= s.onset[2] for s in firm]
    assert np.mean(held) > 0.8
    peaks = np.array([s.rings["gx"].peak for s in firm])
    assert abs(np.mean((peaks[:, 0] - 3.0) / peaks[:, 1])) < 0.8


def test_two_axes_that_ring_at_once_are_one_shock():
    rng = np.random.default_rng(621)
    found = shocks(soft(rng, 4.0), soft(rng, 3.5, hz=22.0), soft(rng, 0.0))
    assert [one.axes for one in found] == [("gx", "gy")]
    assert found[0].first == pytest.approx(20.0 * RATE, abs=3)


def test_noise_does_not_ring():
    rng = np.random.default_rng(622)
    assert not any(shocks(soft(rng, 0.0)) for _ in range(60))


def test_levels_that_hop_do_not_ring():
    """Short visits of another level are swings to a filter; two changes explain them better."""
    rng = np.random.default_rng(623)
    for _ in range(15):
        rows = soft(rng, 0.0, seconds=100.0)
        hops = rng.random(len(rows)) < 1 / (1.5 * RATE)
        found = shocks(rows + 4.0 * (np.cumsum(hops) % 2))
        assert not any(one.rings for one in found)


def test_noise_that_is_louder_for_a_moment_does_not_ring():
    rng = np.random.default_rng(624)
    for _ in range(20):
        loud = np.repeat(np.exp(rng.normal(0, 0.8, 100)), 64)
        found = shocks(np.round(8 * loud * rng.standard_normal(6400)) / 8)
        assert not any(one.rings for one in found)  # rows of six deviations are another matter


def test_few_codes_do_not_ring():
    rng = np.random.default_rng(625)
    for sigma in (0.2, 0.4, 0.8):
        slow = np.cumsum(rng.standard_normal(8000)) * 0.01
        assert not shocks(np.round(slow + sigma * rng.standard_normal(8000)), step=1.0)


@pytest.mark.parametrize("share", [0.0, 0.002, 0.005, 0.01, 0.02, 0.05])
def test_repeated_rows_behind_a_low_pass_do_not_ring(share):
    """There rows tell the next one closely: one that is repeated, or cut, is a kick."""
    rng, n = np.random.default_rng(626), 31_200
    for _ in range(2):
        rows = np.where(rng.random(n) < share, 0, np.arange(n))
        axes = lfilter(*butter(2, 24.0 / 52.0), rng.standard_normal((3, n)))
        axes = axes[:, np.maximum.accumulate(rows)]
        assert not shocks(*np.round(axes * 53) / 53, rate=52.0, step=1 / 53)


def test_a_loud_line_that_wanders_does_not_ring():
    """It leaves the notch that linear prediction has for it, for as long as a shock lasts."""
    rng, n = np.random.default_rng(627), 30_000
    for _ in range(8):
        wanders = 0.2 * lfilter([5e-4], [1, -0.9995], rng.normal(0, 30, n))
        phase = 2 * np.pi * np.cumsum(10 + wanders) / RATE
        tone = np.sin(phase) + 0.4 * np.sin(2 * phase)
        assert not shocks(60 * tone + rng.standard_normal(n))


def test_a_loud_line_does_not_ring_where_the_record_begins():
    rng = np.random.default_rng(628)
    for hz in (16.6, 30.0):
        tone = 10 * np.sin(2 * np.pi * hz * np.arange(int(40 * RATE)) / RATE)
        assert not any(shocks(tone + soft(rng, 0.0)) for _ in range(10))


@pytest.mark.parametrize(
    ("end", "off"),
    [
        ("first", lambda t: -20.0 * (t < 0.16)),
        ("first", lambda t: 30.0 * np.exp(-t / 0.1)),
        ("last", lambda t: 20.0 * (t[::-1] < 1.0)),
    ],
)
def test_an_end_of_the_record_that_is_off_the_level_is_taken_out(bench, end, off):
    """N was up to 20 % off, beside a low-pass or correlated noise that was none."""
    b = bench(611, 120.0)
    found = explain(b.record(b.noise() + SIGMA * off(b.t), b.noise())).axes
    (effect,) = found["gx"].effects
    assert effect.kind == "shock"
    assert effect.evidence["end"] == end
    assert f"the {end} " in effect.evidence["words"]
    assert found["gx"].coefficients_after["N"].value == pytest.approx(4e-3, rel=0.05)
    assert not found["gy"].effects


@pytest.mark.parametrize("end", ["first", "last"])
def test_a_knock_in_the_last_rows_is_found_whatever_their_number(bench, end):
    """Of 33061 rows 61 are left out, for a quick transform: those without the knock."""
    b = bench(742, 33061 / 52.0 + 0.001)
    n = len(b.t)
    assert n == 33061
    ringing = 0.4 * np.exp(-np.arange(40) / 12) * np.cos(np.arange(40))
    knock = np.zeros(n)
    knock[slice(15, 55) if end == "first" else slice(-45, -5)] = ringing
    axes = explain(b.record(b.noise() + knock, b.noise() + 0.5 * knock)).axes
    for name in ("gx", "gy"):
        effect = next(effect for effect in axes[name].effects if effect.kind == "shock")
        time = effect.parameters["time"].value
        assert (time < 1.5) if end == "first" else (time > (n - 60) / 52.0)


@pytest.mark.parametrize("tau_s", [5.0, 60.0])
def test_a_warm_up_is_no_end_that_is_off(bench, tau_s):
    b = bench(612, 600.0)
    rows = b.noise() + 100 * SIGMA * np.exp(-b.t / tau_s)
    assert not shocks_of({"gx": rows}, 52.0, 1e-3)


def test_a_slow_wave_and_a_random_walk_are_off_no_end(bench):
    b = bench(613, 150.0)
    for _ in range(20):
        period, phase = b.rng.uniform(15, 200), b.rng.uniform(0, 7)
        wave = b.noise() + 100 * SIGMA * np.sin(2 * np.pi * b.t / period + phase)
        walk = np.cumsum(b.rng.normal(0, SIGMA, len(b.t)))
        for rows in (wave, walk):
            assert not shocks_of({"gx": rows}, 52.0, 1e-4)


def test_a_level_that_is_another_one_for_seconds_is_one_excursion(bench):
    """It was two steps, each of which looks as if the level had stayed."""
    b = bench(614, 120.0)
    box = 15 * SIGMA * ((b.t >= 60.0) & (b.t < 63.0))
    found = explain(b.record(b.noise() + box)).axes["gx"]
    (effect,) = found.effects
    assert effect.kind == "excursion"
    assert effect.parameters["time"].value == pytest.approx(60.0, abs=0.1)
    assert effect.parameters["duration"].value == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize("seed", [618, 619, 620])
def test_two_unequal_steps_are_no_jump_that_creeps_back(bench, seed):
    """The first looks like one until the second is found; then nothing creeps."""
    b = bench(seed, 600.0)
    steps = SIGMA * (5.0 * (b.t >= 200.0) - 2.5 * (b.t >= 220.0))
    found = explain(b.record(b.noise() + steps)).axes["gx"]
    assert {effect.kind for effect in found.effects} <= {"step", "excursion"}
    assert len(found.effects) == 2


def test_pulses_of_an_elevator_and_a_self_test_are_shocks_and_no_random_walk(bench):
    """K was 650 ug/sqrt(s) and 120 mdps/sqrt(s), with the low frequencies unexplained."""
    b = bench(622, 600.0)

    def pulse(at, peak):
        late = (b.t - at) / 1.5
        return peak * SIGMA * np.where((late > 0) & (late < 1), np.sin(np.pi * late) ** 2, 0.0)

    rides = sum(pulse(at, 50) + pulse(at + 9.0, -50) for at in (100.0, 320.0))
    test = 80 * SIGMA * ((b.t > 250.0) & (b.t < 250.8))
    found = explain(b.record(b.noise() + rides, b.noise() + test)).axes
    assert [effect.kind for effect in found["gx"].effects] == 4 * ["shock"]
    times = sorted(effect.parameters["time"].value for effect in found["gx"].effects)
    assert times == pytest.approx([100.2, 109.2, 320.2, 329.2], abs=0.3)
    (single,) = found["gy"].effects
    assert single.kind == "shock"
    assert single.parameters["time"].value == pytest.approx(250.0, abs=0.1)
    assert single.parameters["duration"].value == pytest.approx(0.8, abs=0.1)


def test_a_short_shock_is_loud_beside_louder_lines():
    """Half sines of 70 ms beside two lines; N was 5 % too high, and one was a louder stretch."""
    rng = np.random.default_rng(623)
    t = np.arange(int(300.0 * RATE)) / RATE
    late = (t - 160.0) / 0.07
    bump = 25.0 * np.where((late > 0) & (late < 1), np.sin(np.pi * late), 0.0)
    lines = 4.4 * np.sin(2 * np.pi * 23.4 * t) + 3.3 * np.sin(2 * np.pi * 11.1 * t + 1)
    (found,) = shocks(rng.standard_normal(len(t)) + lines + bump)
    assert found.first / RATE == pytest.approx(160.0, abs=0.1)
    assert found.sigma["gx"] == pytest.approx(1.0, rel=0.05)
    assert shocks(rng.standard_normal(len(t)) + lines) == []


@pytest.mark.parametrize(("seed", "rows"), [(1, 50_000), (9, 50_000), (4, 70_000)])
def test_rows_of_noise_that_is_louder_for_a_while_are_no_shock(seed, rows):
    """Some of them are far out for quiet noise, and now and then none is for a second."""
    rng = np.random.default_rng([seed, rows, 3])
    x = rng.normal(size=rows) * 0.04
    x[int(0.45 * rows) : int(0.55 * rows)] *= 3
    assert shocks_of({"gx": x}, 100.0, 1e-9) == []
    t = np.arange(rows) / 100.0
    x += ringing(t, 1.0, at=rows / 500.0)
    (found,) = shocks_of({"gx": x}, 100.0, 1e-9)
    assert abs(found.first - rows / 5) < 20


@pytest.mark.parametrize(
    ("rows", "window", "wide", "step"),
    [
        (3000, 5, 3, 0.1),
        (3000, 521, 30, 1 / 16384),
        (600, 101, 1, 0.5),
        (2000, 25, 2e3, 0.1),
        (700, 521, 1, 0.0),
        (700, 25, 1, 0.3),
    ],
)
def test_a_median_of_values_that_are_counted_is_that_of_values_that_are_sorted(
    rows, window, wide, step
):
    """On a lattice, on one of too many values, and on none that is known."""
    rng = np.random.default_rng(3)
    steps = np.round(wide * (0.05 * np.cumsum(rng.normal(size=rows)) + rng.normal(size=rows)))
    values = steps * (0.1 if step == 0.3 else step or 0.1)
    np.testing.assert_array_equal(
        _running_median(values, window, step), median_filter(values, window, mode="reflect")
    )


def knock(t, at, size, decay=0.6):
    after = np.maximum(t - at, 0.0)
    return size * SIGMA * np.exp(-after / decay) * np.sin(2 * np.pi * 11.0 * after)


@pytest.mark.parametrize("seed", range(960, 966))
def test_a_knock_seconds_after_another_is_no_part_of_the_quiet_around_it(bench, seed):
    """Rows of the second one were taken for the noise that goes on through the first."""
    b = bench(seed, 600.0)
    rows = b.noise() + knock(b.t, 300.0, 10.0) + knock(b.t, 303.0, 10.0)
    found = explain(b.record(rows))
    assert [effect.kind for effect in found.axes["gx"].effects] == ["shock", "shock"]
    truth = float(knock(b.t, 300.0, 10.0).max())
    for effect in found.axes["gx"].effects:
        assert effect.parameters["peak"].value == pytest.approx(truth, abs=2.5 * SIGMA)
    around = slice(299 * 52, 306 * 52)
    assert found.cleaned["gx"][around].std() < 1.2 * SIGMA


@pytest.mark.parametrize("seed", range(970, 974))
def test_an_axis_that_rings_softly_with_a_loud_one_is_asked_for_at_its_time(bench, seed):
    b = bench(seed, 600.0)
    times = (100.0, 300.0, 450.0)
    loud, soft = (b.noise() + sum(knock(b.t, at, size) for at in times) for size in (30.0, 4.5))
    axes = explain(b.record(loud, soft, b.noise())).axes
    assert [effect.kind for effect in axes["gy"].effects] == ["shock"] * 3
    assert {effect.axes for effect in axes["gy"].effects} == {("gx", "gy")}
    assert not axes["gz"].effects
