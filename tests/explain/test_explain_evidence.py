"""The probability that is printed beside an effect."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Parameter
from allanscope.explain.effects.base import ALPHA
from allanscope.explain.evidence import effect_of


def probability(**fields: float | None) -> float:
    about = {"kind": "unexplained", "parameters": {"share": Parameter(0.1)}, "price": 0.0}
    effect = effect_of(Candidate(**(about | fields)), "gx")  # type: ignore[arg-type]
    assert effect is not None
    return float(effect.evidence["p_value"])


@pytest.mark.parametrize("z", [2.0, 5.0, 6.2, 9.0])
def test_a_band_without_a_name_counts_the_bands_that_were_looked_at(z: float) -> None:
    """Its price is 0, from which a thousandth of an alternative was recovered."""
    found = probability(gain=z**2 / 2, log_alternatives=float(np.log(60)))
    assert found == pytest.approx(min(1.0, 60 * np.exp(-(z**2) / 2)), rel=1e-12)


def test_a_price_tells_how_many_alternatives_it_paid_for() -> None:
    price = float(np.log(500 / ALPHA))
    assert probability(gain=price, price=price) == pytest.approx(ALPHA, rel=1e-12)
    assert probability(gain=10.0, price=price) == pytest.approx(500 * np.exp(-10.0), rel=1e-12)
    assert probability(gain=0.5, price=price) == 1.0


@pytest.mark.parametrize("gain", [1e4, np.inf])
def test_what_is_certain_has_a_probability_that_is_a_number(gain: float) -> None:
    assert 0.0 < probability(gain=gain, price=20.0) < 1e-290
