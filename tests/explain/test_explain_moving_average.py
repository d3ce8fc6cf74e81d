"""The mean of the last rows, which firmware sends at every row, beside what else there may be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.explain import explain

N, RATE = 4e-3, 52.0
SIGMA = N * RATE**0.5


def averaged(x, rows):
    total = np.concatenate([[0.0], np.cumsum(x)])
    return (total[rows:] - total[:-rows]) / rows


def found_in(b, values, lsb=SIGMA / 1000):
    result = explain(b.record(values, lsb=lsb))
    return result.axes["gx"], result.models_after["gx"].value("N")


@pytest.mark.parametrize(("rows", "seed"), [(3, 701), (5, 702), (12, 703), (32, 704)])
def test_its_rows_are_counted_and_n_is_that_of_the_sensor(bench, rows, seed):
    """Without it N was 0.5 of 4, or 0 beside resonances without a cause."""
    b = bench(seed, 600.0)
    axis, n = found_in(b, averaged(b.noise(), rows))
    assert [effect.kind for effect in axis.effects] == ["band_limit"]
    assert f"a moving average over {rows} rows" in axis.effects[0].evidence["words"]
    # 2 sd: the ordinates below the cutoff, of which there are as many as rows / (1.1 rows).
    assert n == pytest.approx(N, rel=2 / np.sqrt(2 * 600 * RATE * 0.886 / rows))
    assert axis.explained


def test_a_line_and_a_step_behind_it_are_found_and_nothing_else(bench):
    b = bench(705, 600.0)
    tone = 5 * N * np.sin(2 * np.pi * 9.0 * b.t)
    axis, _ = found_in(b, averaged(b.noise() + tone + 10 * N * (b.t > 250.0), 4))
    found = {effect.kind: effect for effect in axis.effects}
    assert found.keys() == {"band_limit", "sinusoid", "step"}
    assert found["sinusoid"].parameters["frequency"].value == pytest.approx(9.0, abs=1e-3)
    assert found["step"].parameters["size"].value == pytest.approx(10 * N, rel=0.2)


def test_steps_of_the_values_fill_its_zeros(bench):
    b = bench(706, 600.0)
    axis, n = found_in(b, averaged(b.noise(), 8), lsb=SIGMA / 4)
    assert [effect.kind for effect in axis.effects] == ["band_limit"]
    assert "over 8 rows" in axis.effects[0].evidence["words"]
    assert n == pytest.approx(N, rel=0.04)


@pytest.mark.parametrize("pole", [0.9, 0.5])
def test_an_exponential_average_is_none(bench, pole):
    b = bench(707, 600.0)
    axis, n = found_in(b, lfilter([1 - pole], [1, -pole], b.noise()))
    assert [effect.kind for effect in axis.effects] == ["band_limit"]
    assert "moving average" not in axis.effects[0].evidence["words"]
    assert n == pytest.approx(N, rel=0.05)
