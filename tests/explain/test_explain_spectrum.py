"""What the search fits beside its model is what a fit of the whole model has."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain.spectrum import SpectrumFitter
from allanscope.noise import NoiseModel
from allanscope.noise.components import Flicker, RandomWalk, Rounding, White
from allanscope.noise.filters import Butterworth, OnePole
from allanscope.noise.grid import grid_of


@pytest.mark.parametrize(
    "filters",
    [(OnePole(10.0),), (Butterworth(20.0, 2.0),), (OnePole(10.0), Butterworth(30.0, 3.0))],
)
def test_filters_beside_a_model_are_those_of_the_whole_model(filters):
    grid = grid_of(5000, 104.0)
    model = NoiseModel((White(1.0), Flicker(1.0), RandomWalk(1.0), Rounding(0.1)), grid.dt)
    before = SpectrumFitter.of(grid, model)
    unchanged = before.basis.columns.copy()
    found = before.plus(*filters).basis
    whole = SpectrumFitter.of(grid, model.plus(*filters)).basis
    np.testing.assert_array_equal(found.columns, whole.columns)
    np.testing.assert_array_equal(found.fixed, whole.fixed)
    assert (found.model, found.free, found.held) == (whole.model, whole.free, whole.held)
    np.testing.assert_array_equal(before.basis.columns, unchanged)
