"""The optimisers of a search: those of SciPy, step for step, without what that package loads."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import brentq, minimize, minimize_scalar, nnls

from allanscope.optimise import least_nonnegative, minimise, minimise_between, root_between


def rough(rng, size):
    """Return a function with several minima."""
    matrix, centre = rng.normal(size=(size, size)), rng.normal(size=size)
    return lambda p: float(np.sum((matrix @ (p - centre)) ** 2) + 0.1 * np.sum(np.cos(3 * p)))


@pytest.mark.parametrize("seed", range(20))
def test_a_simplex_goes_the_way_of_scipys(seed):
    rng = np.random.default_rng(seed)
    size = 1 + seed % 4
    loss, first, steps = rough(rng, size), rng.normal(size=size), 0.2 * np.eye(size)
    for turns in (5, 200):
        options = {"initial_simplex": np.vstack([first, first + steps]), "maxiter": turns}
        known = minimize(loss, first, method="Nelder-Mead", options=options)
        found = minimise(loss, first, steps, turns=turns)
        assert np.array_equal(found.x, known.x)
        assert (found.value, found.converged) == (known.fun, known.success)
    np.testing.assert_allclose(
        minimise(loss, first).x, minimize(loss, first, method="Nelder-Mead").x, atol=1e-4
    )


@pytest.mark.parametrize("seed", range(20))
def test_a_minimum_between_bounds_is_found_the_way_of_scipys(seed):
    rng = np.random.default_rng(seed)
    low, high = np.sort(rng.uniform(-3, 3, 2)).tolist()

    def loss(x):
        return float(np.cos(3 * x) + 0.1 * x**2)

    known = minimize_scalar(
        loss, (low, high), (low, high), method="bounded", options={"xatol": 1e-3}
    )
    assert minimise_between(loss, low, high, within=1e-3) == (known.x, known.fun)


@pytest.mark.parametrize("seed", range(20))
def test_a_root_is_exact_to_the_last_digits(seed):
    shift = float(np.random.default_rng(seed).normal())

    def function(x):
        return float(np.expm1(x - shift) + 0.01 * np.sin(5 * x))

    found = root_between(function, -40.0, 50.0)
    assert found == pytest.approx(brentq(function, -40.0, 50.0), abs=1e-11)
    assert root_between(lambda x: x, 0.0, 1.0) == 0.0
    with pytest.raises(ValueError, match="same sign"):
        root_between(lambda x: x * x + 1.0, -1.0, 1.0)


@pytest.mark.parametrize("seed", range(20))
def test_no_level_is_negative_and_the_squares_are_least(seed):
    rng = np.random.default_rng(seed)
    design, wanted = rng.normal(size=(12, 1 + seed % 7)), rng.normal(size=12)
    np.testing.assert_allclose(
        least_nonnegative(design, wanted), nnls(design, wanted)[0], atol=1e-9
    )


def test_levels_of_columns_of_many_decades_are_scipys():
    tau = 2.0 ** np.arange(18)
    design = tau[:, np.newaxis] ** np.array([-2.0, -1.0, 0.0, 1.0])
    design /= np.linalg.norm(design, axis=0)
    wanted = design @ np.array([1.0, 0.0, 3.0, 1e-3])
    found = least_nonnegative(design, wanted)
    np.testing.assert_allclose(found, nnls(design, wanted)[0], atol=1e-9)


def test_an_analysis_loads_no_package_of_optimisers():
    program = """
import sys
import allanscope.analysis.summary, allanscope.explain.loop, allanscope.pipeline.analyse_file
assert not [name for name in sys.modules if name.startswith("scipy.optimize")]
"""
    subprocess.run([sys.executable, "-c", program], check=True)
