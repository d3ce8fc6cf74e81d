"""A level that hops a few times, or in one stretch only, is events and no telegraph signal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from allanscope.explain import explain
from allanscope.explain.effects import random_telegraph
from support.measured import MEASURED
from support.thinned import thinned

SIGMA = 4e-3 * 52.0**0.5


def kinds(b, signal):
    found = explain(b.record(b.noise() + signal, lsb=SIGMA / 50)).axes["gx"]
    return [effect.kind for effect in found.effects]


def hops(b, at_s, size):
    """Return a level that hops between two values at these times."""
    return size * np.where(np.searchsorted(at_s, b.t) % 2, 1.0, -1.0)


@pytest.mark.parametrize("seed", range(540, 543))
def test_hops_in_one_stretch_are_no_telegraph_signal(bench, seed):
    b = bench(seed, 120.0)
    shock = hops(b, 66.0 + np.sort(b.rng.uniform(0, 3, 8)), 6 * SIGMA)
    assert "random_telegraph" not in kinds(b, shock)


@pytest.mark.parametrize("seed", range(543, 546))
def test_half_a_dozen_hops_are_steps_and_excursions(bench, seed):
    b = bench(seed, 600.0)
    at_s = np.array([50.0, 140.0, 230.0, 350.0, 430.0, 540.0]) + b.rng.uniform(-20, 20, 6)
    assert "random_telegraph" not in kinds(b, hops(b, at_s, 3 * SIGMA))


@pytest.mark.parametrize("seed", range(546, 549))
def test_hops_all_along_are_a_telegraph_signal(bench, seed):
    b = bench(seed, 600.0)
    at_s = np.sort(b.rng.uniform(0, 600, 24))
    assert kinds(b, hops(b, at_s, 3 * SIGMA)) == ["random_telegraph"]


@pytest.mark.parametrize("seed", [551, 552])
def test_hops_are_found_where_the_spectrum_shows_no_correlated_noise(bench, seed, monkeypatch):
    # Loud slow hops in a short record have the spectrum of a random walk.
    monkeypatch.setattr(random_telegraph.GaussMarkov, "propose", lambda view: [])
    b = bench(seed, 60.0)
    at_s = np.sort(b.rng.uniform(0, 60, 20))
    assert kinds(b, hops(b, at_s, 13 * SIGMA)) == ["random_telegraph"]


@pytest.mark.parametrize("seed", [549, 550])
def test_smooth_noise_on_two_codes_is_no_telegraph_signal(bench, seed):
    b = bench(seed, 300.0)
    smooth = np.convolve(b.rng.normal(size=len(b.t) + 1), [0.7, 0.5], "valid")
    record = b.record(0.5 + 0.7 * smooth, lsb=1.0)
    assert "random_telegraph" not in [e.kind for e in explain(record).axes["gx"].effects]


def test_a_shock_in_a_car_is_no_telegraph_signal():
    table = pq.read_table(MEASURED / "asm330lhhx-vehicle.parquet")
    record = thinned(table["gy[dps]"].to_numpy()[:, np.newaxis], lsb=4.375e-3)
    found = explain(replace(record, axes=("gy",), rate_hz=52.0)).axes["gy"].effects
    assert "random_telegraph" not in [effect.kind for effect in found]
