"""The Allan curve as evidence: covariances and chi-square."""

import numpy as np
import pytest

from allanscope.allan import Deviation, degrees_of_freedom
from allanscope.noise import NoiseModel, gls_chi2
from allanscope.noise.components import (
    Flicker,
    FlickerPhase,
    FlickerWalk,
    GaussMarkov,
    RandomRun,
    RandomWalk,
    Sinusoid,
    White,
)
from allanscope.noise.curve import deviation_covariance, half_octaves, log_bias, log_covariance

DT = 0.25
TRUTH = NoiseModel((White(4e-3), Flicker(1.255e-3), RandomWalk(1e-4)), DT)
N = 8192
M = np.unique(np.round(2 ** (np.arange(2 * np.log2(N / 3)) / 2)).astype(np.int64))


def curve_of(kind, variance, m=M, n=N):
    span = 2 if kind == "oadev" else 3
    none = np.full(len(m), np.nan)
    terms = n - span * m + 1
    words = np.full(len(m), "")
    return Deviation(
        kind, m * DT, m, np.sqrt(variance), none, none, none, terms, words, 0.95, m > 0
    )


@pytest.fixture(scope="module")
def curves(make_noise, overlapping_variance):
    """Allan and Hadamard variances of 300 records of the reference sensor."""
    rng = np.random.default_rng(11)
    out = []
    for _ in range(300):
        samples = make_noise(N, DT, rng, N=4e-3, B=1.255e-3, K=1e-4)
        out.append([[overlapping_variance(samples, m, order) for m in M] for order in (2, 3)])
    return np.array(out)


@pytest.mark.parametrize(("column", "kind"), [(0, "oadev"), (1, "ohdev")])
def test_covariance_is_that_of_simulated_curves(curves, column, kind):
    seen = curves[:, column]
    theory = deviation_covariance(TRUTH, kind, M, N)
    expected = TRUTH.variance(kind, M)
    # Longest windows last: 300 records give a standard deviation to 4 %, far less sure at low edf.
    sd = np.sqrt(np.diag(theory)) / expected
    ratio = seen.std(axis=0) / expected / sd
    assert np.abs(ratio[sd < 0.4] - 1).max() < 0.16
    assert ratio[sd < 0.4].mean() == pytest.approx(1.0, abs=0.05)
    correlation = theory / np.outer(np.sqrt(np.diag(theory)), np.sqrt(np.diag(theory)))
    assert np.abs(np.corrcoef(seen.T) - correlation)[sd < 0.4][:, sd < 0.4].max() < 0.25
    neighbours = np.diag(np.corrcoef(seen.T) - correlation, 1)
    assert np.abs(neighbours.mean()) < 0.03
    np.testing.assert_allclose(seen.mean(axis=0)[sd < 0.1], expected[sd < 0.1], rtol=0.02)


def test_white_noise_at_one_sample_has_two_thirds_of_a_degree_each():
    # Cov = 3 / n for differences of neighbours: edf = 2 n / 3.
    model = NoiseModel((White(1.0),), 1.0)
    variance = deviation_covariance(model, "oadev", np.array([1]), 30_000)
    assert 2 / variance[0, 0] == pytest.approx(20_000, rel=5e-3)


@pytest.mark.parametrize(
    ("kind", "part", "noise"),
    [
        ("oadev", FlickerPhase(1.0), "FPM"),
        ("mdev", FlickerPhase(1.0), "FPM"),
        ("ohdev", FlickerWalk(1.0), "FWFM"),
        ("ohdev", RandomRun(1.0), "RRFM"),
    ],
)
def test_covariance_agrees_with_degrees_of_freedom(kind, part, noise):
    """2 variance^2 / covariance, against the sum over lags of Greenhall and Riley."""
    m, model = np.array([4, 32, 256]), NoiseModel((part,), 1.0)
    covariance = deviation_covariance(model, kind, m, 4096)
    edf = 2 * model.variance(kind, m) ** 2 / np.diag(covariance)
    assert edf == pytest.approx(degrees_of_freedom(kind, noise, m, 4096), rel=0.06)


def test_noise_without_an_allan_variance_has_no_covariance_of_it():
    with pytest.raises(ValueError, match="take ohdev"):
        deviation_covariance(NoiseModel((RandomRun(1.0),), 1.0), "oadev", np.array([1]), 100)


def test_a_line_adds_to_the_covariance_only_with_noise_beside_it():
    m = np.array([2, 4, 8])
    line = Sinusoid(1.0, 0.1 / DT)
    alone = deviation_covariance(NoiseModel((line,), DT), "oadev", m, 10_000)
    assert np.all(alone == 0)
    white = deviation_covariance(NoiseModel((White(0.1),), DT), "oadev", m, 10_000)
    both = deviation_covariance(NoiseModel((White(0.1), line), DT), "oadev", m, 10_000)
    assert np.all(np.diag(both) > np.diag(white))


def test_chi_square_is_calibrated_under_the_truth(curves):
    p = [gls_chi2(curve_of("oadev", c), TRUTH, fitted=0).p_value for c in curves[:, 0]]
    # 300 records: 5 % +- 1.3 %, and a tail that the longest taus make a little heavier.
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.11
    assert 0.42 < np.mean(p) < 0.58


def test_rms_beside_what_sampling_leaves(curves):
    results = [gls_chi2(curve_of("oadev", c), TRUTH, fitted=0) for c in curves[:, 0]]
    seen = np.sqrt(np.mean([r.rms_percent**2 for r in results]))
    assert seen == pytest.approx(results[0].expected_rms_percent, rel=0.12)
    fitted = gls_chi2(curve_of("oadev", curves[0, 0]), TRUTH)
    assert fitted.expected_rms_percent < results[0].expected_rms_percent


def test_chi_square_sees_a_missing_process():
    model = TRUTH.plus(GaussMarkov(4e-3, 30.0))
    found = gls_chi2(curve_of("oadev", model.variance("oadev", M)), TRUTH, fitted=3)
    assert found.p_value < 1e-3
    assert found.z.max() > 3
    assert found.rms_percent > 2 * found.expected_rms_percent


@pytest.mark.parametrize("edf", [1.5, 4.0, 60.0])
def test_logarithms_of_variances_have_the_bias_of_chi_square(edf):
    x = np.log(np.random.default_rng(3).chisquare(edf, 400_000) / edf)
    assert float(log_bias(np.array(edf))) == pytest.approx(x.mean(), abs=0.01)


@pytest.mark.parametrize("m", [1, 500, 3000])
def test_logarithms_of_variances_have_the_spread_of_chi_square(m):
    white = NoiseModel((White(1.0),), 1.0)
    at = np.array([m])
    covariance, edf = log_covariance(white, "oadev", at, 10_000, white.variance("oadev", at))
    x = np.log(np.random.default_rng(4).chisquare(edf[0], 200_000) / edf[0])
    assert covariance[0, 0] == pytest.approx(x.var(), rel=0.02)


def test_chi_square_removes_the_bias_of_the_logarithm():
    # A curve that is its own expectation lies above the mean logarithm wherever few terms are.
    residual = gls_chi2(curve_of("oadev", TRUTH.variance("oadev", M)), TRUTH, fitted=0)
    assert np.all(residual.log_ratio > 0)
    assert residual.log_ratio[-1] > 0.2


def test_half_octaves_are_picked_from_any_grid():
    m = np.unique(np.round(np.geomspace(1, 10_000, 200)).astype(np.int64))
    picked = m[half_octaves(m, 3000)]
    ratio = np.diff(np.log2(picked[picked > 10]))
    assert picked[-1] <= 3000
    assert np.all((ratio > 0.3) & (ratio < 0.7))


def test_bad_curves_are_refused():
    good = TRUTH.variance("oadev", M)
    with pytest.raises(ValueError, match="no covariance of 'totdev'"):
        gls_chi2(curve_of("totdev", good), TRUTH)
    with pytest.raises(ValueError, match="below a third"):
        gls_chi2(curve_of("oadev", good[-1:], M[-1:], n=M[-1] + 1), TRUTH)
    with pytest.raises(ValueError, match="one axis"):
        gls_chi2(curve_of("oadev", np.array([good, good])), TRUTH)
    with pytest.raises(ValueError, match="no model of"):
        TRUTH.variance("pdev", M)


def test_model_adds_up_and_names_its_parts():
    model = TRUTH.plus(GaussMarkov(1e-3, 30.0))
    parts = model.components_at("ohdev", M)
    np.testing.assert_allclose(sum(parts), model.variance("ohdev", M))
    np.testing.assert_allclose(model.deviation("ohdev", M) ** 2, model.variance("hvar", M))
    tdev = model.deviation("tdev", M)
    np.testing.assert_allclose(tdev, M * DT / np.sqrt(3) * model.deviation("mdev", M))
    assert model.value("B") == 1.255e-3
    assert model.value("Q") == 0.0
    assert model.without("B", "gauss_markov").components == (White(4e-3), RandomWalk(1e-4))
    assert model.get("gauss_markov") == GaussMarkov(1e-3, 30.0)
    with pytest.raises(ValueError, match="positive"):
        NoiseModel((), 0.0)
