"""A sensor warms up in minutes, its board in an hour: two exponentials, if the record shows two."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain

SIGMA = 4e-3 * 52.0**0.5
HOUR_S = 3600.0


def warming(b, *parts):
    """Return noise with exponentials of (amplitude in sigma, time constant in s)."""
    return b.noise() + sum(size * SIGMA * np.exp(-b.t / tau) for size, tau in parts)


def found(b, rows):
    return explain(b.record(rows)).axes["gx"]


def kinds(axis):
    return sorted(effect.kind for effect in axis.effects)


@pytest.mark.parametrize(
    "parts",
    [
        ((4.0, 40.0), (3.0, 900.0)),
        ((4.0, 40.0), (-3.0, 900.0)),
        ((-5.0, 60.0), (-5.0, 600.0)),
    ],
)
@pytest.mark.parametrize("seed", [51, 52])
def test_two_exponentials_are_two_warm_ups(bench, seed, parts):
    one = found(b := bench(seed, HOUR_S), warming(b, *parts))
    assert kinds(one) == ["warm_up", "warm_up"]
    pairs = [
        (e.parameters["time_constant"].value, e.parameters["amplitude"].value) for e in one.effects
    ]
    for (tau, size), (size_true, tau_true) in zip(sorted(pairs), parts, strict=True):
        assert tau == pytest.approx(tau_true, rel=0.4)
        assert size == pytest.approx(size_true * SIGMA, rel=0.25)
    for effect in one.effects:
        assert effect.evidence["held_out_nats"] > effect.evidence["held_out_nats_se"]
    assert one.explained


@pytest.mark.parametrize("seed", [53, 54, 55])
@pytest.mark.parametrize("tau", [60.0, 600.0])
def test_one_exponential_is_one_however_large(bench, seed, tau):
    b = bench(seed, HOUR_S)
    assert kinds(found(b, warming(b, (30.0, tau)))) == ["warm_up"]


@pytest.mark.parametrize("seed", [57, 58, 61])
def test_a_step_that_comes_later_stays_one(bench, seed):
    b = bench(seed, HOUR_S)
    rows = warming(b, (4.0, 40.0), (3.0, 900.0)) + 0.5 * SIGMA * (b.t > 2500.0)
    assert kinds(found(b, rows)) == ["step", "warm_up", "warm_up"]


@pytest.mark.parametrize("seed", [57, 58])
@pytest.mark.parametrize("name", ["day", "hump", "logarithm"])
def test_a_drift_of_another_form_is_not_two_warm_ups(bench, seed, name):
    b = bench(seed, HOUR_S)
    u = b.t / HOUR_S
    drift = {
        "day": np.sin(2 * np.pi * 0.7 * u + seed),
        "hump": np.exp(-(((u - 0.4) / 0.2) ** 2)),
        "logarithm": 2.0 * np.log1p(b.t / 20.0),
    }[name]
    names = kinds(found(b, b.noise() + 3.0 * SIGMA * drift))
    assert "unexplained" in names
    assert "warm_up" not in names


@pytest.mark.parametrize("seed", [64, 72])
def test_the_interval_of_a_time_constant_is_that_of_its_restricted_likelihood(bench, seed):
    # A parabola leaves out 900 s in the first of these records, 40 s in the second: the random walk
    # is known from few ordinates, of which two exponentials take a part.
    b = bench(seed, HOUR_S)
    effects = found(b, warming(b, (4.0, 40.0), (3.0, 900.0))).effects
    times = sorted((e.parameters["time_constant"] for e in effects), key=lambda tau: tau.value)
    for tau, true in zip(times, (40.0, 900.0), strict=True):
        assert tau.lower < true < tau.upper
        assert tau.lower < tau.value < tau.upper
