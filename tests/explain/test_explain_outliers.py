"""One bad sample is one outlier, wherever it is and however large."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.explain.effects import KINDS
from allanscope.explain.series import Series
from allanscope.explain.view import View

SIGMA = 4e-3 * 52.0**0.5


def found_with(b, at, sizes):
    column = b.noise()
    column[at] = column.mean() + np.array(sizes) * SIGMA
    return explain(b.record(column, lsb=SIGMA / 50)).axes["gx"]


@pytest.mark.parametrize("at", [-1, 0, 1000])
@pytest.mark.parametrize("size", [20.0, 300.0, -3000.0])
def test_the_neighbours_of_a_bad_sample_are_good(bench, at, size):
    b = bench(570, 120.0)
    found = found_with(b, [at], [size])
    (effect,) = found.effects
    assert effect.kind == "outliers"
    assert effect.parameters["count"].value == 1
    assert found.coefficients_after["N"].value == pytest.approx(4e-3, rel=0.05)


def test_a_small_bad_sample_beside_a_large_one_is_found_as_well(bench):
    b = bench(571, 120.0)
    (effect,) = found_with(b, [1000, 1012, 1017], [500.0, -30.0, 30.0]).effects
    assert effect.kind == "outliers"
    assert effect.parameters["count"].value == 3


def test_a_spike_on_three_rows_and_others_of_every_size_are_outliers(bench):
    """A pulse behind a low-pass, and two more: each is 2 to 5 times as far out as the next."""
    b = bench(573, 60.0)
    at = [160, 164, 165, 166, 167, 168, 172, 500, 723, 1844, 2500]
    sizes = [-3.3, -5.0, -460.0, -54.0, -87.0, -7.0, -3.3, 4.8, 6.5, -14.0, -4.8]
    found = found_with(b, at, sizes)
    (effect,) = (one for one in found.effects if one.kind == "outliers")
    assert effect.parameters["count"].value >= 3
    assert found.coefficients_after["N"].value == pytest.approx(4e-3, rel=0.05)


def view_of(samples, step=0.0):
    rows = samples[:, np.newaxis]
    series = Series(("gx",), rows, 50.0, 1, (1e-9,), None, np.zeros(len(rows), np.bool_))
    return View(series, series.grid, "gx", samples, step)


@pytest.mark.parametrize("share", [0.004, 0.016])
def test_many_bad_samples_are_outliers_and_heavy_tails_are_none(bench, share):
    b = bench(9)
    samples, bad = b.rng.normal(size=12_000), b.rng.random(12_000) < share
    samples[bad] += 20 * b.rng.choice([-1, 1], bad.sum())
    (found,) = KINDS["outliers"].candidates(view_of(samples))
    assert found.effect.count.value == bad.sum()
    for freedom in (1, 2, 4):
        assert not list(KINDS["outliers"].candidates(view_of(b.rng.standard_t(freedom, 12_000))))


def test_a_sample_apart_from_heavy_tails_is_an_outlier(bench):
    """What is 100 deviations off is none of tails that reach 10, wherever these come from."""
    b = bench(572)
    samples = b.rng.standard_t(6, 12_000)
    assert not list(KINDS["outliers"].candidates(view_of(samples)))
    samples[4000] = 100.0
    (found,) = KINDS["outliers"].candidates(view_of(samples))
    assert found.effect.count.value == 1


@pytest.mark.parametrize(("freedom", "rows"), [(3, 2000), (5, 2000), (5, 500)])
def test_the_largest_of_heavy_tails_in_a_short_record_are_no_outliers(bench, freedom, rows):
    """Where few are far out it is the kurtosis that tells tails: one record in ten is a mistake."""
    b = bench(573)
    records = (b.rng.standard_t(freedom, rows) for _ in range(40))
    assert sum(bool(list(KINDS["outliers"].candidates(view_of(x)))) for x in records) <= 2
    samples = b.rng.normal(size=rows)
    samples[rows // 2] = 8.0
    assert list(KINDS["outliers"].candidates(view_of(samples)))


def test_the_next_code_is_no_outlier_where_nearly_all_samples_have_one_code(bench):
    b = bench(574)
    level = np.linspace(0.0, 0.3, 12_000)
    samples = np.round(level + b.rng.normal(0, 0.09, len(level)))
    assert 10 < np.count_nonzero(samples) < 200
    assert not list(KINDS["outliers"].candidates(view_of(samples, step=1.0)))
    samples[4000] = 1000.0
    (found,) = KINDS["outliers"].candidates(view_of(samples, step=1.0))
    assert found.effect.count.value == 1


def test_knocks_of_all_sizes_are_outliers_where_the_core_is_gaussian(bench):
    """As of a desk in use: 60 of 20,000, of 5 to 60 deviations, without a gap between sizes."""
    b = bench(575)
    samples = b.rng.normal(size=20_000)
    at = b.rng.choice(len(samples), 60, replace=False)
    samples[at] += b.rng.choice([-1, 1], 60) * 5 * (1 + b.rng.pareto(2.0, 60))
    (found,) = KINDS["outliers"].candidates(view_of(samples))
    beyond = np.count_nonzero(np.abs(samples[at]) > 6)
    assert 0.9 * beyond <= found.effect.count.value <= 60


@pytest.mark.parametrize("rows", [20, 100])
def test_bursts_of_noise_are_no_outliers(bench, rows):
    b = bench(576)
    for _ in range(8):
        samples = b.rng.normal(size=12_000)
        for first in b.rng.integers(0, len(samples) - rows, 6):
            samples[first : first + rows] *= 6.0
        assert not list(KINDS["outliers"].candidates(view_of(samples)))
