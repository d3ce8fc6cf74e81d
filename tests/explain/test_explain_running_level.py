"""What cannot hold a line is told apart from what may, and never wrongly."""

import numpy as np
import pytest

from allanscope.explain.running_level import may_hold_a_line, running_level


@pytest.mark.parametrize("slope", [0.0, 0.5, 2.0])
def test_nothing_that_reaches_the_ratio_is_missed(slope: float) -> None:
    rng = np.random.default_rng(5)
    told = []
    for _ in range(300):
        size = int(rng.integers(70, 5000))
        tail = rng.exponential(size=size) * np.arange(1.0, size + 1) ** -slope
        tail[rng.integers(size)] *= rng.uniform(1.0, 8.0)
        highest = float(np.max(tail / running_level(tail)))
        assert may_hold_a_line(tail, highest)
        told.append(not may_hold_a_line(tail, 1.5 * highest))
    assert np.mean(told) > 0.5  # and most of what cannot reach it is left at that
