"""Signals of which the size is fitted together with the noise."""

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.fft import dct

from allanscope.explain.effect import Estimate
from allanscope.explain.effects import gauss_markov, power_law
from allanscope.explain.effects.excursion import Excursion
from allanscope.explain.effects.relaxation import Relaxation
from allanscope.explain.effects.step import Step
from allanscope.explain.regression import joint_fit, relaxing_ordinates, step_ordinates
from allanscope.explain.series import series_of
from allanscope.explain.slow_waves import SlowWaves
from allanscope.explain.view import View
from allanscope.noise.grid import Grid
from support.thinned import RATE, thinned

ROWS = 40_000


@pytest.mark.parametrize("excluded", [(), ((0.01, 0.05), (2.0, 3.0))])
def test_one_signal_is_fitted_by_the_loop_as_several_are(excluded: tuple) -> None:
    rng = np.random.default_rng(11)
    noise = rng.normal(0, 0.02, ROWS) + np.cumsum(rng.normal(0, 2e-6, ROWS))
    values = noise + 0.003 * (np.arange(ROWS) > 25_000)
    view = View.of(series_of(thinned(values[:, np.newaxis])), "gx", None)
    view = replace(view, excluded=excluded)
    column = step_ordinates(view.grid, 25_001, view.grid.low)
    one = joint_fit(view, column)
    # Beside a signal that is nothing the numpy definition has two to fit.
    both = joint_fit(view, np.array([column, np.zeros_like(column)]))
    assert one.gain == pytest.approx(both.gain, abs=1e-6)
    assert one.amplitude[0] == pytest.approx(both.amplitude[0], rel=1e-9)
    assert one.covariance[0, 0] == pytest.approx(both.covariance[0, 0], rel=1e-9)
    assert one.powers == pytest.approx(both.powers, rel=1e-6)
    assert one.power == pytest.approx(both.power, rel=1e-9)
    assert abs(one.amplitude[0] - 0.003) < 4 * np.sqrt(one.covariance[0, 0])


@pytest.mark.parametrize("kind", [Step, Excursion, Relaxation])
def test_a_jump_is_estimated_again_where_its_frequencies_are_cut_out(kind: type) -> None:
    """A range without a name may grow over them; its size is then unknown, not an error."""
    values = np.random.default_rng(3).normal(0, 0.02, ROWS) + 0.01 * (np.arange(ROWS) > 20_000)
    view = View.of(series_of(thinned(values[:, np.newaxis])), "gx", None)
    given = {"time": 200.0, "size": 0.01, "duration": 30.0, "time_constant": 10.0, "lasting": 0.004}
    wanted = {field.name for field in fields(kind)}
    jump = kind(**{name: Estimate(value) for name, value in given.items() if name in wanted})
    found = jump.refine(view.without_range(0.0, RATE / 4))
    assert found is None or found.finished().effect.size.value == 0.0


@pytest.mark.parametrize("fit", [gauss_markov._candidate, power_law._candidate])
def test_a_process_of_no_size_gains_nothing(fit: Callable) -> None:
    """Beside it the noise is fitted again, which is no gain of the process."""
    values = np.diff(np.random.default_rng(5).normal(0, 0.02, ROWS + 1))  # rises with frequency
    view = View.of(series_of(thinned(values[:, np.newaxis])), "gx", None)
    found = fit(view, 0.5, 1.5)
    assert found.finished() is found
    assert found.gain == 0.0


@pytest.mark.parametrize("at", [0, 1, 4001, 8999])
@pytest.mark.parametrize("tau", [1e-3, 0.3, 5.0, 1e5])
def test_a_relaxation_has_the_ordinates_of_the_transform(at: int, tau: float) -> None:
    grid = Grid(9001, RATE)
    since = np.arange(grid.n) - at
    creep = np.where(since >= 0, np.exp(-np.maximum(since, 0) / (tau * RATE)), 0.0)
    expected = dct(creep, norm="ortho")[1:501]
    found = relaxing_ordinates(grid, at, tau, 500)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("cycles", [3.0, 3.25, 7.3, 20.5, 39.75])
@pytest.mark.parametrize("rows", [4096, 62_401, 9001])
def test_waves_of_few_cycles_have_the_ordinates_of_the_transform(cycles: float, rows: int) -> None:
    grid = Grid(rows, RATE)
    wave = np.exp(2j * np.pi * cycles * np.arange(rows) / rows)
    pair = SlowWaves.of(grid, np.array([cycles * RATE / rows])).pair(0)
    expected = [dct(part, norm="ortho")[1 : grid.low + 1] for part in (wave.real, wave.imag)]
    np.testing.assert_allclose(pair, expected, atol=1e-9 * np.abs(expected).max())


def test_the_scan_has_the_gain_of_weighted_least_squares() -> None:
    grid = Grid(62_401, RATE)
    rng = np.random.default_rng(12)
    weight, data = 1 / (1e-3 + rng.random(grid.low)), rng.normal(size=grid.low)
    weight[50:60] = 0.0
    waves = SlowWaves.of(grid, np.arange(3.0, 40.0, 0.25) * RATE / grid.n)
    gains = waves.gains(weight, data)
    for index in (0, 1, 50, 147):
        pair = waves.pair(index) * np.sqrt(weight)
        fitted, *_ = np.linalg.lstsq(pair.T, data * np.sqrt(weight), rcond=None)
        assert gains[index] == pytest.approx(np.sum((fitted @ pair) ** 2) / 2, rel=1e-9)
