"""Every estimator against its equation, written out term by term."""

import numpy as np
import pytest

from allanscope.allan.estimators import REGISTRY
from allanscope.verify.certified import DEFINITIONS

N = 60


@pytest.fixture(scope="module")
def phase():
    steps = np.random.default_rng(3).integers(-9, 10, N)
    return np.append(0.0, np.cumsum(steps))


def allan(x, m):
    return DEFINITIONS["oadev"](x, m)


def theo1(x, m):
    return DEFINITIONS["theo1"](x, m)


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 10, 16, 19])
@pytest.mark.parametrize("kind", sorted(set(DEFINITIONS) - {"theobr", "theoh"}))
def test_value_and_terms_follow_the_equation(kind, m, phase):
    if REGISTRY[kind].even and m % 2:
        pytest.skip("only even windows")
    variance, terms = REGISTRY[kind].exact(phase, m)
    expected, count = DEFINITIONS[kind](phase.tolist(), m)
    assert terms == count
    assert variance == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("m", [N, N - 1, N // 2 + 1])
def test_total_deviation_reaches_the_end_of_the_run(m, phase):
    assert REGISTRY["totdev"].exact(phase, m)[0] == pytest.approx(
        DEFINITIONS["totdev"](phase.tolist(), m)[0]
    )


@pytest.fixture(scope="module")
def long_phase():
    return np.append(0.0, np.cumsum(np.random.default_rng(8).standard_normal(400)))


def test_theobr_scales_theo1_by_the_mean_ratio_of_allan_to_theo1(long_phase):
    x = long_phase.tolist()
    ratios = [allan(x, 9 + 3 * i)[0] / theo1(x, 12 + 4 * i)[0] for i in range(401 // 30 - 3 + 1)]
    raw = theo1(x, 200)[0]
    variance, windows = REGISTRY["theobr"].exact(long_phase, 200)
    assert len(ratios) == 11
    assert variance == pytest.approx(raw * np.mean(ratios), rel=1e-12)
    assert windows == 201


def test_theobr_needs_ninety_phases(long_phase):
    assert np.isnan(REGISTRY["theobr"].exact(long_phase[:89], 40)[0])
    variance, _ = REGISTRY["theobr"].exact(long_phase[:90], 40)
    x = long_phase[:90].tolist()
    assert variance == pytest.approx(theo1(x, 40)[0] * allan(x, 9)[0] / theo1(x, 12)[0])


def test_theoh_is_allan_up_to_a_tenth_of_the_run_and_theobr_above(long_phase):
    theoh = REGISTRY["theoh"]
    found = theoh.curve(long_phase, [1, 40, 54, 300])
    expected = [
        REGISTRY["oadev"].exact(long_phase, 1),
        REGISTRY["oadev"].exact(long_phase, 40),
        REGISTRY["theobr"].exact(long_phase, 54),
        REGISTRY["theobr"].exact(long_phase, 300),
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert theoh.tau([1, 40, 54, 300], 400).tolist() == [1.0, 40.0, 40.5, 225.0]
    assert [m for m in range(38, 58) if theoh.admits(m, 400)] == [38, 39, 40, 54, 56]


def test_a_long_record_thins_the_ratio_of_theobr_without_moving_it():
    from allanscope.allan.estimators import theobr

    x = np.append(0.0, np.cumsum(np.random.default_rng(2).standard_normal(12_000)))
    steps = range(x.size // 30 - 3 + 1)
    full = np.mean(
        [
            REGISTRY["oadev"].exact(x, 9 + 3 * i)[0] / REGISTRY["theo1"].exact(x, 12 + 4 * i)[0]
            for i in steps[::3]
        ]
    )
    assert theobr.theobr_ratio(x) == pytest.approx(full, rel=3e-3)
