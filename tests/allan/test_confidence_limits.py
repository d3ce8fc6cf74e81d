"""Limits, refusals, units: what `assemble` makes of sums."""

import numpy as np
import pytest
import scipy.stats

from allanscope.allan import confidence, deviation
from allanscope.allan.confidence import chi_square_limits
from allanscope.allan.estimators import REGISTRY, Sums
from allanscope.allan.noise_type import NoiseTypes


def assemble(kind, sums, rate, alpha=None, **options):
    known = None if alpha is None else NoiseTypes(np.asarray(alpha))
    return confidence.assemble(kind, sums, rate, noise=known, **options)


def sums(variance, terms=None, m=(1, 10, 100), n=1000, stride=1):
    variance = np.asarray(variance, float)
    terms = np.full(variance.shape, 50) if terms is None else np.asarray(terms)
    m = np.asarray(m, np.int64)
    return Sums(m, variance, terms, np.full(m.shape, stride, np.int64), n)


@pytest.mark.parametrize("level", [0.683, 0.95, 0.99])
@pytest.mark.parametrize("edf", [1.0, 1.7, 5.0, 80.0, 1e4, 1e7])
def test_limits_are_chi_square_quantiles(level, edf):
    lower, upper = chi_square_limits(3.0, edf, level)
    tails = scipy.stats.chi2(edf).ppf([(1 + level) / 2, (1 - level) / 2])
    assert [lower, upper] == pytest.approx(3.0 * np.sqrt(edf / tails), rel=1e-9)
    assert lower < 3.0 < upper


def test_one_degree_of_freedom_leaves_a_factor_of_thirty():
    lower, upper = chi_square_limits(1.0, 1.0)
    assert float(lower) == pytest.approx(0.446, abs=1e-3)
    assert float(upper) == pytest.approx(31.9, abs=0.1)


def test_nothing_known_gives_no_limits():
    assert np.isnan(chi_square_limits(np.nan, np.nan)).all()


@pytest.mark.parametrize("level", [0.0, 1.0, 95, -0.1])
def test_a_level_is_a_probability(level):
    with pytest.raises(ValueError, match="level must lie between 0 and 1"):
        chi_square_limits(1.0, 5.0, level)


def test_the_simple_interval_is_the_deviation_over_the_root_of_its_terms():
    curve = deviation([1, 2, 4, 3, 3, 1, 1, 2, 7], 1.0, "adev", taus=[1, 2])
    lower, upper = curve.simple_limits()
    assert curve.terms.tolist() == [8, 3]
    np.testing.assert_allclose(lower, curve.deviation * (1 - 1 / np.sqrt([8, 3])))
    np.testing.assert_allclose(upper, curve.deviation * (1 + 1 / np.sqrt([8, 3])))


def test_the_curve_is_the_root_of_the_variance_in_seconds():
    curve = assemble("oadev", sums([4.0, 1.0, 0.25]), rate=20.0, alpha=0)
    assert curve.tau.tolist() == [0.05, 0.5, 5.0]
    assert curve.deviation.tolist() == [2.0, 1.0, 0.5]
    assert curve.noise.tolist() == ["WFM"] * 3
    assert curve.trusted.tolist() == [True, True, True]
    expected = REGISTRY["oadev"].edf(0, curve.m, 1000, 1)
    assert curve.edf == pytest.approx(expected)
    assert curve.lower == pytest.approx(chi_square_limits(curve.deviation, expected)[0])


def test_several_axes_have_a_row_each():
    variance = np.array([[4.0, 1.0, 0.25], [1.0, np.nan, 1.0]])
    alpha = np.array([[2, 0, 0], [0, -1, -2]])
    curve = assemble("oadev", sums(variance), 1.0, alpha=alpha)
    assert curve.tau.shape == (3,)
    assert curve.deviation.shape == curve.edf.shape == curve.noise.shape == (2, 3)
    assert curve.noise.tolist() == [["WPM", "WFM", "WFM"], ["WFM", "", "RWFM"]]
    assert np.isnan(curve.lower[1, 1])


def test_too_few_terms_are_refused():
    for kind, fewest in (("oadev", 2), ("theo1", 1), ("mtotdev", 1)):
        curve = assemble(kind, sums([1.0, 1.0, 1.0], [fewest, fewest - 1, 0]), 1.0, alpha=0)
        assert np.isfinite(curve.deviation).tolist() == [True, False, False]
        for column in (curve.lower, curve.upper, curve.edf):
            assert np.isnan(column).tolist() == [False, True, True]
        assert curve.noise.tolist() == ["WFM", "", ""]


def test_without_a_noise_type_the_limits_are_those_of_white_fm():
    unknown = assemble("oadev", sums([1.0, 1.0, 1.0]), 1.0)
    white = assemble("oadev", sums([1.0, 1.0, 1.0]), 1.0, alpha=0)
    assert unknown.noise.tolist() == ["", "", ""]
    assert unknown.upper.tolist() == white.upper.tolist()


def test_noise_too_steep_for_the_estimator_keeps_its_name():
    curve = assemble("oadev", sums([1.0, 1.0, 1.0]), 1.0, alpha=[-2, -3, -4])
    assert curve.noise.tolist() == ["RWFM", "FWFM", "RRFM"]
    assert curve.edf[1] == pytest.approx(REGISTRY["oadev"].edf(-2, 10, 1000, 1))
    steep = assemble("ohdev", sums([1.0, 1.0, 1.0]), 1.0, alpha=[-2, -3, -4])
    assert steep.edf[1] == pytest.approx(REGISTRY["ohdev"].edf(-3, 10, 1000, 1))


def test_time_deviations_are_in_seconds():
    assert assemble("tdev", sums([4.0, 4.0, 4.0]), 10.0, alpha=0).deviation[0] == 0.2


def test_thinned_terms_widen_the_limits():
    full = assemble("oadev", sums([1.0] * 3, m=[64, 128, 256], n=4096), 1.0, alpha=2)
    thin = assemble("oadev", sums([1.0] * 3, m=[64, 128, 256], n=4096, stride=16), 1.0, alpha=2)
    assert np.all(thin.edf < full.edf / 10)
    assert np.all(thin.upper > full.upper)


@pytest.mark.parametrize(
    ("kind", "alpha", "factor"),
    [
        ("mtotdev", 2, 0.94),
        ("mtotdev", 1, 0.83),
        ("mtotdev", 0, 0.73),
        ("mtotdev", -1, 0.70),
        ("mtotdev", -2, 0.69),
        ("mtotdev", -4, 0.69),
        ("ttotdev", 0, 0.73),
        ("htotdev", 0, 0.995),
        ("htotdev", -1, 0.851),
        ("htotdev", -2, 0.771),
        ("htotdev", -3, 0.717),
        ("htotdev", -4, 0.679),
        ("htotdev", 2, 1.0),
        ("totdev", -2, 1.0),
        ("theo1", -2, 1.0),
    ],
)
def test_the_published_bias_is_taken_off_the_variance(kind, alpha, factor):
    corrected = assemble(kind, sums([1.0] * 3), 1.0, alpha=alpha)
    raw = assemble(kind, sums([1.0] * 3), 1.0, alpha=alpha, bias_corrected=False)
    assert (raw.deviation / corrected.deviation)[1:] ** 2 == pytest.approx(factor)


@pytest.mark.parametrize("bias_corrected", [True, False])
@pytest.mark.parametrize("alpha", [2, 1, 0, -1, -2])
@pytest.mark.parametrize("kind", sorted(REGISTRY))
def test_limits_enclose_the_value_whatever_its_bias(kind, alpha, bias_corrected):
    curve = assemble(kind, sums([1.0] * 3), 1.0, alpha=alpha, bias_corrected=bias_corrected)
    assert np.all((curve.lower <= curve.deviation) & (curve.deviation <= curve.upper))
    assert np.all(curve.lower < curve.upper)


@pytest.mark.parametrize("ratio", [0.5, 0.9, 1.0, 1.1, 1.8])
def test_limits_that_enclose_a_biased_value_hold_the_truth_as_often(ratio):
    """400,000 chi-square variances of 30 degrees of freedom: 95 % to 0.2 %."""
    drawn = scipy.stats.chi2(30).rvs(400_000, random_state=5) / 30.0
    unbiased = np.sqrt(drawn)
    lower, upper = confidence.enclosing_limits(ratio * unbiased, unbiased, np.full(1, 30.0), 0.95)
    assert np.mean((lower <= 1.0) & (upper >= 1.0)) == pytest.approx(0.95, abs=0.002)
    assert np.all((lower <= ratio * unbiased) & (ratio * unbiased <= upper))


def test_the_limits_of_totdev_allow_for_what_it_misses_at_long_tau():
    curve = assemble("totdev", sums([1.0], m=[400]), 1.0, alpha=-2)
    expected = chi_square_limits(np.sqrt(1 / (1 - 0.75 * 0.4)), curve.edf)[1]
    assert curve.upper == pytest.approx(expected)
    assert curve.deviation.tolist() == [1.0]


def test_there_is_never_less_than_one_degree_of_freedom():
    assert REGISTRY["totdev"].edf(-2, 950, 1000, 1) < 1.0
    assert assemble("totdev", sums([1.0], m=[950]), 1.0, alpha=-2).edf[0] >= 1.0


def test_the_limits_of_htotdev_allow_for_its_excess_in_phase_noise():
    curve = assemble("htotdev", sums([1.0], m=[100]), 1.0, alpha=2)
    unbiased = np.sqrt(1 / 1.37)
    assert curve.lower[0] == pytest.approx(chi_square_limits(unbiased, curve.edf, 0.9)[0], rel=0.05)
    assert curve.upper.tolist() == [1.0]  # the value itself, which 95 % would leave out


@pytest.mark.parametrize(
    ("kind", "part"),
    [
        *(("oadev", 0.1), ("adev", 0.1), ("ohdev", 0.1), ("totdev", 0.5), ("mtotdev", 0.3)),
        *(("htotdev", 0.1), ("stdev", 0.0), ("ostdev", 0.0)),
    ],
)
def test_trust_ends_at_a_part_of_the_run(kind, part):
    m = np.array([100, 101, 300, 301, 500, 501])
    curve = assemble(kind, sums(np.ones(6), m=m), 1.0)
    assert curve.trusted.tolist() == [k <= 1000 * part for k in m]


def test_the_theo_family_is_trusted_to_a_quarter_when_its_bias_is_removed():
    m = [16, 38, 40, 132, 134, 332, 334]
    curve = assemble("theobr", sums(np.ones(7), m=m), 4.0)
    assert curve.tau[-2:].tolist() == [62.25, 62.625]
    assert curve.trusted.tolist() == [False, False, True, True, True, True, False]
    raw = assemble("theo1", sums(np.ones(7), m=m), 4.0)
    assert raw.trusted.tolist() == [True, True, True, True, False, False, False]


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_is_positive(rate):
    with pytest.raises(ValueError, match="rate must be positive and finite"):
        assemble("oadev", sums([1.0] * 3), rate)


def test_totdev_between_gaps_has_no_bias_of_its_stretches(power_law):
    """Forty stretches of a random walk: raw it is 16 % low at a third of one, 6 % at a tenth."""
    ratio = []
    for run in power_law(-2, 4096, 40, seed=7):
        run[100::102] = np.nan
        total, plain = (deviation(run, 1.0, kind, taus=[8.0, 32.0]) for kind in ("totdev", "oadev"))
        assert total.trusted.all()
        ratio.append(total.variance / plain.variance)
    assert np.mean(ratio, axis=0) == pytest.approx(1.0, abs=0.04)


def test_a_stretch_that_is_reflected_is_trusted_to_its_half():
    run = np.random.default_rng(8).normal(size=4096)
    run[100::101] = np.nan
    curve = deviation(run, 1.0, "totdev", taus=[48.0, 52.0, 64.0])
    assert curve.trusted.tolist() == [True, False, False]
