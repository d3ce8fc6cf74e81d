"""Ranks of the truth within what a fit says of it: uniform where intervals of every level hold."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")
POINTS = np.linspace(0.02, 0.98, 49)


@pytest.fixture(scope="module")
def calibration():
    """Return the benchmark."""
    sys.path.insert(0, BENCHMARKS)
    try:
        return importlib.import_module("rank_calibration")
    finally:
        sys.path.remove(BENCHMARKS)


def test_ranks_of_fitted_coefficients_are_uniform(calibration):
    draw, rng = calibration.coefficients(26.0, 1200.0), np.random.default_rng(7)
    ranks: dict[str, list[float]] = {"N": [], "B": []}
    for _ in range(80):
        for name, rank in draw(rng).items():
            ranks.setdefault(name, []).append(rank)
    assert calibration.outside(np.array(ranks["N"]), POINTS) <= 1.0
    assert calibration.outside(np.array(ranks["B"]), POINTS) <= 1.0


@pytest.mark.parametrize(("width", "shift"), [(0.6, 0.0), (1.0, 0.6)])
def test_intervals_that_are_too_narrow_or_shifted_leave_the_band(calibration, width, shift):
    z = np.random.default_rng(3).standard_normal(200) / width + shift
    assert calibration.outside(calibration.norm.cdf(z), POINTS) > 1.0


def test_the_band_holds_nineteen_times_in_twenty(calibration):
    rng = np.random.default_rng(11)
    low, high = calibration.band(100, POINTS)
    held = 0
    for _ in range(400):
        share = np.searchsorted(np.sort(rng.random(100)), POINTS, side="right") / 100
        held += bool(np.all((share >= low) & (share <= high)))
    assert 0.91 < held / 400 < 0.985
