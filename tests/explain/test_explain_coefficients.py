"""Coefficients beside effects are as good as the noise room's: same values, intervals, decision."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.noise import fit_noise


def test_without_an_effect_they_are_those_of_the_noise_room(bench):
    b = bench(31)
    record = b.record(b.noise())
    plain, beside = fit_noise(record, "gx").coefficients, explain(record).axes["gx"]
    assert beside.effects == ()
    for name in "NBK":
        one, other = plain[name], beside.coefficients_after[name]
        assert other.detected == one.detected
        assert other.value == pytest.approx(one.value, abs=0.1 * (one.upper - one.lower))
        assert other.lower == pytest.approx(one.lower, abs=0.1 * (one.upper - one.lower))
        assert other.upper == pytest.approx(one.upper, rel=0.1)
        assert (other.wait_s is None) == (one.wait_s is None)


def test_a_coefficient_is_detected_only_where_its_interval_excludes_zero(bench):
    for seed in (33, 34):
        b = bench(seed)
        line = 5e-3 * np.sin(2 * np.pi * 0.7 * b.t)
        result = explain(b.record(b.noise() + line)).axes["gx"]
        assert [effect.kind for effect in result.effects] == ["sinusoid"]
        for found in (result.coefficients_before, result.coefficients_after):
            for name in "NBK":
                assert found[name].detected == (found[name].lower > 0)
                assert found[name].lower <= found[name].value <= found[name].upper
        # After 20 minutes nobody knows K, and the result says how long that will take.
        assert result.coefficients_after["K"].wait_s > 600


def test_a_process_beside_the_textbook_takes_what_is_its_own(bench):
    b = bench(38)
    noise = b.noise()
    clean = explain(b.record(noise)).axes["gx"].coefficients_after
    result = explain(b.record(noise + b.gauss_markov(12e-3, 10.0))).axes["gx"]
    assert [effect.kind for effect in result.effects] == ["gauss_markov"]
    before, after = result.coefficients_before, result.coefficients_after
    assert before["K"].detected
    assert not after["K"].detected
    assert after["N"].value == pytest.approx(clean["N"].value, rel=0.01)
    assert after["B"].upper < 1.5 * before["B"].upper
