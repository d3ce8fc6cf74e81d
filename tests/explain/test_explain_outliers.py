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
    column[at] += np.array(sizes) * SIGMA
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


def view_of(samples):
    rows = samples[:, np.newaxis]
    series = Series(("gx",), rows, 50.0, 1, (1e-9,), None, np.zeros(len(rows), np.bool_))
    return View(series, series.grid, "gx", samples, 0.0)


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
