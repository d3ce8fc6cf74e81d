"""A loud effect brings no second name beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import idct
from scipy.signal import lfilter

from allanscope.explain import explain, fit_beside
from allanscope.explain.effects.amplitude_coupling import AmplitudeCoupling
from allanscope.explain.series import Series
from allanscope.explain.shock_removal import _tail
from allanscope.explain.view import View

SIGMA, RATE = 4e-3 * 52.0**0.5, 52.0


def kinds(axis):
    return [effect.kind for effect in axis.effects]


def test_a_shock_of_the_source_is_no_shock_of_the_axis_that_it_couples_into(bench):
    b = bench(3, 300.0)
    late = np.maximum(b.t - 130.0, 0.0)
    knock = 30 * SIGMA * np.exp(-3 * late) * np.sin(2 * np.pi * 5 * late)
    source = b.noise() + b.gauss_markov(2 * SIGMA, 0.05) + knock
    found = explain(b.record(b.noise() + 0.5 * source, source)).axes
    assert kinds(found["gx"]) == ["cross_coupling"]
    assert kinds(found["gy"]) == ["shock", "gauss_markov"]


def knocked_pair(b, *, alone):
    """Return an axis that follows another, and that one with a shock, which comes along or not."""
    late = np.maximum(b.t - 130.0, 0.0)
    knock = 200 * SIGMA * np.exp(-3 * late) * np.sin(2 * np.pi * 5 * late)
    source = b.noise() + b.gauss_markov(2 * SIGMA, 0.05)
    return b.record(b.noise() + 0.1 * (source + (0 if alone else 1) * knock), source + knock)


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("seed", [20, 21, 22])
def test_a_shock_of_the_source_hides_no_coupling(bench, seed, alone):
    found = explain(knocked_pair(bench(seed, 300.0), alone=alone)).axes
    (coupling,) = found["gx"].effects
    slope = coupling.parameters["slope"]
    assert coupling.kind == "cross_coupling"
    assert slope.value == pytest.approx(0.1, abs=0.025 if alone else 3e-3)
    assert slope.lower < 0.1 < slope.upper
    assert kinds(found["gy"]) == ["shock", "gauss_markov"]


def test_a_shock_that_came_along_tells_the_source_of_noise_of_equal_colour(bench):
    b = bench(23, 300.0)
    late = np.maximum(b.t - 130.0, 0.0)
    source = b.noise() + 200 * SIGMA * np.exp(-3 * late) * np.sin(2 * np.pi * 5 * late)
    found = explain(b.record(b.noise() + 0.1 * source, source)).axes
    (coupling,) = found["gx"].effects
    assert coupling.evidence["direction_nats"] > 10
    assert kinds(found["gy"]) == ["shock"]


@pytest.mark.parametrize("seed", [20, 21])
def test_a_coupling_goes_on_beside_a_shock_that_did_not_come_along(bench, seed):
    b = bench(seed, 600.0)
    whole = knocked_pair(b, alone=True)
    n = len(b.t) // 2
    half = replace(
        whole,
        values=whole.values[:n],
        temperature_c=whole.temperature_c[:n],
        start_s=whole.start_s[:n],
        segments=np.array([[0, n]], np.int64),
    )
    explanation = explain(half)
    signal = fit_beside(explanation.held, whole)["gx"].signals["cross_coupling"]
    assert np.abs(signal).max() < 6 * 0.1 * np.hypot(1, 2) * SIGMA
    assert np.corrcoef(signal[n:], whole.values[n : len(signal), 1])[0, 1] > 0.999


@pytest.mark.parametrize(("here", "there"), [(150, 0), (150, 200), (0, 200)])
def test_noise_that_follows_an_axis_does_so_beside_a_shock(bench, here, there):
    """By the same share as without one; it was another noise level instead."""
    b = bench(31, 600.0)
    late = np.maximum(b.t - 130.0, 0.0)
    knock = SIGMA * np.exp(-3 * late) * np.sin(2 * np.pi * 5 * late)
    envelope = np.repeat(np.exp(b.rng.normal(0, 0.3, 400)), 78)
    envelope /= np.sqrt(np.mean(envelope**2))
    axis, source = b.noise() * np.sqrt(0.5 + 0.5 * envelope**2), 3 * envelope * b.noise()
    found = explain(b.record(axis + here * knock, source + there * knock)).axes["gx"].effects
    assert [e.kind for e in found] == ["shock"] * bool(here) + ["amplitude_coupling"]
    assert found[-1].parameters["share"].value == pytest.approx(0.42, abs=0.04)


def test_a_share_near_none_has_an_error_and_prints_no_warning():
    """Below 0 the noise would have a negative variance where the source is loud."""
    rng, size, share = np.random.default_rng(32), 26, 0.003
    power = np.repeat(np.where(np.arange(3000) % 500 == 7, 1.6e5, 1.0), size)
    axis = np.sqrt(1 - share + share * power / power.mean()) * rng.standard_normal(len(power))
    rows = np.column_stack([axis, np.sqrt(power) * rng.standard_normal(len(power))])
    bridged = np.zeros(len(rows), np.bool_)
    series = Series(("gx", "gy"), rows, RATE, 1, (1e-9, 1e-9), None, bridged)
    vars(series)["shocks"] = ()  # so loud blocks would be some
    (found,) = AmplitudeCoupling.propose(View(series, series.grid, "gx", rows[:, 0], 0.0))
    assert found.effect.share.lower < share < found.effect.share.upper < share + 0.01


def test_a_shock_rings_on_below_what_is_loud_and_a_pulse_to_one_side_does_not():
    """It falls from its peak to six sigma, and on until it is half of one."""
    noise, begin, block = np.random.default_rng(7).normal(size=6000), 3000, 288
    t = np.arange(begin) / 960.0
    ringing = np.concatenate([0 * t, np.exp(-t / 0.4) * np.cos(2 * np.pi * 144 * t)])
    for peak in (12, 120):
        loud, lost = (begin + int(960 * 0.4 * np.log(peak / left)) for left in (6, 0.5))
        tail = _tail(noise + peak * ringing, begin, loud, block)
        assert loud + tail == pytest.approx(lost, abs=block)
    pulse = np.zeros(6000)
    pulse[begin : begin + 200] = 80 * np.sin(np.pi * np.arange(200) / 200)
    assert _tail(noise + pulse, begin, begin + 200, block) == 0


def test_power_law_noise_to_the_top_of_the_band_has_no_low_pass(bench):
    b = bench(4, 900.0)
    n = len(b.t)
    f = np.arange(1, n) * RATE / (2 * n)
    ordinates = np.random.default_rng(4).normal(size=n - 1) * np.sqrt(SIGMA**2 * 30 * f**-0.5)
    noise = idct(np.concatenate([[0.0], ordinates]), norm="ortho")
    assert kinds(explain(b.record(b.noise() + noise)).axes["gx"]) == ["power_law"]


@pytest.mark.parametrize("seed", [609, 616])
def test_power_law_noise_that_is_cut_off_at_nyquist_has_no_low_pass_below_it(bench, seed):
    b = bench(seed, 600.0)
    n = len(b.t)
    f = np.arange(1, n) * RATE / (2 * n)
    noise = idct(np.concatenate([[0.0], b.rng.normal(size=n - 1) * f**-0.25]), norm="ortho")
    axis = explain(b.record(0.3 * b.noise() + 2 * SIGMA * noise / noise.std())).axes["gx"]
    assert kinds(axis) == ["power_law"]


@pytest.mark.parametrize("seed", [621, 622])
def test_a_low_pass_with_a_hundredth_of_its_noise_behind_it_is_one(bench, seed):
    b = bench(seed, 540.0)
    keep = np.exp(-2 * np.pi * 0.09)
    passed = lfilter([1 - keep], [1, -keep], b.rng.normal(0, SIGMA, len(b.t)))
    behind = b.rng.normal(0, 0.1 * SIGMA, len(b.t))
    (found,) = explain(b.record(passed + behind, lsb=1e-5)).axes["gx"].effects
    assert (found.kind, found.equivalent) == ("band_limit", ("gauss_markov",))


@pytest.mark.parametrize("begin", [4.0, 19.0])
def test_an_excursion_in_two_thirds_of_a_minute_is_found(bench, begin):
    b = bench(6, 41.0)
    box = SIGMA * ((b.t >= begin) & (b.t < begin + 6.0))
    found = explain(b.record(b.noise() + box)).axes["gx"].effects
    assert [effect.kind for effect in found] == ["excursion"]
    assert found[0].parameters["time"].value == pytest.approx(begin, abs=0.5)
