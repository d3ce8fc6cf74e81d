"""What every estimator in the registry promises, whichever file it comes from."""

import inspect

import numpy as np
import pytest

from allanscope.allan.estimators import REGISTRY, estimator_named

KINDS = sorted(REGISTRY)
X = np.append(0.0, np.cumsum(np.random.default_rng(6).standard_normal(800)))


def factors(estimator, n, most=40):
    return [m for m in range(1, most) if estimator.admits(m, n)]


def test_the_registry_holds_every_estimator_of_the_family():
    family = "stdev ostdev adev oadev mdev tdev hdev ohdev totdev mtotdev ttotdev htotdev"
    assert set(REGISTRY) == {*family.split(), "theo1", "theobr", "theoh", "pdev"}


def test_an_unknown_name_is_answered_with_all_names():
    with pytest.raises(ValueError, match=r"unknown estimator 'ADEV'.*adev.*totdev"):
        estimator_named("ADEV")


@pytest.mark.parametrize("kind", KINDS)
def test_each_estimator_teaches(kind):
    text = inspect.getdoc(type(REGISTRY[kind]))
    assert ">>>" in text
    assert "DT0064" in text
    assert REGISTRY[kind].variance_name in text


@pytest.mark.parametrize("kind", KINDS)
def test_needed_is_the_shortest_run_with_enough_terms(kind):
    estimator = REGISTRY[kind]
    for m in factors(estimator, 400):
        if not estimator.admits(m, estimator.needed(m)):
            continue
        enough = X[: estimator.needed(m) + 1]
        assert estimator.exact(enough, m)[1] >= estimator.min_terms
        assert np.isfinite(estimator.exact(enough, m)[0])
        if estimator.admits(m, enough.size - 2):
            assert estimator.exact(enough[:-1], m)[1] < estimator.min_terms


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_without_a_term_has_no_value(kind):
    variance, terms = REGISTRY[kind].exact(X[:3], 8)
    assert np.isnan(variance)
    assert terms <= 1


@pytest.mark.parametrize("kind", KINDS)
def test_no_estimator_sees_an_offset_of_the_rate(kind):
    estimator = REGISTRY[kind]
    offset = 1000.0 * np.arange(X.size)
    for m in (2, 20):
        assert estimator.exact(X + offset, m)[0] == pytest.approx(
            estimator.exact(X, m)[0], rel=1e-8
        )


@pytest.mark.parametrize("kind", ["hdev", "ohdev", "htotdev"])
def test_the_hadamard_family_does_not_see_a_drift(kind):
    estimator = REGISTRY[kind]
    ramp = 5.0 * np.arange(X.size) ** 2
    for m in (2, 20):
        assert estimator.exact(X + ramp, m)[0] == pytest.approx(estimator.exact(X, m)[0], rel=1e-6)
        assert estimator.exact(ramp, m)[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_doubling_the_signal_doubles_the_deviation(kind):
    estimator = REGISTRY[kind]
    assert estimator.exact(2 * X, 20)[0] == pytest.approx(4 * estimator.exact(X, 20)[0])


@pytest.mark.parametrize("kind", KINDS)
def test_reversing_time_changes_nothing_where_all_positions_count(kind):
    if kind in ("stdev", "adev", "hdev", "pdev"):
        pytest.skip("leaves out positions at the end")
    estimator = REGISTRY[kind]
    assert estimator.exact(X[::-1], 14)[0] == pytest.approx(estimator.exact(X, 14)[0])


@pytest.mark.parametrize("kind", KINDS)
def test_a_curve_is_its_points(kind):
    estimator = REGISTRY[kind]
    some = [m for m in (1, 2, 10, 60, 120, 200) if estimator.admits(m, 800)]
    expected = [estimator.exact(X, m) for m in some]
    np.testing.assert_allclose(estimator.curve(X, some), expected, rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_derived_variance_is_a_multiple_of_its_base(kind):
    estimator = REGISTRY[kind]
    if estimator.derived_from:
        base = REGISTRY[estimator.derived_from]
        for m in (1, 7):
            expected = estimator.factor(m) * base.exact(X, m)[0]
            assert estimator.exact(X, m)[0] == pytest.approx(expected)
    else:
        assert estimator.factor([1, 7]).tolist() == [1.0, 1.0]


@pytest.mark.parametrize("kind", KINDS)
def test_degrees_of_freedom_broadcast_and_fall_with_tau(kind):
    estimator = REGISTRY[kind]
    m = np.array([8, 16, 32, 64, 128])
    for alpha in range(2, estimator.lowest_alpha - 1, -1):
        edf = estimator.edf(np.full((3, 1), alpha), m, 2048, 1)
        assert edf.shape == (3, 5)
        assert np.all(edf[0] == edf[2])
        assert np.all(np.diff(edf[0]) <= 0) or alpha == 2
        assert np.all((edf > 1) & (edf < 2048))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "theoh"])
def test_longer_runs_have_more_degrees_of_freedom(kind):
    estimator = REGISTRY[kind]
    for alpha in range(2, estimator.lowest_alpha - 1, -1):
        edf = estimator.edf(alpha, 16, np.array([100, 200, 400, 800, 1600]), 1)
        assert np.all(np.diff(edf) >= 0)
        if kind not in ("stdev", "ostdev") or alpha >= 0:
            assert np.all(np.diff(edf) > 0)


@pytest.mark.parametrize("kind", KINDS)
def test_corrections_are_those_of_the_modified_totals_only(kind):
    correction = REGISTRY[kind].correction(0, np.array([1, 10]), 1000)
    expected = {"mtotdev": [0.73, 0.73], "ttotdev": [0.73, 0.73], "htotdev": [1.0, 0.995]}
    assert correction.tolist() == expected.get(kind, [1.0, 1.0])
