"""Optimisers of our own against those of scipy, which take the same steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar, nnls

from allanscope.optimise import least_nonnegative, minimise, minimise_between


@pytest.mark.parametrize("seed", range(12))
def test_a_simplex_goes_where_that_of_scipy_goes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = 1 + seed % 4
    mixed, centre = rng.standard_normal((size, size)), rng.standard_normal(size)
    turns = (None, 60 * size, 15)[seed % 3]  # the last is too few

    def loss(point: NDArray[np.float64]) -> float:
        rings = float(np.sum(np.cos(3 * point)))
        return float(np.sum((mixed @ (point - centre)) ** 2)) + 0.1 * rings

    first, steps = rng.standard_normal(size), np.diag(rng.uniform(0.05, 1.0, size))
    found = minimise(loss, first, steps, x_within=1e-3, within=1e-3, turns=turns)
    options: Any = {
        "xatol": 1e-3,
        "fatol": 1e-3,
        "maxiter": turns or 200 * size,
        "initial_simplex": np.vstack([first, first + steps]),
    }
    theirs: Any = minimize(loss, first, method="Nelder-Mead", options=options)
    assert found.x.tolist() == theirs.x.tolist()
    assert (found.value, found.converged) == (theirs.fun, theirs.success)


@pytest.mark.parametrize("seed", range(12))
def test_a_minimum_between_two_bounds_is_that_of_scipy(seed: int) -> None:
    turn = np.random.default_rng(seed).uniform(-4.0, 4.0)

    def loss(x: float) -> float:
        return float(np.sin(turn * x) + 0.1 * x * x)

    theirs = minimize_scalar(loss, bounds=(-3, 4), method="bounded", options={"xatol": 0.01})
    assert minimise_between(loss, -3.0, 4.0, 0.01) == (theirs.x, theirs.fun)


@pytest.mark.parametrize("seed", range(12))
def test_no_number_is_negative_and_the_squares_are_as_small_as_scipys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    design, wanted = rng.standard_normal((12, 4)), rng.standard_normal(12)
    design[:, 3] = 0.0 if seed % 3 == 0 else design[:, 0]  # nothing, or the same again
    found, theirs = least_nonnegative(design, wanted), nnls(design, wanted)[0]
    assert np.all(found >= 0)
    left, least = (float(np.sum((design @ one - wanted) ** 2)) for one in (found, theirs))
    assert left == pytest.approx(least, rel=1e-12)
