"""The probability that is printed beside an effect."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain.candidate import ALPHA, Candidate, effect_of
from allanscope.explain.effect import Estimate
from allanscope.explain.effects.ramp import Ramp
from allanscope.explain.effects.unexplained import Unexplained

RANGE = Unexplained(Estimate(1.0), Estimate(2.0), "spectrum", "a range")


def probability(gain: float, log_alternatives: float, *, is_paid: bool = False) -> float:
    effect = effect_of(Candidate(RANGE, gain, log_alternatives, is_paid=is_paid), "gx")
    assert effect is not None
    return float(effect.evidence["p_value"])


@pytest.mark.parametrize("z", [2.0, 5.0, 6.2, 9.0])
def test_a_band_without_a_name_counts_the_bands_that_were_looked_at(z: float) -> None:
    """It has no penalty, and its probability is that of all bands nevertheless."""
    found = probability(z**2 / 2, float(np.log(60)), is_paid=True)
    assert found == pytest.approx(min(1.0, 60 * np.exp(-(z**2) / 2)), rel=1e-12)


def test_a_gain_of_the_penalty_has_the_probability_of_a_false_alarm() -> None:
    looked_at = float(np.log(500))
    penalty = Candidate(RANGE, 0.0, looked_at).penalty
    assert penalty == pytest.approx(np.log(500 / ALPHA), rel=1e-12)
    assert probability(penalty, looked_at) == pytest.approx(ALPHA, rel=1e-12)
    assert probability(10.0, looked_at) == pytest.approx(500 * np.exp(-10.0), rel=1e-12)
    assert probability(0.5, looked_at) == 1.0


def test_a_coefficient_of_the_textbook_is_no_effect() -> None:
    assert effect_of(Candidate(Ramp(Estimate(1.0)), 50.0), "gx") is None


@pytest.mark.parametrize("gain", [1e4, np.inf])
def test_what_is_certain_has_a_probability_that_is_a_number(gain: float) -> None:
    assert 0.0 < probability(gain, 13.0) < 1e-290
