"""What a component puts into the bins, against the mean over every ordinate in them."""

import numpy as np
import pytest

from allanscope.noise import relative_bounds
from allanscope.noise.components import BandPassed, Narrowband, PeakFiltered, WanderingLine, White
from allanscope.noise.grid import Grid


@pytest.mark.parametrize("stride", [1, 8])
@pytest.mark.parametrize("bandwidth", [1e-4, 0.01, 0.3, 2.0])
@pytest.mark.parametrize("kind", [Narrowband, WanderingLine, BandPassed, PeakFiltered])
def test_a_narrow_band_is_summed_over_its_ordinates(kind, bandwidth, stride):
    grid = Grid(60_000, 104.0 / stride, stride)
    band = kind(2.0, 3.7, bandwidth)
    each = grid.bin_means(band.spectrum(grid.frequency, grid.dt, stride))
    seen = each > 1e-6 * each.max()
    np.testing.assert_allclose(grid.column(band)[seen], each[seen], rtol=1e-4)


@pytest.mark.parametrize("stride", [1, 8])
@pytest.mark.parametrize("kind", [Narrowband, PeakFiltered, WanderingLine, White])
def test_what_a_component_gives_every_ordinate_is_its_spectrum_there(kind, stride):
    grid = Grid(6001, 104.0 / stride, stride)
    one = kind(2.0) if kind is White else kind(2.0, 3.7, 0.01)
    every = one.spectrum(grid.frequency, grid.dt, stride)
    np.testing.assert_allclose(grid.everywhere(one), every, rtol=1e-10)


@pytest.mark.parametrize("rows", [3, 130, 5000, 70_001])
def test_between_nodes_the_logarithm_is_linear(rows):
    grid = Grid(rows, 104.0)
    at_nodes = np.exp(9 * np.sin(np.arange(len(grid.nodes)))) / grid.nodes**2
    at_nodes[-1] = 0.0  # as behind a filter with a zero at the top
    known = np.log(np.maximum(at_nodes, 1e-300))
    between = np.exp(np.interp(np.arange(1.0, rows), grid.nodes, known))
    np.testing.assert_allclose(grid.interpolate(at_nodes), between, rtol=1e-11)


def test_a_narrow_band_costs_no_more_in_a_record_of_weeks():
    model = [White(4e-3), Narrowband(1e-3, 20.0, 0.3)]
    bounds = relative_bounds(model, 1 / 104, 1.5e7)
    assert bounds["N"] == pytest.approx(1 / np.sqrt(2 * 1.5e7 * 104), rel=0.05)
    assert 0 < bounds["sigma"] < 1e-2
