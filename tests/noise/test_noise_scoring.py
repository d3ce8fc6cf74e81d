"""Shapes of several parts are found together, from a beginning that is off."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.noise import NoiseModel
from allanscope.noise.components import Narrowband, White
from allanscope.noise.evidence import Ordinates
from allanscope.noise.filters import Butterworth
from allanscope.noise.grid import grid_of
from allanscope.noise.likelihood import Likelihood
from allanscope.noise.scoring import climb

BANDS = (Narrowband(1.0, 18.0, 1.5), Narrowband(0.7, 20.0, 0.8))
GRID = grid_of(100_000, 104.0).finer(tuple(one.band for one in BANDS))
TRUE = NoiseModel((White(0.05), *BANDS), GRID.dt, (Butterworth(22.0, 2.0),))


def likelihood_of(scatter: np.ndarray | float = 1.0) -> Likelihood:
    power = Likelihood([Ordinates(GRID, GRID.count, GRID.count)]).expected(TRUE)
    return Likelihood([Ordinates(GRID, power * scatter, GRID.count)])


@pytest.mark.parametrize("off", [0.9, 1.1])
def test_bands_that_overlap_and_the_low_pass_behind_them_are_found_together(off):
    likelihood, shapes = likelihood_of(), sorted(TRUE.shapes)
    true = np.array([TRUE.number(free) for free in shapes])
    moved = true * np.where(true > 15, 1 + (off - 1) / 5, off)  # frequencies by less than a width
    start = likelihood.amplitudes(TRUE.with_numbers(shapes, moved))
    found = climb(start, shapes, 1e-6)
    np.testing.assert_allclose([found.model.number(free) for free in shapes], true, rtol=1e-3)
    assert found.model.value("N") == pytest.approx(0.05, rel=1e-3)
    assert start.loglik < likelihood.of(TRUE) - 1000


def test_they_scatter_as_their_information_says():
    """Errors of the joint maximum over those of the information, with all numbers free."""
    shapes, rng, z = sorted(TRUE.shapes), np.random.default_rng(1), []
    for _ in range(30):
        scatter = rng.chisquare(GRID.count) / GRID.count
        found = climb(likelihood_of(scatter).amplitudes(TRUE), shapes, 1e-3).all_free()
        at = [found.free.index(free) for free in shapes]
        error = np.log([found.model.number(free) / TRUE.number(free) for free in shapes])
        z.append(error / found.relative_sd()[at])
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.25)


def test_what_is_at_its_bound_stays_there():
    shapes = [free for free in TRUE.shapes if TRUE.quantity(free).name == "order"]
    steepest = TRUE.quantity(shapes[0]).upper
    sharp = NoiseModel(TRUE.components, GRID.dt, (Butterworth(22.0, steepest),))
    power = Likelihood([Ordinates(GRID, GRID.count, GRID.count)]).expected(sharp)
    power[GRID.centre > 22.0] *= 1e-12
    likelihood = Likelihood([Ordinates(GRID, power, GRID.count)])
    found = climb(likelihood.amplitudes(sharp), shapes, 1e-3)
    assert found.model.number(shapes[0]) == pytest.approx(steepest)
