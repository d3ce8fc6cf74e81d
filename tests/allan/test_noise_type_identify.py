"""The power law is found at every tau, from ratios of variances alone."""

import numpy as np
import pytest

from allanscope.allan import deviation
from allanscope.allan.noise_type import NAMES, at_factors, identify, unit_variance
from allanscope.allan.oneshot import noise_types
from allanscope.allan.phase import to_phase


def found(noise, m):
    return np.array([noise_types([to_phase(run, 1.0)], m).alpha for run in noise])


@pytest.mark.parametrize("alpha", [2, 1, 0, -1, -2])
def test_pure_noise_is_named_right(alpha, power_law):
    m = [1, 2, 4, 8, 16, 32]
    right = (found(power_law(alpha, 2048, runs=60, seed=1), m) == alpha).mean(axis=0)
    assert right[0] > 0.99
    assert right.min() > 0.93


@pytest.mark.parametrize("alpha", [-3, -4])
def test_steep_noise_is_not_taken_for_flat(alpha, power_law):
    laws = found(power_law(alpha, 2048, runs=60, seed=2), [1, 2, 4, 16, 64])
    assert (laws > -2).mean() < 0.02
    assert (laws == alpha).mean(axis=0).min() > 0.85


def test_white_and_flicker_pm_are_told_apart_at_every_tau(power_law):
    """AVAR falls as tau^-2 for both, and so does not tell; MVAR / AVAR does."""
    m = 2 ** np.arange(8)
    white = found(power_law(2, 4096, runs=30, seed=3), m)
    flicker = found(power_law(1, 4096, runs=30, seed=4), m)
    assert (white == 2).mean() > 0.97
    assert (flicker == 1).mean() > 0.97


def test_each_tau_has_its_own_type(power_law):
    """White at short tau, random walk at long, flicker or so between."""
    white = power_law(0, 2**15, runs=1, seed=5)[0]
    walk = 0.05 * power_law(-2, 2**15, runs=1, seed=6)[0]
    curve = deviation(white + walk, 1.0)
    assert curve.noise[:3].tolist() == ["WFM"] * 3
    assert curve.noise[8:].tolist() == ["RWFM"] * len(curve.noise[8:])


def test_a_drift_is_no_noise(power_law):
    drifting = power_law(0, 4096, runs=30, seed=7) + 0.01 * np.arange(4096)
    assert (found(drifting, [1, 8, 64]) == 0).mean() > 0.95


def test_a_known_drift_is_taken_off_the_sums_of_a_stream():
    m, n, drift = np.array([1, 4, 32]), 4096, 0.01
    ramp = (drift * m) ** 2 / 2
    stdvar = 1 / m + (drift * (n - m)) ** 2 / 12
    kept = {"stdvar": stdvar, "avar": 1 / m + ramp, "hvar": 1 / m}
    mvar = (1 + 1 / m**2) / (2 * m) + ramp
    assert identify(m, n, **kept, mvar=mvar, drift=drift).tolist() == [0, 0, 0]
    assert identify(m, n, **kept, mvar=mvar)[-1] < 0


def test_the_ratio_of_flicker_pm_falls_with_the_logarithm_of_tau_for_ever():
    """MVAR / AVAR = 27.04 / (8 pi^2) * 4 pi^2 / (1.038 + 3 ln(pi m)): 0.072 at m = 2^20."""
    m = 2 ** np.array([4, 10, 20])
    limit = 3 * np.log(256 / 27) / 2 / (1.038 + 3 * np.log(np.pi * m))
    for factor in (0.45, 1.0, 2.2):
        flat = np.ones(3)
        laws = identify(m, 2**30, stdvar=flat, avar=flat, hvar=flat, mvar=limit * factor)
        assert laws[2] == 1
    assert np.all(identify(m, 2**30, stdvar=flat, avar=flat, hvar=flat, mvar=limit) == 1)


def test_quantisation_of_the_angle_is_white_pm():
    angle = np.round(np.linspace(0, 300, 5000) + np.random.default_rng(8).uniform(0, 1, 5000))
    assert deviation(angle, 1.0, data_kind="phase", taus=[1, 2, 4]).noise.tolist() == ["WPM"] * 3


def test_too_short_windows_keep_the_type_before():
    m = np.array([1, 2, 4, 8, 16])
    flat = np.ones(5)
    mvar = np.array([1.0, 0.71, 0.68, 0.01, 0.01])
    laws = identify(m, 128, stdvar=3 * flat, avar=flat, hvar=flat * 0.89, mvar=mvar)
    assert laws.tolist() == [-1, -1, -1, -1, -1]
    laws = identify(m, 256, stdvar=3 * flat, avar=flat, hvar=flat * 0.89, mvar=mvar)
    assert laws.tolist() == [-1, -1, -1, 2, 2]


def test_without_data_the_noise_is_white_fm():
    none = np.full(3, np.nan)
    laws = identify([1, 2, 4], 1000, stdvar=none, avar=none, hvar=none, mvar=none)
    assert laws.tolist() == [0, 0, 0]
    one = np.ones(1)
    assert identify([1], 7, stdvar=9 * one, avar=one, hvar=one, mvar=one).tolist() == [0]


def test_holes_are_bridged_by_the_type_before():
    m = np.array([1, 2, 4])
    flat = np.ones(3)
    mvar = np.array([1.0, np.nan, 0.68])
    laws = identify(m, 10_000, stdvar=9 * flat, avar=flat, hvar=flat * 0.89, mvar=mvar)
    assert laws.tolist() == [-1, -1, -1]


def test_several_axes_are_judged_one_by_one():
    m = np.array([1, 2, 4])
    avar = np.array([[1.0, 0.5, 0.25], [1.0, 1.0, 1.0]])
    mvar = avar * [[1.0, 0.625, 0.53], [1.0, 0.71, 0.68]]
    stdvar = avar * [[1.0], [3.0]]
    hvar = avar * [[1.0], [0.89]]
    laws = identify(m, 1000, stdvar=stdvar, avar=avar, hvar=hvar, mvar=mvar, drift=[0.0, 0.0])
    assert laws.tolist() == [[0, 0, 0], [-1, -1, -1]]


def test_the_nearest_known_factor_in_logarithm_lends_its_type():
    alpha = [[2, 0, -1], [1, 1, -2]]
    laws = at_factors([1, 1.9, 2.1, 31, 33, 10**6], [1, 4, 256], alpha)
    assert laws.tolist() == [[2, 2, 0, 0, -1, -1], [1, 1, 1, 1, -2, -2]]


def test_every_alpha_has_a_name():
    named = " ".join(NAMES[alpha] for alpha in (2, 1, 0, -1, -2, -3, -4))
    assert named == "WPM FPM WFM FFM RWFM FWFM RRFM"


def test_levels_of_several_noises_are_found(power_law):
    """White noise and a random walk that cross at m = 32, of 60 runs: shares to 0.2."""
    runs, knee = 60, 32
    white, walk = power_law(0, 2048, runs, seed=8), power_law(-2, 2048, runs, seed=9)
    both = white + walk * np.sqrt(3.0) / knee
    tau = np.array([1.0, 32.0, 256.0])
    shares = np.mean(
        [noise_types([to_phase(x, 1.0)], tau).shares("avar", tau) for x in both], axis=0
    )
    assert shares[0, 2] > 0.8
    assert shares[1, 2] == pytest.approx(0.5, abs=0.2)
    assert shares[2, 4] > 0.7
    assert shares.sum(axis=1) == pytest.approx(1.0)


def test_unit_variances_are_those_of_the_definition():
    """MVAR and HVAR over AVAR by sums over a covariance matrix, at m = 3."""
    j = np.abs(np.subtract.outer(np.arange(12.0), np.arange(12.0)))
    covariance = {2: -j, 4: j**3 - j}
    m = 3
    second = np.zeros(12)
    second[[0, m, 2 * m]] = 1, -2, 1
    third = np.zeros(12)
    third[[0, m, 2 * m, 3 * m]] = 1, -3, 3, -1
    mean = sum(np.roll(second, k) for k in range(m)) / m
    unit = {k: unit_variance(k, [m])[:, 0] for k in ("avar", "mvar", "hvar")}
    for i, c in covariance.items():
        expected = [w @ c @ w / (f * m**2) for w, f in ((second, 2), (mean, 2), (third, 6))]
        found = [unit[k][i] for k in ("avar", "mvar", "hvar")]
        assert np.array(found) / found[0] == pytest.approx(np.array(expected) / expected[0])
