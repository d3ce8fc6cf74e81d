"""Lines at multiples of a frequency at which nothing is seen are one finding."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope import analyse
from allanscope.analysis.combs import fundamental_of
from allanscope.analysis.finding_phrases import finding_phrase

RATE = 50.0


def lines_of(fundamental, orders, error, rng):
    orders = np.array(orders)
    return fundamental * orders + rng.uniform(-error, error, len(orders)), np.full(
        len(orders), error
    )


@pytest.mark.parametrize("orders", [(14, 15, 34, 46, 50), (5, 7, 8, 11, 13), (2, 5, 7, 9, 31)])
def test_the_fundamental_is_the_largest_of_which_all_are_multiples(orders):
    rng = np.random.default_rng(1)
    frequency, error = lines_of(0.0969, orders, 2e-4, rng)
    strangers = np.array([0.3331, 4.111, 7.7777])
    found, members = fundamental_of(
        np.append(frequency, strangers), np.append(error, np.full(3, 2e-4))
    )
    assert found == pytest.approx(0.0969, abs=2e-5)
    assert members == tuple(range(len(orders)))


def test_three_lines_or_vague_ones_are_no_comb():
    rng = np.random.default_rng(2)
    for orders, error in (((14, 15, 34), 1e-5), ((14, 15, 34, 46, 50), 4e-3)):
        assert fundamental_of(*lines_of(0.0969, orders, error, rng)) is None


def test_a_line_that_is_known_to_no_better_than_a_multiple_belongs_to_no_comb():
    rng = np.random.default_rng(3)
    frequency, error = lines_of(0.0969, (14, 15, 34, 46, 50), 2e-4, rng)
    frequency, error = np.append(frequency, 60 * 0.0969), np.append(error, 0.02)
    assert fundamental_of(frequency, error)[1] == (0, 1, 2, 3, 4)


def test_lines_are_no_comb_by_chance():
    rng = np.random.default_rng(4)
    drawn = [
        (rng.uniform(0.3, top, count), rng.uniform(1e-4, 2e-3, count))
        for count in (5, 8, 12)
        for top in (5.0, 50.0)
        for _ in range(60)
    ]
    assert sum(fundamental_of(*one) is not None for one in drawn) <= 4  # 3.6 are allowed for


def test_pulses_at_equal_distances_are_one_finding():
    """Bursts every 4.32 s, as of a logger that empties its buffer, are lines from order five on."""
    rng, t = np.random.default_rng(3), np.arange(25_000) / RATE
    phase = (t + 2.16) % 4.32 - 2.16
    bursts = 0.03 * np.exp(-((phase / 0.15) ** 2)) * np.cos(2 * np.pi * 2.5 * phase)
    result = analyse({"gx": bursts + rng.normal(0, 0.02, len(t))}, RATE)
    (found,) = result.findings
    assert found.comb.fundamental_hz == pytest.approx(1 / 4.32, rel=1e-4)
    assert found.comb.orders[0] > 2
    assert len(found.comb.orders) == len(found.members) > 8
    orders = ", ".join(map(str, found.comb.orders[:-1]))
    told = f"lines at {orders} and {found.comb.orders[-1]} times 0.231 Hz (every 4.32 s), "
    assert finding_phrase(found).startswith(told)
    assert result.to_dict()["findings"][0]["comb"]["orders"] == list(found.comb.orders)
