"""Acceleration without gravity, a mean that was subtracted, a coupling capacitor."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from allanscope import analyse
from allanscope.explain import explain

N, RATE = 4e-3, 52.0
SIGMA = N * RATE**0.5


def settled(b, taps):
    """Return noise behind a filter that has forgotten its start."""
    n = len(b.t)
    long = np.concatenate([b.noise(), b.noise()])
    return lfilter(*taps, long)[-n:]


@pytest.mark.parametrize(("order", "corner", "seed"), [(1, 0.5, 721), (1, 0.1, 722), (2, 0.3, 723)])
def test_it_is_named_and_n_is_that_above_its_corner(bench, order, corner, seed):
    """Without it the deficit was unexplained."""
    b = bench(seed, 900.0)
    result = explain(b.record(settled(b, butter(order, 2 * corner / RATE, "high"))))
    axis = result.axes["gx"]
    assert [effect.kind for effect in axis.effects] == ["high_pass"]
    assert axis.explained
    assert axis.effects[0].parameters["corner"].value == pytest.approx(corner, rel=0.25)
    assert result.models_after["gx"].value("N") == pytest.approx(N, rel=0.02)
    assert "do not pass the high-pass" in axis.remarks[-1]


def test_a_running_mean_that_was_subtracted_is_one(bench):
    b = bench(724, 900.0)
    level = b.noise()
    window = np.ones(401) / 401
    axis = explain(b.record(level - np.convolve(level, window, "same"))).axes["gx"]
    assert axis.effects[0].kind == "high_pass"
    assert {effect.kind for effect in axis.effects} <= {"high_pass", "unexplained"}


@pytest.mark.parametrize("seed", range(730, 733))
def test_an_average_that_begins_with_the_record_is_one(bench, seed):
    """It forgets its first sample slowly, and what is left of that filled the lowest ordinates."""
    b, corner = bench(seed, 300.0), 0.1
    level = b.noise()
    level[0] += 1.5 * N * RATE**0.5
    keep = np.exp(-2 * np.pi * corner / RATE)
    late, _ = lfilter([1 - keep], [1, -keep], level, zi=[keep * level[0]])
    axis = explain(b.record(level - late)).axes["gx"]
    assert [effect.kind for effect in axis.effects] == ["high_pass"]
    assert axis.explained
    found = axis.effects[0].parameters["corner"]
    assert found.lower < corner < found.upper


@pytest.mark.parametrize("time_constant", [1.5, 3.0, 6.0])
def test_an_exponential_at_the_start_is_none(bench, time_constant):
    b = bench(734, 300.0)
    start = 0.2 * np.exp(-b.t / time_constant)
    white = b.rng.normal(0, N * RATE**0.5, len(b.t))
    axis = explain(b.record(white + start)).axes["gx"]
    assert "high_pass" not in [effect.kind for effect in axis.effects]


@pytest.mark.parametrize("seed", range(725, 728))
def test_a_low_pass_and_a_drift_are_none(bench, seed):
    b = bench(seed, 600.0)
    low = lfilter(*butter(1, 2 * 2.0 / RATE), b.noise())
    slow = b.noise() + 2 * N * np.sin(2 * np.pi * b.t / 400.0)
    for axis in explain(b.record(low, slow)).axes.values():
        assert "high_pass" not in [effect.kind for effect in axis.effects]


@pytest.mark.parametrize("seed", [728, 729])
def test_noise_of_the_angle_is_none(bench, seed):
    """Flicker phase noise over white noise rises all the way up."""
    b = bench(seed, 600.0)
    n = len(b.t)
    f = np.fft.rfftfreq(2 * n, 1 / RATE)
    shape = np.fft.irfft(np.fft.rfft(b.rng.standard_normal(2 * n)) * np.sqrt(f))[:n]
    axis = explain(b.record(0.25 * b.noise() + 2 * N * shape)).axes["gx"]
    assert "high_pass" not in [effect.kind for effect in axis.effects]


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_noise_with_a_shoulder_is_behind_none(seed):
    """A filter that took away the flicker or random walk which was there for it alone."""
    rng = np.random.default_rng([77, seed])
    n, rate = 9800, 100.0
    above = lfilter(*butter(1, 2 * 5.0 / rate, "high"), rng.normal(size=n))
    axis = analyse({"gx": 1e-2 * (rng.normal(size=n) + 1.5 * above)}, rate).axes["gx"]
    assert "high_pass" not in [effect.kind for effect in axis.explanation.effects]
    assert not axis.coefficients["K"].detected


@pytest.mark.parametrize("seed", [747, 760, 807])
def test_noise_that_is_louder_in_a_tenth_of_the_record_is_behind_none(bench, seed):
    """Its spectrum is smooth, so that the lowest ordinates lack power together, one time in ten."""
    b = bench(seed, 24_000 / RATE)
    noise = np.random.default_rng(seed).normal(0, SIGMA, len(b.t))
    noise[-2400:] *= 8
    found = explain(b.record(noise)).axes["gx"].effects
    assert "high_pass" not in {effect.kind for effect in found}
