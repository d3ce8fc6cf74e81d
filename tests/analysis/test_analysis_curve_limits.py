"""B and K are limits where the measured curve refutes what was fitted elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import allanscope
from allanscope import analyse
from allanscope.analysis.curve_limits import limited_by_curve
from allanscope.noise import Coefficient, NoiseModel, fit_array
from allanscope.noise.components import Flicker, RandomWalk, White

N, RATE, SAMPLES = 4e-3, 50.0, 20_000


def coefficients(B, K):
    sized = {"N": N, "B": B, "K": K}
    return {k: Coefficient(v, 0.9 * v, 1.1 * v, "", True) for k, v in sized.items()}


def limited(samples, B, K):
    curve = allanscope.deviation(samples, RATE, "oadev")
    model = NoiseModel((White(N), Flicker(B), RandomWalk(K)), 1 / RATE)
    return limited_by_curve("dps", coefficients(B, K), model, curve)


def test_a_walk_that_the_curve_does_not_show_becomes_a_limit():
    rng = np.random.default_rng(1)
    found, remarks = limited(rng.normal(0, N * RATE**0.5, SAMPLES), 1e-6, 0.1)
    assert not found["K"].detected
    assert found["K"].lower == 0.0
    assert 0.0 < found["K"].value <= found["K"].upper < 1e-3
    (line,) = remarks
    assert line.startswith("K is < ")
    assert line.endswith("times its upper limit")
    assert found["B"].detected
    assert found["N"] == coefficients(1e-6, 0.1)["N"]


def test_a_floor_that_the_curve_falls_below_becomes_a_limit():
    rng = np.random.default_rng(2)
    found, remarks = limited(rng.normal(0, N * RATE**0.5, SAMPLES), 0.05, 1e-9)
    assert not found["B"].detected
    assert found["B"].upper < 3e-3
    assert len(remarks) == 1


def test_a_walk_that_is_there_stays():
    """60 records whose K is fitted to 10 to 20 %: the curve refutes none."""
    for seed in range(60):
        rng = np.random.default_rng([3, seed])
        K = rng.choice([3e-4, 1e-3, 4e-3])
        walk = np.cumsum(rng.normal(0, K / RATE**0.5, SAMPLES))
        samples = rng.normal(0, N * RATE**0.5, SAMPLES) + walk
        fit = fit_array(samples, RATE)
        curve = allanscope.deviation(samples, RATE, "oadev")
        kept, remarks = limited_by_curve("dps", fit.coefficients, fit.model, curve)
        assert kept == dict(fit.coefficients)
        assert remarks == ()


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_band_in_a_record_too_short_to_be_searched_makes_no_walk(seed):
    """A textbook fit to its flank has a K that is 8 to 11 times what the curve allows."""
    rng = np.random.default_rng([4, seed])
    n = int(18 * RATE)
    samples = rng.normal(0, 2e-3, n)
    shaken = lfilter(*butter(1, [1.0, 2.0], "band", fs=RATE), rng.normal(size=n + 500))[500:]
    samples += 0.3 * shaken / shaken.std()
    axis = analyse({"gx": samples}, RATE).axes["gx"]
    found, curve = axis.coefficients["K"], axis.curves["oadev"]
    assert fit_array(samples, RATE).coefficients["K"].lower > 5 * found.upper
    assert not found.detected
    highest = np.min(curve.upper[curve.trusted] * np.sqrt(3 / curve.tau[curve.trusted]))
    assert found.upper < 1.05 * highest
    assert any(line.startswith("K is < ") for line in axis.remarks)
