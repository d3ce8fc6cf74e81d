"""One bad sample is one outlier, wherever it is and however large."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain

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
