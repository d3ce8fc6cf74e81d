"""The estimators through the public names, with every kind of array that is allowed."""

import numpy as np
import pytest

from allanscope import AllanBank, Block, Deviation, Simulator, Ticks, deviation

KINDS = (
    *("stdev", "ostdev", "adev", "oadev", "mdev", "tdev", "hdev", "ohdev"),
    *("totdev", "mtotdev", "ttotdev", "htotdev", "theo1", "theobr", "theoh", "pdev"),
)
FIELDS = ("deviation", "lower", "upper", "edf", "terms", "noise")
COUNTS = (np.random.default_rng(3).standard_normal((1024, 6)) * 20 + 60).astype(np.int16)


@pytest.mark.parametrize("kind", KINDS)
def test_bank_and_array_give_the_same_first_tau_in_the_promised_shapes(kind):
    bank = AllanBank(rate=104.0)
    bank.update(COUNTS)
    curves = bank.deviation(kind, level=0.9)
    one = deviation(COUNTS[:, 2], 104.0, kind, level=0.9)
    assert isinstance(curves, Deviation)
    assert curves.tau.ndim == one.tau.ndim == 1
    for name in FIELDS:
        assert getattr(curves, name).shape == (6, curves.tau.size)
        assert getattr(one, name).shape == one.tau.shape
    same = np.isin(one.m, curves.m)
    of_bank = curves.deviation[2][np.isin(curves.m, one.m)]
    assert same.any()
    np.testing.assert_allclose(of_bank[:4], one.deviation[same][:4], rtol=1e-9)


@pytest.mark.parametrize(
    "dtype", [np.int8, np.uint8, np.int16, np.int32, np.int64, np.float32, np.float64]
)
def test_every_real_type_gives_the_same_curve(dtype):
    data = COUNTS.astype(dtype)
    expected = deviation(data[:, 0].astype(np.float64), 10.0)
    bank = AllanBank(10.0)
    bank.update(data)
    np.testing.assert_allclose(
        bank.deviation("oadev").axis(0).deviation[:2], expected.deviation[:2], rtol=1e-12
    )
    np.testing.assert_allclose(
        deviation(data[:, 0], 10.0).deviation, expected.deviation, rtol=1e-12
    )


def test_views_and_lists_are_taken_as_they_are():
    expected = deviation(COUNTS[::2, 0].copy(), 10.0).deviation
    assert deviation(COUNTS[::2, 0], 10.0).deviation.tolist() == expected.tolist()
    assert deviation(COUNTS[::2, 0].tolist(), 10.0).deviation.tolist() == expected.tolist()
    whole, turned = AllanBank(10.0), AllanBank(10.0)
    whole.update(COUNTS)
    turned.update(np.asfortranarray(COUNTS))
    assert _same(whole, turned)


def test_a_block_is_as_good_as_its_counts():
    by_block, by_array = AllanBank(104.0), AllanBank(104.0)
    block = Simulator(rate=104.0, seed=2).read(500)
    by_block.update(block)
    by_array.update(block.counts)
    by_block.update(Block(500, COUNTS, Ticks.none()))
    by_array.update(COUNTS)
    assert _same(by_block, by_array)


def test_a_bank_survives_its_state_and_merging_is_a_gap():
    whole, first, second = AllanBank(10.0), AllanBank(10.0), AllanBank(10.0)
    whole.update(COUNTS[:400])
    whole.gap()
    whole.update(COUNTS[400:])
    first.update(COUNTS[:400])
    second.update(COUNTS[400:])
    first = AllanBank.from_state(first.state())
    first.merge(second)
    assert first.samples == len(COUNTS)
    np.testing.assert_allclose(
        first.deviation("oadev").deviation, whole.deviation("oadev").deviation, rtol=1e-12
    )


def test_a_curve_cannot_be_changed():
    curve = deviation(COUNTS[:, 0], 10.0)
    with pytest.raises(AttributeError):
        curve.tau = curve.tau * 2


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (COUNTS[:, :5], r"shape \(n, 6\), got \(1024, 5\)"),
        (COUNTS[:, 0], r"shape \(n, 6\), got \(1024,\)"),
        (np.full((3, 6), np.nan), "sample 0 of axis 0 is nan"),
        (np.full((3, 6), 1j), "integers or float64, got complex128"),
        (np.full((3, 6), True), "integers or float64, got bool"),
    ],
)
def test_a_bank_refuses_what_is_no_measurement(samples, message):
    bank = AllanBank(10.0)
    with pytest.raises(ValueError, match=message):
        bank.update(samples)
    assert bank.samples == 0


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_that_is_none_is_refused(rate):
    with pytest.raises(ValueError, match="rate must be positive"):
        AllanBank(rate)
    with pytest.raises(ValueError, match="rate must be positive"):
        deviation(COUNTS[:, 0], rate)


def _same(one: AllanBank, other: AllanBank) -> bool:
    return one.deviation("mdev").deviation.tobytes() == other.deviation("mdev").deviation.tobytes()
