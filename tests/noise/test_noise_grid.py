"""What a component puts into the bins, against the mean over every ordinate in them."""

import numpy as np
import pytest

from allanscope.noise import relative_bounds
from allanscope.noise.components import (
    BandPassed,
    MovingLine,
    Narrowband,
    PeakFiltered,
    WanderingLine,
    White,
)
from allanscope.noise.filters import Butterworth
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


@pytest.mark.parametrize("bandwidth", [1e-5, 1e-3, 0.01, 0.3, 2.0])
@pytest.mark.parametrize("stride", [1, 8])
@pytest.mark.parametrize("kind", [Narrowband, PeakFiltered, WanderingLine, BandPassed])
def test_a_peak_is_interpolated_between_nodes_beside_it(kind, stride, bandwidth):
    grid = Grid(600_001, 104.0 / stride, stride)
    above = (59.3,) if kind in (Narrowband, WanderingLine) else ()  # is seen at its alias
    for frequency in (3.7, *above):
        band = kind(2.0, frequency, bandwidth)
        nodes = grid.nodes_beside(band.peaks)
        at = nodes * (grid.rate_hz / 2 / grid.n)
        found = grid.interpolate(band.spectrum(at, grid.dt, stride), nodes)
        every = band.spectrum(grid.frequency, grid.dt, stride)
        seen = every > 1e-6 * every.max()
        np.testing.assert_allclose(found[seen], every[seen], rtol=2e-3)


def test_each_peak_of_a_line_that_moves_has_nodes():
    grid = Grid(300_001, 104.0)
    line = MovingLine(2.0, 3.7, 0.01, (-0.5, -0.2, 0.0, 0.3, 0.6))
    nodes = grid.nodes_beside(line.peaks)
    found = grid.interpolate(line.spectrum(nodes * grid.frequency[0], grid.dt), nodes)
    np.testing.assert_allclose(found, line.spectrum(grid.frequency, grid.dt), rtol=2e-3)


@pytest.mark.parametrize("rows", [3, 130, 5000, 70_001])
def test_between_nodes_the_logarithm_is_linear(rows):
    grid = Grid(rows, 104.0)
    at_nodes = np.exp(9 * np.sin(np.arange(len(grid.nodes)))) / grid.nodes**2
    at_nodes[-1] = 0.0  # as behind a filter with a zero at the top
    known = np.log(np.maximum(at_nodes, 1e-300))
    between = np.exp(np.interp(np.arange(1.0, rows), grid.nodes, known))
    np.testing.assert_allclose(grid.interpolate(at_nodes), between, rtol=1e-11)


@pytest.mark.parametrize("rows", [3, 5000, 70_001])
def test_a_filter_passes_into_a_bin_what_it_passes_into_its_ordinates(rows):
    grid, low_pass = Grid(rows, 104.0), Butterworth(9.0, 2.0)
    each = low_pass.response(grid.frequency, grid.dt)
    np.testing.assert_allclose(grid.response(low_pass), grid.bin_means(each), rtol=1e-3, atol=1e-6)
    alone = np.flatnonzero(grid.count == 1)
    np.testing.assert_allclose(grid.response(low_pass)[alone], each[grid.edges[alone]])


def test_ordinates_around_a_frequency_are_all_that_are_near(rng):
    for rows in (3, 200, 5001):
        grid = Grid(rows, 100.0)
        on = rng.choice(grid.frequency, 100)
        centres = [*rng.uniform(-5, 60, 100).tolist(), *on.tolist()]
        for centre, reach in zip(centres, rng.uniform(0, 20, 200).tolist(), strict=True):
            near, around = np.abs(grid.frequency - centre) < reach, grid.around(centre, reach)
            assert np.array_equal(np.flatnonzero(near[around]) + around.start, np.flatnonzero(near))
            assert len(near[around]) <= np.count_nonzero(near) + 6


def test_a_narrow_band_costs_no_more_in_a_record_of_weeks():
    model = [White(4e-3), Narrowband(1e-3, 20.0, 0.3)]
    bounds = relative_bounds(model, 1 / 104, 1.5e7)
    assert bounds["N"] == pytest.approx(1 / np.sqrt(2 * 1.5e7 * 104), rel=0.05)
    assert 0 < bounds["sigma"] < 1e-2
