"""What could hide in another name does not: in B or K, in a neighbour's, or near the limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from allanscope.explain import explain
from allanscope.explain.effects.amplitude_coupling import AmplitudeCoupling
from allanscope.explain.effects.variance_change import VarianceChange
from allanscope.explain.series import series_of
from allanscope.explain.view import View
from support.thinned import RATE as ROWS_PER_S
from support.thinned import thinned

RATE, SIGMA, LSB = 52.0, 4e-3 * 52.0**0.5, 4.375e-3


def kinds(result):
    return {axis: [e.kind for e in found.effects] for axis, found in result.axes.items()}


@pytest.fixture(scope="module")
def absorbed(bench):
    """Four axes, each with one effect that the textbook terms swallow."""
    b = bench(60)
    return explain(
        b.record(
            b.noise() + np.where(b.t >= 500, 20e-3, 0.0),
            b.noise() + 0.05 * np.exp(-b.t / 150),
            b.noise() + b.gauss_markov(12e-3, 10.0),
            b.noise() + 15e-3 * np.sin(2 * np.pi * 0.006 * b.t),
        )
    )


@pytest.mark.parametrize(
    ("axis", "kind"),
    [("gx", "step"), ("gy", "warm_up"), ("gz", "gauss_markov"), ("ax", "sinusoid")],
)
def test_what_b_and_k_had_swallowed_is_named_and_taken_out_of_them(absorbed, axis, kind):
    found = absorbed.axes[axis]
    assert [e.kind for e in found.effects] == [kind]
    before, after = found.coefficients_before, found.coefficients_after
    assert before["K"].value > 2 * 5e-5  # what the textbook says, against the truth
    assert after["K"].lower / 1.3 <= 5e-5 <= after["K"].upper * 1.3  # 95 % would fail once in 5
    assert after["K"].upper < before["K"].value
    assert found.held_out_nats > 20


def test_near_the_limit_an_effect_is_found_or_missed_but_never_misnamed(bench):
    b = bench(61)
    spiked = b.noise()
    spiked[30_000] += 8.5 * SIGMA
    loud = b.noise()
    loud[10_000:20_000] += b.rng.normal(0, 0.4 * SIGMA, 10_000)
    phi = np.exp(-2 * np.pi * 40.0 / RATE)
    result = kinds(
        explain(
            b.record(
                b.noise() + 1.3e-3 * np.sin(2 * np.pi * 3.3 * b.t),
                b.noise() + np.where(b.t >= 700, 5e-3, 0.0),
                b.noise() + b.gauss_markov(3.5e-3, 3.0),
                spiked,
                loud,
                lfilter([1 - phi], [1, -phi], b.noise()),
            )
        )
    )
    truth = ["sinusoid", "step", "gauss_markov", "outliers", "variance_change", "band_limit"]
    for found, kind in zip(result.values(), truth, strict=True):
        assert found in ([], [kind])
    assert sum(bool(found) for found in result.values()) >= 4


def test_a_tone_that_is_modulated_steadily_is_not_three_lines(bench):
    b = bench(62)
    carrier = 0.02 * np.sin(2 * np.pi * 9 * b.t)
    result = explain(
        b.record(
            b.noise() + carrier * (1 + 0.9 * np.sin(2 * np.pi * 0.05 * b.t)),
            b.noise() + carrier * (1 + 0.9 * np.sin(2 * np.pi * 0.3 * b.t)),
            b.noise() + carrier * (b.t % 100 < 40),
        )
    )
    assert kinds(result) == {axis: ["drifting_line"] for axis in ("gx", "gy", "gz")}
    (tone,) = result.axes["gy"].effects
    assert tone.parameters["frequency"].value == pytest.approx(9.0, abs=0.02)
    assert tone.parameters["bandwidth"].value == pytest.approx(0.6, abs=0.03)
    assert tone.parameters["sigma"].value == pytest.approx(0.02 * (1.405 / 2) ** 0.5, rel=0.03)


def test_three_lines_of_a_machine_stay_three_lines(bench):
    b = bench(63, 600.0)
    lines = sum(a * np.sin(2 * np.pi * f * b.t) for f, a in ((6, 0.01), (9, 0.02), (12, 0.004)))
    assert kinds(explain(b.record(b.noise() + lines)))["gx"] == ["sinusoid"] * 3


def test_a_very_loud_stretch_makes_neither_tones_nor_jumps(bench):
    b = bench(64)
    data = b.noise()
    data[20_000:28_000] += b.rng.normal(0, 2.5 * SIGMA, 8_000)
    assert kinds(explain(b.record(data)))["gx"] == ["variance_change"]


def test_numbers_in_g_without_a_step_are_not_rounded_to_whole_g(bench):
    b = bench(65, 300.0)
    record = b.record(b.noise(), b.noise())
    fine = replace(record, axes=("ax", "ay"), values=0.01 * record.values, lsb=(1.0, 1.0))
    smooth = replace(fine, values=fine.values + b.rng.normal(0, 1e-9, fine.values.shape))
    assert kinds(explain(fine)) == kinds(explain(smooth)) == {"ax": [], "ay": []}


def test_a_coarse_step_of_unknown_size_is_read_off_the_numbers(bench):
    b = bench(66, 300.0)
    record = replace(b.record(b.noise(), lsb=3 * SIGMA), lsb=(1.0,))
    (effect,) = explain(record).axes["gx"].effects
    assert effect.kind == "quantization"
    assert effect.parameters["step"].value == pytest.approx(3 * SIGMA, rel=1e-3)


def test_equal_neighbours_without_a_step_are_repeats(bench):
    b = bench(67, 300.0)
    data = b.noise()
    held = np.arange(len(data))
    held[b.rng.random(len(data)) < 0.05] = 0
    record = b.record(data)
    record.values[:, 0] = data[np.maximum.accumulate(held)]
    (effect,) = explain(replace(record, lsb=(1.0,))).axes["gx"].effects
    assert effect.kind == "repeated_samples"
    assert effect.parameters["fraction"].value == pytest.approx(0.05, abs=0.01)


def test_fast_hops_in_the_noise_are_told_from_gauss_markov(bench):
    b = bench(103)
    result = explain(b.record(b.noise() + b.telegraph(0.02, 0.3), b.noise()))
    (effect,) = result.axes["gx"].effects
    assert effect.kind == "random_telegraph"
    dwell = effect.parameters["dwell"]
    assert dwell.lower / 1.2 < 0.3 < dwell.upper * 1.2
    assert result.axes["gy"].effects == ()


def test_two_levels_are_not_seen_in_noise_that_hides_every_hop(bench):
    b = bench(1)
    (effect,) = explain(b.record(b.noise() + b.gauss_markov(0.010, 0.04))).axes["gx"].effects
    assert effect.kind == "gauss_markov"
    assert effect.equivalent == ("random_telegraph",)


def test_a_line_that_came_along_tells_which_axis_leaks_into_which(bench):
    b = bench(2, 600.0)
    source = b.noise() + 0.02 * np.sin(2 * np.pi * 6.3 * b.t)
    result = explain(b.record(b.noise() + 0.3 * source, source))
    assert kinds(result) == {"gx": ["cross_coupling"], "gy": ["sinusoid"]}
    slope = result.axes["gx"].effects[0].parameters["slope"]
    assert slope.lower < 0.3 < slope.upper


def test_a_tone_of_even_size_whose_frequency_swings_is_no_noise_in_a_band(bench):
    b = bench(3)
    swing = np.sin(2 * np.pi * 8 * b.t + 30 * np.sin(2 * np.pi * b.t / 200))
    found = explain(b.record(b.noise() + 0.015 * swing)).axes["gx"].effects
    assert {e.kind for e in found} == {"drifting_line"}


def test_levels_held_unequally_long_have_their_own_size(bench):
    b = bench(4)
    held = b.rng.exponential(np.tile([30.0, 8.0], 100))
    high = np.searchsorted(np.cumsum(held), b.t) % 2
    (effect,) = explain(b.record(b.noise() + 0.02 * high)).axes["gx"].effects
    assert effect.kind == "random_telegraph"
    size = effect.parameters["amplitude"]
    assert size.lower < 0.01 < size.upper


def test_noise_behind_a_band_pass_is_one_band_of_its_width(bench):
    b = bench(7)
    poles = butter(3, [8.0, 12.0], "band", fs=RATE)
    noise = lfilter(*poles, b.rng.normal(0, SIGMA, len(b.t)))
    (effect,) = explain(b.record(b.noise() + noise)).axes["gx"].effects
    assert effect.kind == "narrowband"
    assert effect.parameters["frequency"].value == pytest.approx(10.0, abs=0.1)
    assert effect.parameters["bandwidth"].value == pytest.approx(4.0, rel=0.1)


def test_a_steep_low_pass_is_one_filter_of_its_order_up_to_nyquist(bench):
    b = bench(8)
    behind = lfilter(*butter(3, 18.7, fs=RATE), b.noise())
    (effect,) = explain(b.record(behind, lsb=LSB / 32)).axes["gx"].effects
    assert effect.kind == "band_limit"
    assert effect.evidence["order"] == pytest.approx(3.0, rel=0.01)
    cutoff = effect.parameters["cutoff"]
    assert cutoff.lower < 18.7 < cutoff.upper


@pytest.mark.parametrize(("size", "dwell"), [(0.3, 5.0), (1.0, 20.0)])
def test_large_hops_in_slow_noise_keep_their_size(bench, size, dwell):
    """The doubt when they were takes nothing away from it; the slow noise makes that matter."""
    b = bench(12)
    walk = np.cumsum(b.rng.normal(0, 3e-3 / 52**0.5, len(b.t)))
    (effect,) = explain(b.record(b.noise() + walk + b.telegraph(size, dwell))).axes["gx"].effects
    assert effect.kind == "random_telegraph"
    assert effect.parameters["amplitude"].value == pytest.approx(size, rel=5e-3)


@pytest.mark.parametrize(("size", "dwell"), [(0.03, 2.0), (0.01, 3.0)])
def test_hops_that_are_missed_do_not_make_the_two_levels_nearer(bench, size, dwell):
    b = bench(9)
    (effect,) = explain(b.record(b.noise() + b.telegraph(size, dwell))).axes["gx"].effects
    assert effect.kind == "random_telegraph"
    amplitude = effect.parameters["amplitude"]
    assert amplitude.lower < size < amplitude.upper


@pytest.mark.parametrize("seed", [720, 721])
def test_axes_that_are_shaken_together_do_not_follow_each_other(bench, seed):
    b = bench(seed, 600.0)
    loud = ((b.t > 100) & (b.t < 150)) | ((b.t > 420) & (b.t < 440))
    columns = [np.where(loud, 2.0, 1.0) * b.noise() for _ in range(2)]
    for found in kinds(explain(b.record(*columns, b.noise()))).values():
        assert "amplitude_coupling" not in found


def test_what_shakes_two_axes_now_and_then_is_no_coupling(bench):
    """A leak is there while the source rests, too, even into an axis that is shaken besides."""
    b = bench(725, 600.0)
    shaken = (b.t % 60 < 8) * b.noise()
    together = kinds(explain(b.record(b.noise() + shaken, b.noise() + 2 * shaken)))
    assert not any("cross_coupling" in found for found in together.values())
    source = b.noise() + 2 * shaken
    leaked = kinds(explain(b.record(b.noise() + 0.3 * source + 0.2 * shaken, source)))
    assert "cross_coupling" in leaked["gx"]


def test_noise_that_follows_another_axis_does_so_more_than_once(bench):
    """One event that shakes both axes tells nothing, though it shakes one of them most."""
    b = bench(724, 600.0)
    blocks = np.repeat(np.exp(b.rng.normal(0, 0.6, 120)), len(b.t) // 120)
    once = 1 + 6 * np.exp(-0.5 * ((b.t - 200) / 12) ** 2)
    for motion, share, follows in ((blocks, 0.08, True), (once, 0.3, False)):
        power = motion**2 / np.mean(motion**2)
        axis = np.sqrt(1 - share + share * power) * b.noise()
        found = kinds(explain(b.record(axis, motion * b.noise())))["gx"]
        assert ("amplitude_coupling" in found) == follows


@pytest.mark.parametrize(
    ("seed", "spread", "share", "loud"), [(741, 0.8, 0.025, 1.0), (737, 0.6, 0.08, 7.0)]
)
def test_one_stretch_that_is_loudest_does_not_hide_that_all_of_them_follow(
    bench, seed, spread, share, loud
):
    """It was named a change of the noise level, or a shock beside the coupling that it is."""
    b = bench(seed, 600.0)
    blocks = np.exp(b.rng.normal(0, spread, 120))
    blocks[40] *= loud
    motion = np.repeat(blocks, len(b.t) // 120)
    power = motion**2 / np.mean(motion**2)
    axis = np.sqrt(1 - share + share * power) * b.noise()
    assert set(kinds(explain(b.record(axis, motion * b.noise())))["gx"]) == {"amplitude_coupling"}


def test_intervals_of_another_level_are_weighed_by_what_their_search_costs(bench, monkeypatch):
    b = bench(724, 600.0)
    motion = np.repeat(np.exp(b.rng.normal(0, 0.6, 120)), len(b.t) // 120)
    power = motion**2 / np.mean(motion**2)
    axis = np.sqrt(0.92 + 0.08 * power) * b.noise()
    series = series_of(b.record(axis, motion * b.noise()))
    view = View(series, series.grid, "gx", series.values[:, 0], series.lsb[0])
    (alone,) = AmplitudeCoupling.propose(view)
    for ahead, named in ((-7.0, True), (-4.0, False)):  # of what each gains beyond its penalty
        rival = replace(alone, gain=alone.gain + 9.0 + ahead, log_alternatives=9.0)
        monkeypatch.setattr(VarianceChange, "propose", lambda _, rival=rival: [rival])
        assert bool(AmplitudeCoupling.propose(view)) == named


def test_a_low_pass_far_below_nyquist_is_no_correlated_noise(bench):
    """Behind it the rounding is all that is white: the two have the same spectrum then."""
    b = bench(725)
    keep = float(np.exp(-2 * np.pi * 0.07))
    rows = lfilter([1 - keep], [1, -keep], b.noise())
    (effect,) = explain(b.record(rows)).axes["gx"].effects
    assert effect.kind == "band_limit"
    assert 3.2 < effect.parameters["cutoff"].value < 4.1  # 0.07 of 52 Hz


@pytest.mark.parametrize("seed", [1, 2])
def test_the_floor_beside_a_loud_tone_that_moves_is_not_always_taken_for_a_stop_band(seed):
    """A motor sixty times as loud as the noise: below its harmonics there is power, above none."""
    rng, rows = np.random.default_rng([seed, 13]), 60_000
    frequency = 10 + 0.2 * lfilter([5e-4], [1, -0.9995], rng.normal(0, 30, (3, rows)))
    phase = 2 * np.pi * np.cumsum(frequency, axis=1) / ROWS_PER_S
    noise = rng.normal(0, 5e-3 * ROWS_PER_S**0.5, (rows, 3))
    found = kinds(explain(thinned(noise + 3 * (np.sin(phase) + 0.4 * np.sin(2 * phase)).T)))
    assert sum("band_limit" in names for names in found.values()) <= 2


def test_a_filter_that_is_switched_on_is_a_change_of_the_noise_above_its_cutoff(bench):
    """It changes nothing below, so that no one level tells it; heavy tails were all that was."""
    b = bench(11)
    behind = lfilter(*butter(2, 6.0, fs=RATE), b.noise())
    values = np.where(b.t < 500.0, b.noise(), behind)
    effects = explain(b.record(values, lsb=LSB / 32)).axes["gx"].effects
    (change,) = (e for e in effects if e.kind == "variance_change")
    assert change.parameters["start"].value == pytest.approx(0.0, abs=1.0)
    assert change.parameters["stop"].value == pytest.approx(500.0, abs=0.5)
    low, high = change.evidence["band"]
    assert 6.0 < low < 0.51 * RATE / 2
    assert high == pytest.approx(RATE / 2, rel=1e-3)
    louder, quieter = change.evidence["rms"]
    assert louder == pytest.approx(SIGMA * np.sqrt(1 - low / (RATE / 2)), rel=0.1)
    assert quieter < 0.2 * louder
    assert not any("heavier tails" in e.evidence["words"] for e in effects)


def test_a_machine_that_is_switched_on_is_no_change_of_a_filter(bench):
    b = bench(12)
    hum = sum(0.02 * np.sin(2 * np.pi * f * b.t + f) for f in (7.3, 14.6, 21.9))
    effects = explain(b.record(b.noise() + hum * (b.t > 700.0))).axes["gx"].effects
    assert "variance_change" not in {e.kind for e in effects}
