"""Ranks of the truth within what a fit says of it: uniform where intervals of every level hold."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.stats import norm

from allanscope.explain.effects import KINDS

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")


@pytest.fixture(scope="module")
def benchmark():
    """Return what imports a module of the benchmarks."""
    sys.path.insert(0, BENCHMARKS)
    try:
        yield importlib.import_module
    finally:
        sys.path.remove(BENCHMARKS)


@pytest.fixture(scope="module")
def calibration(benchmark) -> ModuleType:
    return benchmark("rank_calibration")


@pytest.fixture(scope="module")
def draws(benchmark) -> ModuleType:
    return benchmark("rank_draws")


def test_ranks_of_fitted_coefficients_are_uniform(calibration, draws):
    draw, rng = draws.coefficients(26.0, 1200.0), np.random.default_rng(7)
    found = [draw(rng).ranks for _ in range(80)]
    for name in "NB":
        assert calibration.outside(np.array([one[name] for one in found if name in one])) <= 1.0


def test_the_interval_of_a_ramp_holds_it_as_often_as_it_says(draws):
    rng, held = np.random.default_rng(9), []
    for _ in range(200):
        slope = 1e-5 * draws.spread(rng, 4.0)
        fit = draws.fitted(draws.with_ramp(rng, slope), draws.RAMP_HZ)
        found = fit.coefficients["R"]
        held.append(abs(found.value - slope) < found.upper - found.value)
    assert 0.91 < np.mean(held) < 0.985  # 0.95 +- 2.5 standard errors; 0.99 by Student's t


@pytest.mark.parametrize(("width", "shift"), [(0.6, 0.0), (1.6, 0.0), (1.0, 0.6)])
def test_intervals_that_are_too_narrow_too_wide_or_shifted_leave_the_band(
    calibration, width, shift
):
    z = np.random.default_rng(3).standard_normal(200) / width + shift
    assert calibration.outside(norm.cdf(z)) > 1.0


def test_few_ranks_say_nothing_where_the_band_ends_at_nought_or_one(calibration):
    """Of 50 even ranks none is below the first percentile, which is no distance at all."""
    assert calibration.outside((np.arange(50) + 0.5) / 50) < 0.5


def test_the_rank_of_an_instant_is_a_probability_that_grows_with_the_truth(draws):
    """Within a row it is as likely everywhere, beyond it falls off; never less than 0."""
    for half in (0.3, 3.0):  # narrower and wider than a row of 1 s
        found = draws.Parameter(10.0, 10.0 - half, 10.0 + half)
        ranks = [draws.rank_of_parameter(found, x, 1.0) for x in 10 + half * np.linspace(-3, 3, 61)]
        assert np.all(np.diff(ranks) > 0)
        assert ranks[20] == pytest.approx(0.025)
        assert ranks[40] == pytest.approx(0.975)
        assert 0 < ranks[0] < ranks[-1] < 1


def test_an_interval_that_ends_at_its_value_has_all_confidence_before_it(draws):
    found = draws.Parameter(10.0, 4.0, 10.0)
    assert draws.rank_of_parameter(found, 4.0, 1.0) == pytest.approx(0.05)
    assert draws.rank_of_parameter(found, 10.0, 1.0) == 1.0


def test_the_band_holds_nineteen_times_in_twenty(calibration):
    rng, points = np.random.default_rng(11), calibration.POINTS
    low, high = calibration.band(100)
    held = 0
    for _ in range(400):
        share = np.searchsorted(np.sort(rng.random(100)), points, side="right") / 100
        held += bool(np.all((share >= low) & (share <= high)))
    assert 0.91 < held / 400 < 0.985


def test_every_kind_that_has_an_interval_is_drawn(draws, benchmark):
    hider = benchmark("rank_effects").Hider
    drawn = {getattr(hider(np.random.default_rng(1)), one)().kind for one in draws.STUDIES}
    assert drawn == {name for name, kind in KINDS.items() if not kind.is_coefficient} - {
        "unexplained",  # what has no name has no numbers
        "motion",  # is not calibrated: its rows are removed
    }


def test_a_draw_finds_an_effect_and_ranks_its_numbers(draws):
    for study, numbers in (("step", {"time", "size"}), ("saturation", {"level", "fraction"})):
        found = next(
            one
            for k in range(20)
            if (one := draws.DRAWS[study](np.random.default_rng([5, k]))).found == 2
        )
        assert numbers <= set(found.ranks)
        assert all(0.0 <= rank <= 1.0 for rank in found.ranks.values())


def test_the_store_is_extended_where_it_ended(calibration, tmp_path, monkeypatch):
    outcome = calibration.Outcome

    def drawn(rng):
        value = float(rng.random())
        more = {"frequency": 0.25} if value > 0.5 else {}
        return outcome(3.0, 2, 12.0, 10.0, {"size": value, **more})

    monkeypatch.setitem(calibration.DRAWS, "step", drawn)
    calibration.run(tmp_path, ["step"], 3, seed=1)
    calibration.run(tmp_path, ["step"], 8, seed=1)
    once = tmp_path / "once"
    calibration.run(once, ["step"], 8, seed=1)
    assert (once / "step.csv").read_text() == (tmp_path / "step.csv").read_text()
    study = calibration.stored(tmp_path, "step")
    assert len(study.found) == 8
    assert np.isfinite(study.ranks["size"]).all()
    known = np.isfinite(study.ranks["frequency"])
    assert known.tolist() == (study.ranks["size"] > 0.5).tolist()
    assert known.any()
    assert not known.all()
