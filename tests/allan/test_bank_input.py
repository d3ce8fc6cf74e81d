"""Wrong input is refused with one line that says what and where, and leaves no trace."""

import numpy as np
import pytest

from allanscope.allan import AllanBank, deviation
from allanscope.allan.estimators import REGISTRY


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_must_be_positive(rate):
    with pytest.raises(ValueError, match="rate must be positive"):
        AllanBank(rate)
    bank = AllanBank(1.0, axes=1)
    with pytest.raises(ValueError, match="rate must be positive"):
        bank.deviation("oadev", rate=rate)


@pytest.mark.parametrize("level", [0.0, 1.0, -0.5, np.nan])
def test_a_level_must_be_a_probability(level):
    bank = AllanBank(1.0, axes=1)
    for _ in range(2):
        with pytest.raises(ValueError, match="level"):
            bank.deviation("oadev", level=level)
        bank.update(np.arange(10.0))


def test_axes_taus_and_scale_must_make_sense():
    for arguments in ({"axes": 0}, {"per_octave": 0}, {"axes": 2, "scale": [1.0]}):
        with pytest.raises(ValueError, match=r"axes|scale"):
            AllanBank(1.0, **arguments)
    with pytest.raises(ValueError, match="scale"):
        AllanBank(1.0, axes=2, scale=[1.0, np.nan])


@pytest.mark.parametrize("shape", [(5,), (5, 3), (5, 2, 1), ()])
def test_samples_must_have_a_column_for_each_axis(shape):
    with pytest.raises(ValueError, match=r"shape \(n, 2\)"):
        AllanBank(1.0, axes=2).update(np.zeros(shape))


def test_masked_samples_are_refused():
    bank = AllanBank(1.0, axes=1)
    with pytest.raises(ValueError, match="masked"):
        bank.update(np.ma.masked_equal(np.arange(9), 4))
    bank.update(np.ma.masked_equal(np.arange(9), 40))  # an array that could have a mask
    assert bank.samples == 9


@pytest.mark.parametrize("dtype", [np.complex128, np.bool_, np.longdouble, "U3", object])
def test_samples_must_be_numbers_that_a_double_holds(dtype):
    with pytest.raises(ValueError, match="integers or float64"):
        AllanBank(1.0, axes=2).update(np.zeros((4, 2)).astype(dtype))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
def test_a_sample_that_is_not_finite_is_named_and_nothing_is_taken_in(bad):
    bank = AllanBank(1.0, axes=2)
    bank.update(np.ones((100, 2)))
    before = bank.state()
    data = np.ones((50, 2))
    data[7, 1] = bad
    with pytest.raises(ValueError, match="sample 107 of axis 1 is"):
        bank.update(data)
    for name, array in bank.state().items():
        np.testing.assert_array_equal(array, before[name])


def test_an_unknown_estimator_is_refused_with_all_names():
    with pytest.raises(ValueError, match="oadev"):
        AllanBank(1.0).deviation("allan")


def test_the_caller_keeps_his_array():
    data = np.random.default_rng(0).normal(size=100)
    kept = data.copy()
    AllanBank(1.0, axes=1).update(data)
    np.testing.assert_array_equal(data, kept)


@pytest.mark.parametrize("n", [0, 1, 2, 3])
@pytest.mark.parametrize("kind", sorted(REGISTRY))
def test_a_run_that_is_too_short_has_an_empty_curve_or_nan(kind, n):
    bank = AllanBank(1.0, axes=3)
    bank.update(np.arange(3.0 * n).reshape(n, 3))
    curve = bank.deviation(kind)
    assert curve.deviation.shape == curve.lower.shape == curve.terms.shape == (3, curve.tau.size)
    assert curve.noise.shape == curve.edf.shape == (3, curve.tau.size)
    assert curve.tau.shape == curve.m.shape == curve.trusted.shape[-1:]
    if n < 2:
        assert not np.isfinite(curve.deviation).any()


@pytest.mark.parametrize("dtype", [np.int8, np.uint16, np.int16, np.int32, np.int64, np.float32])
def test_all_types_that_fit_give_the_same(dtype):
    data = np.random.default_rng(1).integers(0, 100, (300, 2))
    expected, bank = (AllanBank(1.0, axes=2) for _ in range(2))
    expected.update(data.astype(np.float64))
    bank.update(np.asfortranarray(data.astype(dtype))[::1])
    np.testing.assert_array_equal(
        bank.deviation("oadev").deviation, expected.deviation("oadev").deviation
    )


@pytest.mark.parametrize(
    "anchor",
    [[1.0], [1.0, 2.0, 3.0], 1.0, [[1.0, 2.0]], [0.0, np.nan], [np.inf, 0.0], [0.0, 1e200]],
)
def test_an_anchor_is_a_finite_number_for_each_axis(anchor):
    """A wider one wrote past the end of the rungs."""
    with pytest.raises(ValueError, match="2 axes need as many finite anchors"):
        AllanBank(1.0, axes=2, anchor=anchor)


def test_the_caller_keeps_his_anchor():
    anchor = np.array([5, 7])
    bank = AllanBank(1.0, axes=2, anchor=anchor)
    anchor[:] = 0
    bank.update(np.arange(20.0).reshape(10, 2))
    np.testing.assert_array_equal(bank.state()["anchor"], [5.0, 7.0])


@pytest.mark.parametrize("bad", [True, "2", None, 1.5, np.array([1, 2]), 0, -1])
def test_axes_and_taus_an_octave_are_whole_numbers(bad):
    for name in ("axes", "per_octave"):
        with pytest.raises(ValueError, match="whole axes"):
            AllanBank(1.0, **{"axes": 1, name: bad})


@pytest.mark.parametrize("rate", [None, "100", 1j, [100.0], np.array([1.0, 2.0])])
def test_a_rate_is_one_number(rate):
    with pytest.raises(ValueError, match="rate must be positive"):
        AllanBank(rate)
    with pytest.raises(ValueError, match="rate must be positive"):
        deviation(np.arange(9.0) % 2, rate)


@pytest.mark.parametrize(
    ("dtype", "bad"),
    [(np.uint64, 2**53 + 1), (np.uint64, 2**64 - 1), (np.int64, 2**53 + 1), (np.int64, -(2**63))],
)
def test_integers_that_no_double_holds_are_refused_by_name(dtype, bad):
    """They were rounded without a word: a record of 2^63, 2^63 + 1, ... had no deviation at all."""
    bank = AllanBank(1.0, axes=2)
    data = np.zeros((9, 2), dtype)
    data[4, 1] = bad
    with pytest.raises(ValueError, match=rf"sample 4 of axis 1 is {bad}, beyond 2\^53.*subtract"):
        bank.update(data)
    assert bank.samples == 0
    data[4, 1] = min(abs(bad), 2**53)
    bank.update(data)
    assert bank.samples == 9


def test_banks_of_different_rates_are_not_merged():
    one, other = AllanBank(100.0, axes=1), AllanBank(104.0, axes=1)
    for bank in (one, other):
        bank.update(np.arange(9.0))
    with pytest.raises(ValueError, match="rate"):
        one.merge(other)
    with pytest.raises(ValueError, match="rate"):
        one + other
    other.rate = 100.0
    one.merge(other)
    assert one.samples == 18
