"""Sizes near the limit, corrected for selection bias: unbiased, and their intervals hold."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct

from allanscope.explain.candidate import Candidate, effect_of
from allanscope.explain.effect import Estimate
from allanscope.explain.effects.temperature import Temperature
from allanscope.explain.given_detection import conditional_rank, given_detection
from allanscope.explain.spectrum import StepScan, ends_of
from allanscope.noise.grid import Grid

PENALTY = 10.0
LIMIT = np.sqrt(2 * PENALTY)


def detected(truth: float, count: int) -> np.ndarray:
    """Return estimates with standard error 1 of those that exceed the limit."""
    drawn = truth + np.random.default_rng(1).standard_normal(100 * count)
    return drawn[drawn > LIMIT][:count]


@pytest.mark.parametrize("truth", [4.0, 5.0, 7.0])
def test_the_corrected_size_is_too_large_as_often_as_too_small_and_its_interval_holds(truth):
    estimates = detected(truth, 600)
    found = [given_detection(Estimate.of(one, 1.0), PENALTY) for one in estimates]
    too_large = np.mean([one.value > truth for one in found])
    covered = np.mean([one.lower <= truth <= one.upper for one in found])
    assert abs(too_large - 0.5) < 0.07  # 3.4 standard errors of 600
    assert 0.92 < covered < 0.98
    assert np.mean(estimates > truth) > too_large


def test_a_negative_size_is_the_mirror_image():
    up, down = (given_detection(Estimate.of(s * 5.0, 1.0), PENALTY) for s in (1, -1))
    assert (down.value, down.lower, down.upper) == (-up.value, -up.upper, -up.lower)


def test_far_above_the_limit_nothing_changes():
    size = Estimate.of(30.0, 1.0, "mdps")
    assert given_detection(size, PENALTY) is size


def test_ranks_of_the_truth_are_uniform():
    ranks = np.sort([conditional_rank(5.0, one, LIMIT) for one in detected(5.0, 2000)])
    assert np.max(np.abs(ranks - np.linspace(0, 1, len(ranks)))) < 1.63 / np.sqrt(len(ranks))


def test_the_size_of_a_process_goes_by_what_it_gains():
    """The nats that a variance gains grow as its square: z is that of the power, not of sigma."""
    rng, limit = np.random.default_rng(4), 3.0
    truth = 3.5  # power in standard errors of the power
    drawn = truth + rng.standard_normal(4000)
    powers = drawn[drawn > limit][:500]
    found = [
        given_detection(
            Estimate(*np.sqrt([p, max(p - 1.96, 1e-9), p + 1.96])), limit**2 / 2, p**2 / 2
        )
        for p in powers
    ]
    too_large = np.mean([one.value > np.sqrt(truth) for one in found])
    covered = np.mean([one.lower <= np.sqrt(truth) <= one.upper for one in found])
    assert abs(too_large - 0.5) < 0.08  # 3.6 standard errors of 500
    assert 0.92 < covered < 0.98
    assert np.mean(np.sqrt(powers) > np.sqrt(truth)) > 0.65


def test_what_a_lag_has_paid_for_does_not_select_the_slope():
    """Without its lag the slope would have been found for less."""
    slope = Estimate.of(5.0, 1.0, "mdps/degC")

    def corrected(lag: Estimate | None, gain: float):
        effect = Temperature(slope, lag, None, 4.0, 25.0)
        found = effect_of(Candidate(effect, gain, effect.form_price), "gx")
        return found.evidence["price_nats"], found.given_detection

    price, plain = corrected(None, 12.0)
    dearer, late = corrected(Estimate(20.0, 10.0, 40.0, "s"), 17.0)
    assert dearer > price + 9.0
    expected = given_detection(slope, price, 17.0)
    assert (late.value, late.lower, late.upper) == pytest.approx(
        (expected.value, expected.lower, expected.upper)
    )
    assert plain.value < late.value < 5.0


def test_a_ratio_is_corrected_towards_one():
    louder, quieter = Estimate(1.4, 1.2, 1.6), Estimate(0.6, 0.4, 0.8)
    up, down = (
        given_detection(one, PENALTY, PENALTY + 1, nothing=1.0) for one in (louder, quieter)
    )
    assert 1.0 < up.value < 1.4
    assert up.value - 1.0 == pytest.approx(1.0 - down.value)
    assert (up.lower, up.upper) == pytest.approx((2.0 - down.upper, 2.0 - down.lower))


@pytest.mark.parametrize("size", [0.25, 6.0])
def test_the_place_of_a_jump_holds_it_and_its_size_is_not_too_large(size):
    """In white noise of 1: a faint step within a hundred samples, and one that is seen at once."""
    n, rng = 1024, np.random.default_rng(8)
    grid = Grid(n, 1.0)
    known = SimpleNamespace(kept=np.ones(n - 1), ordinates=np.ones(n - 1))
    tried = np.arange(20, n - 20)
    held, mean = [], []
    for _ in range(300):
        at = int(rng.integers(150, n - 150))
        rows = size * (np.arange(n) >= at) + rng.standard_normal(n)
        scan = StepScan(grid, dct(rows - rows.mean(), norm="ortho")[1:], known)
        place = scan.place_of_step(tried)
        low, high = ends_of(place.instants)
        held.append(low <= at - 0.5 <= high)
        left, right = rows[: place.best].mean(), rows[place.best :].mean()
        mean.append((right - left) * place.shrinkage / size)
    assert 0.92 < np.mean(held) <= 1.0
    assert np.mean(mean) == pytest.approx(1.0, abs=3.5 * np.std(mean) / np.sqrt(300))
