"""What the search for soft shocks computes on its way."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import rfft

from allanscope.explain.burst_rows import _SWINGS, _TOP, _Bank, _medians, _Rows


@pytest.mark.parametrize("rows", [1, 2, 7, 4096])
def test_medians_are_those_of_numpy_to_the_last_bit(rows):
    power = np.random.default_rng(rows).exponential(size=(33, rows)).astype(np.float32)
    np.testing.assert_array_equal(_medians(power.copy()), np.median(power, axis=1))


@pytest.mark.parametrize("decay", [16, 32, 64, 512])
def test_powers_of_pieces_are_those_of_a_transform(decay):
    """Of lengths with and without a pass of halves, and of pieces that are no multiple of eight."""
    rows = _Rows.of(np.random.default_rng(decay).normal(size=30_000))
    assert rows is not None
    bank = _Bank(rows, decay)
    starts = np.array([0, 3, 29_999 - bank.size, *range(100, 110)])
    form = bank.form.astype(np.float32)
    expected = np.abs(rfft(bank.rows[starts] * form, axis=1)).T ** 2
    np.testing.assert_allclose(bank.power(starts), expected, rtol=1e-5, atol=1e-5)
    ratio = np.abs(rfft(bank.rows[:: bank.hop] * form, axis=1)) ** 2 / bank.mean
    np.testing.assert_allclose(bank.largest(), ratio[:, _SWINGS:-_TOP].max(axis=1), rtol=1e-5)
