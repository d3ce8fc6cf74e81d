"""Resonances side by side, as of a vibration, with and without a low-pass behind them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from allanscope.analysis.coefficients import total_white

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")
sys.path.insert(0, BENCHMARKS)
try:
    from vibration import SIGMA, N, found_in, white
finally:
    sys.path.remove(BENCHMARKS)


@pytest.mark.parametrize(
    ("bands", "frequencies"),
    [
        ([(6.5, 0.4, 2.5), (6.9, 0.3, 2), (8.7, 0.6, 1.5), (12.7, 1, 0.6)], [6.7, 8.7, 12.7]),
        ([(8.9, 0.1, 2.4), (11.8, 1, 2), (22, 1.6, 2)], [8.9, 11.8, 22]),
    ],
)
def test_resonances_side_by_side_are_bands_and_no_low_pass(bands, frequencies):
    """A low-pass that ends with the last had N up to 2.7 times too large."""
    found = found_in(np.random.default_rng(1), bands, None).axes["gx"]
    assert {effect.kind for effect in found.effects} == {"narrowband"}
    at = sorted(effect.parameters["frequency"].value for effect in found.effects)
    assert at == pytest.approx(frequencies, abs=0.2)
    assert found.coefficients_after["N"].value == pytest.approx(N, rel=0.04)


@pytest.mark.parametrize(
    ("bands", "cutoff", "frequencies"),
    [
        ([(9.5, 0.07, 0.6), (11.1, 0.86, 1.5), (12.6, 0.33, 0.7)], 31, [9.5, 11.1, 12.6]),
        ([(19, 0.8, 2), (27, 0.9, 2.2), (30, 0.5, 2.2)], 24, [19, 27, 30]),
    ],
)
def test_resonances_side_by_side_are_told_from_the_low_pass_behind_them(bands, cutoff, frequencies):
    """Their skirts pass it too: taken to lie behind it, no two were compatible with the top."""
    whole = found_in(np.random.default_rng(2), bands, cutoff)
    found, told = whole.axes["gx"], total_white(whole.fits["gx"])
    at = [e.parameters["frequency"].value for e in found.effects if e.kind == "narrowband"]
    assert sorted(at) == pytest.approx(frequencies, abs=0.1)
    (low_pass,) = (e for e in found.effects if e.kind == "band_limit")
    assert low_pass.parameters["cutoff"].value == pytest.approx(cutoff, rel=0.05)
    assert told.value == pytest.approx(white(bands), rel=0.03)


def test_five_resonances_of_a_long_record_are_five_and_nothing_else():
    """Estimated in turn the first kept what is of two, and others described what that left."""
    bands = [(12.7, 0.35, 1.7), (15.2, 0.4, 2), (16.7, 1.6, 1.9), (20.4, 1, 0.9), (24.3, 0.35, 0.7)]
    whole = found_in(np.random.default_rng(3), bands, None, 300_000)
    found, told = whole.axes["gx"], total_white(whole.fits["gx"])
    assert {effect.kind for effect in found.effects} == {"narrowband"}
    order = sorted(found.effects, key=lambda e: e.parameters["frequency"].value)
    for effect, (frequency, width, times) in zip(order, bands, strict=True):
        assert effect.parameters["frequency"].value == pytest.approx(frequency, abs=0.1)
        assert effect.parameters["bandwidth"].value == pytest.approx(width, rel=0.15)
        assert effect.parameters["sigma"].value == pytest.approx(times * SIGMA, rel=0.1)
    assert told.value == pytest.approx(white(bands), rel=0.02)
