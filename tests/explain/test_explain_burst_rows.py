"""What the search for soft shocks computes on its way."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain.burst_rows import _medians


@pytest.mark.parametrize("rows", [1, 2, 7, 4096])
def test_medians_are_those_of_numpy_to_the_last_bit(rows):
    power = np.random.default_rng(rows).exponential(size=(rows, 33)).astype(np.float32)
    np.testing.assert_array_equal(_medians(power), np.median(power, axis=0))
