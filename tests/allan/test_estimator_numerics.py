"""No digit is lost on the way: offsets, extremes, integers, long runs."""

import numpy as np
import pytest

from allanscope.allan import deviation
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.phase import to_phase

KINDS = sorted(REGISTRY)
LENGTH = 300


@pytest.fixture(scope="module")
def counts():
    return np.random.default_rng(1).integers(-20, 21, 600)


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_has_no_deviation_at_all(kind):
    data = np.full(LENGTH, 0.1)
    assert data.mean() != 0.1
    curve = deviation(data, 10.0, kind)
    if kind in ("theobr",):
        assert np.all(np.isnan(curve.deviation))
    elif kind == "theoh":
        assert np.all(curve.deviation[curve.tau <= LENGTH / 100] == 0)
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


def test_a_stray_first_sample_does_not_tilt_the_sum():
    data = np.random.default_rng(2).standard_normal(50_000)
    data[0] = 1e6
    x = np.append(0.0, np.cumsum(data.astype(np.longdouble)))
    second = x[16:] - 2 * x[8:-8] + x[:-16]
    found = deviation(data, 1.0, taus=[8]).deviation[0]
    assert found == pytest.approx(float(np.sqrt(np.mean(second**2) / 128)), rel=1e-13)
    quiet = REGISTRY["oadev"].exact(to_phase(data, 1.0)[1:], 8)[0]
    assert quiet == pytest.approx(float(np.mean(second[1:] ** 2) / 128), rel=1e-10)


def test_floats_on_a_large_offset_lose_only_what_the_input_lost():
    noise = np.random.default_rng(2).standard_normal(20_000)
    on_offset = noise + 1e6
    np.testing.assert_allclose(
        deviation(on_offset, 100.0).deviation, deviation(noise, 100.0).deviation, rtol=1e-8
    )


@pytest.mark.parametrize("kind", ["mdev", "pdev", "oadev", "ohdev", "ostdev"])
def test_running_sums_keep_their_digits_under_a_long_random_walk(kind):
    """Against 64-bit mantissas: phases of 1e11, differences of 1e2."""
    x = 0.1 * np.random.default_rng(3).standard_normal(100_000).cumsum().cumsum().cumsum()
    variance, _ = REGISTRY[kind].exact(x, 3)
    e = x.astype(np.longdouble)
    second = e[6:] - 2 * e[3:-3] + e[:-6]
    slope = e[:-3] - e[3:]
    third = e[9:] - 3 * e[6:-3] + 3 * e[3:-6] - e[:-9]
    means = slope - slope.mean()
    expected = {
        "oadev": np.mean(second**2) / 18,
        "ohdev": np.mean(third**2) / 54,
        "mdev": np.mean((second[2:] + second[1:-1] + second[:-2]) ** 2) / 162,
        "pdev": np.mean((slope[:-3] - slope[2:-1]) ** 2) * 72 / 3**6,
        "ostdev": np.sum(means**2) / (9 * (len(means) - 1)),
    }
    assert variance == pytest.approx(float(expected[kind]), rel=1e-7)


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


@pytest.mark.parametrize("kind", ["rate", "phase"])
@pytest.mark.parametrize("offset", [2**63 - 30, 2**63 + 10**6, 2**64 - 100])
def test_unsigned_integers_beyond_the_signed_range_are_exact(kind, offset, counts):
    """Around 2^63 a record was torn in two: half of it became negative."""
    expected = to_phase(counts + 50, 4.0, kind)
    data = (counts + 20).astype(np.uint64) + np.uint64(offset - 20)
    np.testing.assert_array_equal(np.diff(to_phase(data, 4.0, kind), 2), np.diff(expected, 2))


def test_the_widest_integers_keep_the_digits_of_their_distances():
    """Too wide to be summed in 64 bits: less their least one, then as floats."""
    rng = np.random.default_rng(6)
    small = rng.integers(0, 2**50, 9000)
    data = small.astype(np.uint64) + np.uint64(2**63)
    expected = deviation(small.astype(np.float64), 1.0).deviation
    np.testing.assert_allclose(deviation(data, 1.0).deviation, expected, rtol=1e-13)
    full = np.array([-(2**63), 2**63 - 1] * 20, np.int64)
    assert deviation(full, 1.0, taus=[1.0]).deviation[0] == pytest.approx(2**64 / np.sqrt(2))


@pytest.mark.parametrize("kind", ["rate", "phase"])
@pytest.mark.parametrize("data", [[[1, 2], [3]], ["1", "2", "3"], [1j, 2, 3], [True, False, True]])
def test_what_is_no_array_of_numbers_is_refused(data, kind):
    with pytest.raises(ValueError, match="data"):
        to_phase(data, 1.0, kind)


def test_floats_that_cannot_be_squared_are_refused():
    with pytest.raises(ValueError, match="sample 2 is -1e\\+300"):
        to_phase([0.0, 1.0, -1e300, 5.0], 1.0)
