"""A loud effect brings no second name beside it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import idct

from allanscope.explain import explain
from allanscope.explain.effects.shock import _tail

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


def test_a_loud_shock_rings_on_and_a_pulse_to_one_side_does_not():
    t = np.arange(2000) / 960.0
    rings = 120 * np.exp(-t / 0.4) * np.cos(2 * np.pi * 144 * t)
    loud = int(960 * 0.4 * np.log(120 / 6))
    lost = 960 * 0.4 * np.log(120 / 0.3)
    assert loud + _tail(rings, 0, loud, 1.0) == pytest.approx(lost, rel=0.1)
    pulse = np.zeros(2000)
    pulse[900:1100] = 80 * np.sin(np.pi * np.arange(200) / 200)
    assert _tail(pulse, 900, 1100, 1.0) == 0
    assert _tail(0.1 * rings, 0, loud, 1.0) == 0


def test_power_law_noise_to_the_top_of_the_band_has_no_low_pass(bench):
    b = bench(4, 900.0)
    n = len(b.t)
    f = np.arange(1, n) * RATE / (2 * n)
    ordinates = np.random.default_rng(4).normal(size=n - 1) * np.sqrt(SIGMA**2 * 30 * f**-0.5)
    noise = idct(np.concatenate([[0.0], ordinates]), norm="ortho")
    assert kinds(explain(b.record(b.noise() + noise)).axes["gx"]) == ["power_law"]


@pytest.mark.parametrize("begin", [4.0, 19.0])
def test_an_excursion_in_two_thirds_of_a_minute_is_found(bench, begin):
    b = bench(6, 41.0)
    box = SIGMA * ((b.t >= begin) & (b.t < begin + 6.0))
    found = explain(b.record(b.noise() + box)).axes["gx"].effects
    assert [effect.kind for effect in found] == ["excursion"]
    assert found[0].parameters["time"].value == pytest.approx(begin, abs=0.5)
