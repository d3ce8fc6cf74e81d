"""Power without a name that several axes show is one disturbance, if they go along in it."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.analysis import findings_of
from allanscope.explain import explain

SIGMA = 4e-3 * 52.0**0.5


def cycle(b, mean_s):
    """Return an air conditioner: a triangle whose period is another one each time."""
    ends = np.cumsum(b.rng.uniform(0.6, 1.4, 60) * mean_s)
    return np.abs(np.interp(b.t, np.append(0.0, ends), np.arange(61.0)) % 1 - 0.5) - 0.25


@pytest.mark.parametrize("seed", [71, 73, 78])
def test_a_cycle_without_a_name_is_one_on_the_axes_that_go_along(bench, seed):
    b = bench(seed, 7200.0)
    room, other = cycle(b, 400.0), cycle(b, 400.0)
    sizes = ((1.5, room), (-1.0, room), (1.5, other))
    result = explain(b.record(*(b.noise() + a * SIGMA * c for a, c in sizes)))
    nameless = {
        axis: [e for e in one.effects if e.kind == "unexplained"]
        for axis, one in result.axes.items()
    }
    assert [one.axes for (one,) in nameless.values()] == [("gx", "gy"), ("gx", "gy"), ("gz",)]
    assert sorted(found.axes for found in findings_of(nameless)) == [("gx", "gy"), ("gz",)]
