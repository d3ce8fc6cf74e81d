"""Power without a name that several axes show is one disturbance, if they go along in it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.analysis import findings_of
from allanscope.explain import explain

RATE, SIGMA = 52.0, 4e-3 * 52.0**0.5


def swell(b, period_s):
    """Return a level that goes up and down, each time by another amount, for a part of the time."""
    pole = np.exp((-np.pi / (3 * period_s) + 2j * np.pi / period_s) / RATE)
    n = len(b.t)
    noise = lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], b.rng.standard_normal(2 * n))
    noise = noise[n:] * np.exp(-(((b.t - 2500.0) / 1500.0) ** 2))
    return noise / noise.std()


@pytest.mark.parametrize("seed", [71, 73, 78])
def test_a_swell_without_a_name_is_one_on_the_axes_that_go_along(bench, seed):
    b = bench(seed, 7200.0)
    room, other = swell(b, 400.0), swell(b, 400.0)
    sizes = ((0.4, room), (-0.3, room), (0.4, other))
    result = explain(b.record(*(b.noise() + a * SIGMA * c for a, c in sizes)))
    nameless = {
        axis: [e for e in one.effects if e.kind == "unexplained"]
        for axis, one in result.axes.items()
    }
    assert [one.axes for (one,) in nameless.values()] == [("gx", "gy"), ("gx", "gy"), ("gz",)]
    assert sorted(found.axes for found in findings_of(nameless)) == [("gx", "gy"), ("gz",)]
