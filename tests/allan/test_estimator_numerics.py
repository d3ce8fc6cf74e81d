"""No digit is lost on the way: offsets, extremes, integers, long runs."""

import numpy as np
import pytest

from allanscope.allan import deviation
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.phase import to_phase

KINDS = sorted(REGISTRY)


@pytest.fixture(scope="module")
def counts():
    return np.random.default_rng(1).integers(-20, 21, 600)


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_has_no_deviation_at_all(kind):
    curve = deviation(np.full(400, 0.1), 10.0, kind)
    if kind in ("theobr",):
        assert np.all(np.isnan(curve.deviation))
    elif kind == "theoh":
        assert np.all(curve.deviation[curve.tau <= 4.0] == 0)
    else:
        assert np.all(curve.deviation == 0)
        assert np.all(curve.upper == 0)


@pytest.mark.parametrize("dtype", [np.int8, np.int16, np.int32, np.int64, np.float32, np.float64])
@pytest.mark.parametrize("kind", KINDS)
def test_the_type_of_the_samples_does_not_matter(kind, dtype, counts):
    expected = deviation(counts.astype(np.float64), 10.0, kind).deviation
    np.testing.assert_allclose(
        deviation(counts.astype(dtype), 10.0, kind).deviation, expected, rtol=1e-11
    )


@pytest.mark.parametrize("kind", KINDS)
def test_integers_on_a_huge_offset_are_exact(kind, counts):
    expected = deviation(counts, 10.0, kind).deviation
    np.testing.assert_array_equal(deviation(counts + 10**15, 10.0, kind).deviation, expected)


def test_unsigned_integers_do_not_wrap():
    data = np.array([5, 3, 200, 0, 255, 1, 1, 9] * 5, np.uint8)
    for kind in ("rate", "phase"):
        expected = to_phase(data.astype(np.int64), 4.0, kind)
        np.testing.assert_array_equal(to_phase(data, 4.0, kind), expected)


def test_integer_phase_beyond_the_digits_of_float64_is_exact(counts):
    phase = np.append(0, np.cumsum(counts + 10**15))
    assert phase[-1] > 2**53
    expected = deviation(counts, 1.0).deviation
    np.testing.assert_allclose(deviation(phase, 1.0, data_kind="phase").deviation, expected, 1e-14)


def test_floats_on_a_large_offset_lose_only_what_the_input_lost():
    noise = np.random.default_rng(2).standard_normal(20_000)
    on_offset = noise + 1e6
    np.testing.assert_allclose(
        deviation(on_offset, 100.0).deviation, deviation(noise, 100.0).deviation, rtol=1e-8
    )


@pytest.mark.parametrize("kind", ["mdev", "pdev", "oadev", "totdev", "ostdev"])
def test_running_sums_keep_their_digits_under_a_long_random_walk(kind):
    steps = np.random.default_rng(3).integers(-3, 4, 100_000).cumsum()
    x = to_phase(steps, 1.0)
    variance, terms = REGISTRY[kind].exact(x, 3)
    # The same in exact rational arithmetic, scaled to integers.
    e = np.append(0, np.cumsum(steps - steps[0])).astype(object)
    if kind == "ostdev":
        w = e[3:] - e[:-3]
        expected = (sum(w * w) - sum(w) ** 2 / len(w)) / (9 * (len(w) - 1))
    elif kind == "mdev":
        u = e[6:] - 2 * e[3:-3] + e[:-6]
        s = u[2:] + u[1:-1] + u[:-2]
        expected = sum(s * s) / (2 * 81 * len(s))
    elif kind == "pdev":
        u = e[:-3] - e[3:]
        s = u[:terms] - u[2 : terms + 2]
        expected = 72 * sum(s * s) / (3**6 * terms)
    else:
        u = e[6:] - 2 * e[3:-3] + e[:-6]
        expected = sum(u * u) / (2 * 9 * len(u))
    tolerance = 1e-4 if kind == "totdev" else 1e-11  # the images add a little
    assert variance == pytest.approx(float(expected), rel=tolerance)


def test_modified_totals_restart_their_running_sum_without_a_seam():
    x = np.cumsum(np.random.default_rng(4).standard_normal(400))
    whole, windows = REGISTRY["mtotdev"].exact(x, 10)
    one_by_one = [REGISTRY["mtotdev"].exact(x[i : i + 30], 10)[0] for i in range(windows)]
    assert windows == 371
    assert whole == pytest.approx(np.mean(one_by_one), rel=1e-12)


@pytest.mark.parametrize("stride", [2, 3, 7])
def test_thinned_windows_are_every_so_many_of_all(stride):
    from allanscope.allan.estimators.htotdev import htot_variance
    from allanscope.allan.estimators.mtotdev import mtot_variance
    from allanscope.allan.estimators.theo1 import theo1_variance

    x = np.cumsum(np.random.default_rng(5).standard_normal(300))
    for function, m, length in ((mtot_variance, 10, 30), (htot_variance, 10, 31)):
        starts = range(0, x.size - length + 1, stride)
        expected = [function(x[i : i + length], m)[0] for i in starts]
        variance, windows = function(x, m, stride)
        assert windows == len(expected)
        assert variance == pytest.approx(np.mean(expected), rel=1e-12)
    starts = range(0, x.size - 20, stride)
    expected = [theo1_variance(x[i : i + 21], 20)[0] for i in starts]
    variance, windows = theo1_variance(x, 20, stride)
    assert windows == len(expected)
    assert variance == pytest.approx(np.mean(expected), rel=1e-12)
