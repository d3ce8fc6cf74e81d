"""`wait` says to the sample when a value is there: 0 s exactly where there is one."""

import numpy as np
import pytest

from allanscope.allan import AllanBank
from allanscope.allan.curves import factors_of_rows
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.kernels import COLUMNS

STREAMED = sorted(kind for kind, one in REGISTRY.items() if (one.derived_from or kind) in COLUMNS)
RATE = 10.0


def bank_with(n, per_octave=2, axes=1, seed=0):
    bank = AllanBank(RATE, axes=axes, per_octave=per_octave)
    bank.update(np.random.default_rng(seed).normal(size=(n, axes)))
    return bank


def has_value(bank, kind, tau):
    curve = bank.deviation(kind)
    here = np.isclose(curve.tau, tau, rtol=1e-9)
    return bool(here.any() and np.isfinite(curve.deviation[:, here]).all())


def assert_kept(bank, kind, tau):
    """Run for as long as `wait` says, less one sample, and then for that."""
    missing = bank.wait(kind, tau) * RATE
    assert missing == pytest.approx(round(missing), abs=1e-6)
    assert has_value(bank, kind, tau) == (missing == 0)
    if missing:
        rng = np.random.default_rng(1)
        bank.update(rng.normal(size=(round(missing) - 1, bank.axes)))
        assert not has_value(bank, kind, tau)
        assert bank.wait(kind, tau) == pytest.approx(1 / RATE)
        bank.update(rng.normal(size=(1, bank.axes)))
        assert has_value(bank, kind, tau)
        assert bank.wait(kind, tau) == 0.0


@pytest.mark.parametrize("m", [1, 2, 45, 64, 90, 128, 180, 512, 1440])
@pytest.mark.parametrize("kind", STREAMED)
def test_it_is_exact_on_every_rung(kind, m):
    """From m = 64 on terms begin at every second, fourth ... sample only."""
    for n in (0, 1, 77, 1234):
        assert_kept(bank_with(n), kind, m / RATE)


@pytest.mark.parametrize("kind", STREAMED)
def test_terms_of_earlier_segments_count(kind):
    for m in (16, 128):
        bank = bank_with(3 * m + 1)
        bank.gap()
        assert_kept(bank, kind, m / RATE)
        bank.gap()
        assert_kept(bank, kind, 2 * m / RATE)


@pytest.mark.parametrize("kind", sorted(set(REGISTRY) - set(STREAMED) - {"theoh"}))
@pytest.mark.parametrize("n", [500, 8192, 8193, 20_000])
def test_it_is_exact_for_what_comes_from_the_archive(kind, n):
    factor = REGISTRY[kind].tau_factor
    for m in (64, 512, 2048, 4096, 8192):
        bank = bank_with(n)
        if m >= 32 * bank._archive.stride:
            assert_kept(bank, kind, factor * m / RATE)


@pytest.mark.parametrize("n", [10, 89, 500, 1000, 20_000])
def test_it_is_exact_for_the_hybrid(n):
    for m in (8, 64, 128):
        bank = bank_with(n)
        missing = bank.wait("theoh", m / RATE) * RATE
        curve = bank.deviation("theoh")
        near = np.isfinite(curve.deviation[0]) & (np.abs(np.log2(curve.tau * RATE / m)) < 0.3)
        assert near.any() == (missing == 0)
        bank.update(np.random.default_rng(1).normal(size=round(missing)))
        assert bank.wait("theoh", m / RATE) == 0.0
        curve = bank.deviation("theoh")
        near = np.isfinite(curve.deviation[0]) & (np.abs(np.log2(curve.tau * RATE / m)) < 0.3)
        assert near.any()


def test_it_promises_nothing_where_no_value_will_come():
    """The archive's rows are two samples here: windows below 32 rows are gone for good."""
    bank = bank_with(20_000)
    assert bank._archive.stride > 2
    assert not has_value(bank, "mtotdev", 0.8)
    assert bank.wait("mtotdev", 0.8) == np.inf
    assert bank.wait("theo1", 0.3) == np.inf
    assert bank.wait("oadev", 0.01) == np.inf
    level = AllanBank(RATE, axes=1)
    level.update(np.ones(400))
    assert not np.isfinite(level.deviation("theobr").deviation).any()
    assert level.wait("theobr", 4.8) == np.inf


def test_it_waits_for_every_axis_and_all_rates():
    bank = bank_with(30, axes=3)
    assert bank.wait("oadev", 1.6, rate=20.0) == pytest.approx((65 - 30) / 20.0)


def test_it_grows_with_the_archive():
    """A window of which the archive can hold so many rows only after it has thinned."""
    bank = bank_with(8000)
    kind, rows = REGISTRY["mtotdev"], bank._archive.rows.shape[2]
    assert max(factors_of_rows(kind, 1, rows, 2)) < 16384
    assert_kept(bank, "mtotdev", 1638.4)
