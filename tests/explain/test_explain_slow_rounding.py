"""Noise far below the sample rate, rounded to about its size."""

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.explain import explain
from allanscope.history import Record

RATE, ROWS = 100.0, 60_000


@pytest.mark.parametrize(
    ("sigma", "corner"), [(0.5, 1.6), (0.6, 0.5), (1.0, 0.5), (0.6, 3.0), (1.0, 3.0)]
)
def test_slow_noise_that_is_rounded_keeps_its_n_and_its_low_pass(sigma, corner):
    """N was 0 to a tenth of it, beside a telegraph signal between two codes; or 30 % too low."""
    pole = np.exp(-2 * np.pi * corner / RATE)
    white = np.random.default_rng(3).standard_normal(ROWS)
    size = sigma / np.sqrt((1 - pole) / (1 + pole))
    values = np.round(size * lfilter([1 - pole], [1, -pole], white) + 0.3)
    record = Record(
        rate_hz=RATE, stride=1, axes=("gx",), values=values[:, np.newaxis], lsb=(1.0,),
        temperature_c=np.full(ROWS, np.nan), start_s=np.arange(ROWS) / RATE,
        segments=np.array([[0, ROWS]]),
    )  # fmt: skip
    result = explain(record)
    named = [one for one in result.axes["gx"].effects if one.kind != "quantization"]
    assert [one.kind for one in named] == ["band_limit"]
    assert named[0].parameters["cutoff"].value == pytest.approx(corner, rel=0.06)
    n = result.fits["gx"].coefficients["N"]
    assert n.value == pytest.approx(size / RATE**0.5, rel=0.06)
    assert result.axes["gx"].after.chi2_per_dof < 3.0


def test_a_step_that_printing_hides_is_said_to_be_too_coarse():
    """1/16.4 dps printed to four decimals is on no lattice but that of the decimals."""
    rng = np.random.default_rng(4)
    values = np.round(np.round(rng.normal(0.3, 0.3, ROWS)) / 16.4, 4)
    record = Record(
        rate_hz=RATE, stride=1, axes=("gx",), values=values[:, np.newaxis], lsb=(1e-4,),
        temperature_c=np.full(ROWS, np.nan), start_s=np.arange(ROWS) / RATE,
        segments=np.array([[0, ROWS]]),
    )  # fmt: skip
    assert any("below half a step of 61" in r for r in explain(record).axes["gx"].remarks)
