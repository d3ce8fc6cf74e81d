"""The search as a whole: it ends, takes no name twice, and its numbers hold what they promise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, iirpeak, lfilter

from allanscope.explain import Budget, explain
from allanscope.explain.effects import KINDS
from allanscope.explain.effects.unexplained import left_over
from allanscope.explain.series import series_of
from allanscope.explain.view import View
from allanscope.history import Record

RATE, SIGMA, LSB = 52.0, 4e-3 * 52.0**0.5, 4.375e-3


def kinds(result, axis="gx"):
    return [e.kind for e in result.axes[axis].effects]


def chirp(b, first, width):
    """Return a tone that goes from one frequency to another in the course of the record."""
    return 0.05 * np.sin(2 * np.pi * (first * b.t + width * b.t**2 / b.t[-1] / 2))


def faster(record, factor):
    """Return the same rows of a sensor that is faster by a factor."""
    return replace(record, rate_hz=factor * record.rate_hz, start_s=record.start_s / factor)


# Nothing found


def test_where_nothing_is_found_the_error_is_what_it_was(bench):
    # One coefficient more in the model before would fit chance: chi-square would be larger after.
    b = bench(22)
    result = explain(b.record(*(b.noise() for _ in range(4))))
    for one in result.axes.values():
        assert not one.effects
        assert one.after == one.before


# Ending


def test_slow_effects_that_hide_each_other_are_found_together():
    """None pays for itself while the others are there; after the second 7 nats are missing."""
    rate, rng = 20.0, np.random.default_rng(19)
    t = np.arange(36_000) / rate
    boxes = sum(
        size * ((t > begin) & (t < end))
        for size, begin, end in ((1.3, 500, 600), (-1.3, 900, 1050), (1.3, 1300, 1400))
    )
    level = 4e-3 * (1.5 * np.exp(-t / 200) + boxes)
    rows = rng.normal(0, 4e-3 * rate**0.5, len(t)) + level
    where = np.full(len(t), np.nan), t, np.array([[0, len(t)]])
    record = Record(rate, 1, ("gx",), rows[:, np.newaxis].round(3), (1e-3,), *where)
    path = explain(record).axes["gx"].path
    assert sum(step.move == "add bundle" for step in path) >= 3


def test_a_broad_resonance_far_above_the_floor_is_one_band(bench):
    b = bench(300, 1800.0)
    ringing = lfilter(*iirpeak(8.5, 8.5 / 3.0, fs=RATE), b.rng.normal(size=len(b.t)))
    found = explain(b.record(b.noise() + 3 * SIGMA * ringing / ringing.std()))
    assert kinds(found) == ["narrowband"]
    band = found.axes["gx"].effects[0].parameters
    assert band["frequency"].value == pytest.approx(8.5, rel=0.01)
    assert band["bandwidth"].value == pytest.approx(3.0, rel=0.05)
    assert found.axes["gx"].explained


@pytest.mark.parametrize("bound", [{"acceptances": 2}, {"evaluations": 20}])
def test_a_search_that_is_stopped_says_so_and_explains_nothing(bench, bound):
    b = bench(301, 300.0)
    tones = sum(0.02 * np.sin(2 * np.pi * f * b.t) for f in (3.1, 7.7, 12.9, 19.3))
    found = explain(b.record(b.noise() + tones), budget=Budget(**bound)).axes["gx"]
    assert len([e for e in found.effects if e.kind == "sinusoid"]) < 4
    assert any("the search was stopped" in remark for remark in found.remarks)
    assert not found.explained


def test_a_band_of_no_known_form_ends_within_the_bounds(bench):
    b = bench(302, 300.0)
    spectrum = np.fft.rfft(b.rng.normal(size=len(b.t)))
    f = np.fft.rfftfreq(len(b.t), 1 / RATE)
    spectrum *= (1 + 0.9 * np.cos(2 * np.pi * f / 1.3)) * np.exp(-0.5 * ((f - 9) / 3) ** 2)
    shaped = np.fft.irfft(spectrum, len(b.t))
    record = b.record(b.noise() + 3 * SIGMA * shaped / shaped.std())
    found = explain(record, budget=Budget(acceptances=4, evaluations=100)).axes["gx"]
    assert not found.explained
    assert found == explain(record, budget=Budget(acceptances=4, evaluations=100)).axes["gx"]


# Slow effects side by side


@pytest.mark.parametrize("seed", range(4))
def test_a_warm_up_and_the_temperature_are_told_apart(bench, seed):
    b = bench(310 + seed, 3600.0)
    tc, period = b.rng.uniform(150, 500), b.rng.uniform(900, 2000)
    slope, amplitude = 0.01 * b.rng.choice([-1, 1]), 0.05 * b.rng.choice([-1, 1])
    wandering = np.cumsum(b.rng.normal(0, 0.3 / len(b.t) ** 0.5, len(b.t)))
    room = 0.8 * np.sin(2 * np.pi * b.t / period + b.rng.uniform(0, 6)) + wandering
    read = np.round((25 + room + b.rng.normal(0, 0.02, len(b.t))) * 256) / 256
    data = b.noise() + slope * room + amplitude * np.exp(-b.t / tc)
    found = explain(b.record(data, temperature=read)).axes["gx"]
    assert sorted(e.kind for e in found.effects) == ["temperature", "warm_up"]
    numbers = {name: p for e in found.effects for name, p in e.parameters.items()}
    truth = {"slope": slope, "time_constant": tc, "amplitude": amplitude}
    for name, value in truth.items():
        p = numbers[name]
        assert abs(p.value - value) < 1.7 * (p.upper - p.lower) / 2, name  # one in a thousand
    assert found.coefficients_after["K"].value < 2 * 5e-5


# Tones without a name


def range_of(effect):
    p = {name: parameter.value for name, parameter in effect.parameters.items()}
    if effect.kind == "unexplained":
        return p["frequency_low"], p["frequency_high"]
    return p["frequency"] - 0.6 * p["bandwidth"], p["frequency"] + 0.6 * p["bandwidth"]


def test_unrelated_tones_are_not_united(bench):
    b = bench(320, 1800.0)
    starts = ((0.3, 0.2), (0.8, 0.3), (1.9, 0.6), (4.1, 1.0), (9.0, 1.5), (20.0, 2.8))
    data = b.noise() + sum(chirp(b, first / 2, width / 2) for first, width in starts)
    found = explain(faster(b.record(data), 2)).axes["gx"]
    ranges = [range_of(e) for e in found.effects if e.kind in ("unexplained", "drifting_line")]
    ranges = [r for r in ranges if r[0] > 0]  # 0: all of it has heavy tails
    for first, width in starts:
        own = [r for r in ranges if r[0] < first + width / 2 < r[1]]
        assert own
        for low, high in own:
            assert high - low < 3 * width
    white = found.coefficients_after["N"]
    assert white.value == pytest.approx(4e-3 / 2**0.5, rel=0.02)


def test_a_loud_stretch_of_which_hardly_any_frequency_is_left_is_not_judged(bench):
    b = bench(325, 300.0)
    data = b.noise()
    data[5_000:9_000] += b.rng.normal(0, 3 * SIGMA, 4_000)
    series = series_of(b.record(data))
    view = View(series, series.grid, "gx", series.values[:, 0], LSB)
    for band in ((0.9, 12.0), (12.5, 25.6)):
        view = view.accept(left_over(view, band, 0.0, 0.0, ""))
    assert list(KINDS["variance_change"].candidates(view)) == []


# Axes that are one signal


@pytest.mark.parametrize("lsb", [LSB, LSB / 1e6])
@pytest.mark.parametrize("factor", [1, -1, 2])
def test_an_axis_that_is_a_multiple_of_another_keeps_its_own_numbers(bench, factor, lsb):
    b = bench(330, 300.0)
    own = np.round(b.noise() / lsb) * lsb
    found = explain(b.record(own, factor * own, lsb=lsb)).axes
    for axis, size in (("gx", 1), ("gy", abs(factor))):
        assert not {"cross_coupling", "random_telegraph"} & {e.kind for e in found[axis].effects}
        assert found[axis].coefficients_after["N"].value == pytest.approx(4e-3 * size, rel=0.05)
        assert any("one signal" in remark for remark in found[axis].remarks)


# Filters and repeats


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_rows_that_are_held_behind_a_filter_leave_both_what_they_are(bench, share):
    b = bench(340, 600.0)
    poles = butter(2, 2 * 12.0 / RATE)
    rows = np.arange(len(b.t))
    rows[b.rng.random(len(b.t)) < share] = 0
    rows = np.maximum.accumulate(rows)
    columns = [lfilter(*poles, b.noise())[rows] for _ in range(3)]
    result = explain(b.record(*columns, lsb=LSB / 8))
    for axis in ("gx", "gy", "gz"):
        assert kinds(result, axis) == ["repeated_samples", "band_limit"]
        cutoff = result.axes[axis].effects[1].parameters["cutoff"]
        assert abs(cutoff.value - 12.0) < 1.7 * (cutoff.upper - cutoff.lower) / 2
        assert result.axes[axis].coefficients_after["N"].value == pytest.approx(4e-3, rel=0.03)
        assert result.axes[axis].explained


# Intervals


def inside(parameter, truth):
    return parameter.lower < truth < parameter.upper


def covered(outcomes):
    """Tell whether so many of a 95 % interval hold the truth (less happens once in a thousand)."""
    return sum(outcomes) >= {24: 19, 30: 24}[len(outcomes)]


def test_the_cutoff_of_a_filter_is_in_its_interval(bench):
    outcomes = []
    for seed in range(24):
        b = bench(400 + seed, 300.0)
        cutoff = RATE * np.exp(b.rng.uniform(np.log(0.08), np.log(0.4)))
        behind = lfilter(*butter(1 + seed % 3, 2 * cutoff / RATE), b.noise())
        only = Budget(kinds=frozenset({"band_limit"}))
        (effect,) = explain(b.record(behind, lsb=LSB / 8), budget=only).axes["gx"].effects
        outcomes.append(inside(effect.parameters["cutoff"], cutoff))
    assert covered(outcomes)


def test_the_size_of_a_step_is_in_its_interval(bench):
    outcomes = []
    for seed in range(30):
        b = bench(440 + seed, 600.0)
        size, at = b.rng.uniform(12e-3, 30e-3), b.rng.uniform(0.15, 0.85) * b.t[-1]
        only = Budget(kinds=frozenset({"step"}))
        record = b.record(b.noise() + np.where(b.t >= at, size, 0.0))
        (effect,) = explain(record, budget=only).axes["gx"].effects
        outcomes.append(inside(effect.parameters["size"], size))
    assert covered(outcomes)


def test_a_step_in_noise_whose_walk_is_not_seen_does_not_promise_too_much(bench):
    """The fitted noise has no random walk by chance: its error is not that of white noise."""
    errors = []
    for seed in range(30):
        b = bench(440 + seed, 600.0)
        size = 25e-3
        only = Budget(kinds=frozenset({"step"}))
        record = b.record(b.noise() + np.where(b.t >= 300, size, 0.0))
        (effect,) = explain(record, budget=only).axes["gx"].effects
        p = effect.parameters["size"]
        errors.append((p.value - size) / ((p.upper - p.lower) / 3.92))
    assert np.max(np.abs(errors)) < 4


@pytest.mark.parametrize(("seed", "size", "dwell"), [(1, 0.04, 1.8), (2, 0.04, 2.7), (3, 0.02, 4)])
def test_fast_hops_of_a_long_record_keep_their_size(bench, seed, size, dwell):
    """Six hours are too many blocks to cut all of them as short as such hops need."""
    b = bench(480 + seed, 6 * 3600.0 * 2)
    only = Budget(kinds=frozenset({"gauss_markov", "random_telegraph"}))
    record = faster(b.record(b.noise() + b.telegraph(size, 2 * dwell)), 2)
    (effect,) = explain(record, budget=only).axes["gx"].effects
    assert effect.kind == "random_telegraph"
    assert effect.parameters["amplitude"].value == pytest.approx(size, rel=0.02)
    assert inside(effect.parameters["amplitude"], size)
    assert effect.parameters["dwell"].value == pytest.approx(dwell, rel=0.1)


def test_no_number_has_an_interval_of_nothing(bench):
    """A band that is pressed against the end of the spectrum has not been measured."""
    pole = np.exp((-np.pi * 6.0 + 2j * np.pi * 25.9) / RATE)
    for seed in range(3):
        b = bench(493 + seed, 200.0)
        e = b.rng.normal(size=len(b.t)) + 1j * b.rng.normal(size=len(b.t))
        ringing = lfilter([np.sqrt(1 - abs(pole) ** 2)], [1, -pole], e).real
        for effect in explain(b.record(b.noise() + 0.06 * ringing, lsb=LSB / 8)).axes["gx"].effects:
            if effect.kind != "unexplained":
                for p in effect.parameters.values():
                    assert p.upper - p.lower > 1e-5 * abs(p.value), effect
