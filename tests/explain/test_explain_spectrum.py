"""What the search fits beside its model is what a fit of the whole model has."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain.spectrum import SpectrumFitter
from allanscope.noise import NoiseModel
from allanscope.noise.components import Flicker, Narrowband, RandomWalk, Rounding, White
from allanscope.noise.filters import Butterworth, MovingAverage, OnePole
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


def test_groups_of_components_are_split_as_each_is_behind_the_filters():
    grid = grid_of(5000, 104.0)
    parts, low_pass = (White(1.0), Flicker(0.3), Rounding(0.1)), OnePole(10.0)
    fitter = SpectrumFitter.of(grid, NoiseModel(parts, grid.dt, (low_pass,)))
    spectrum = fitter.fit(np.full(len(fitter.dof), 2.0))
    f = np.array([0.5, 3.0, 40.0])
    first, *_, last = spectrum.model.components
    white, rounding, nothing, whole = spectrum.split([[first], [last], [], spectrum.model], f)
    np.testing.assert_allclose(white, grid.at(first, f) * low_pass.response(f, grid.dt))
    np.testing.assert_allclose(rounding, grid.at(Rounding(0.1), f))
    assert nothing.tolist() == [0.0, 0.0, 0.0]
    np.testing.assert_array_equal(whole, spectrum.at(f))


def test_the_first_ordinates_of_a_spectrum_are_those_of_all():
    grid = grid_of(20_000, 104.0)
    model = NoiseModel((White(1.0), Flicker(0.3)), grid.dt, (Butterworth(20.0, 2.0),))
    fitter = SpectrumFitter.of(grid, model)
    spectrum = fitter.fit(np.full(len(fitter.dof), 2.0))
    every = spectrum.ordinates
    for m in (1, 100, grid.low, grid.low + 100):
        np.testing.assert_array_equal(spectrum.first(m), every[:m])
    smooth = slice(100, None)  # below, the ends of the record count
    np.testing.assert_allclose(every[smooth], spectrum.at(grid.frequency[smooth]), rtol=5e-3)


@pytest.mark.parametrize("low_pass", [Butterworth(20.0, 2.0), MovingAverage.over(4, 1 / 104)])
def test_a_band_passes_the_filters_in_every_reading_of_a_spectrum(low_pass):
    grid, band = grid_of(20_000, 104.0), Narrowband(1.0, 24.0, 3.0)
    fitter = SpectrumFitter.of(grid, NoiseModel((White(1e-3), band), grid.dt, (low_pass,)))
    spectrum = fitter.spectrum(np.ones(len(fitter.dof)), np.array([1e-6, 1.0]))
    passed = low_pass.response(grid.frequency, grid.dt)
    lit = np.flatnonzero(passed > 1e-2)[100:]  # below, the ends of the record count
    through = grid.at(band, grid.frequency[lit]) * passed[lit]
    np.testing.assert_allclose(spectrum.ordinates[lit], through, rtol=5e-3)
    np.testing.assert_allclose(spectrum.at(grid.frequency[lit]), through, rtol=5e-3)
