"""Sizes near the limit, corrected for having been detected: unbiased, and their intervals hold."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain.effect import Estimate
from allanscope.explain.given_detection import conditional_rank, given_detection

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
