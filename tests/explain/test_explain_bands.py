"""Resonances side by side, as of a vibration, with and without a low-pass behind them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import butter, lfilter

from allanscope.explain import explain
from allanscope.history import Record

RATE, N, LSB = 100.0, 4e-3, 4.375e-3
SIGMA = N * RATE**0.5


def resonance(rng, n, frequency, width):
    """Return an oscillator that noise shakes, of unit variance, exact at the samples."""
    turn = 2 * np.pi * frequency
    step = expm(np.array([[0.0, 1.0], [-(turn**2), -2 * np.pi * width]]) / RATE)
    stationary = np.diag([1.0, turn**2])
    kicks = rng.normal(size=(n, 2)) @ np.linalg.cholesky(stationary - step @ stationary @ step.T).T
    poles, modes = np.linalg.eig(step)
    each = np.linalg.solve(modes, kicks.T.astype(complex))
    moved = [
        m * lfilter([1], [1, -pole], x) for m, pole, x in zip(modes[0], poles, each, strict=True)
    ]
    return sum(moved).real


def found_in(seed, bands, cutoff=None):
    """Return what is found in five minutes of white noise and bands of (Hz, width, times SIGMA)."""
    rng, n = np.random.default_rng(seed), 30_000
    x = rng.normal(0, SIGMA, n)
    for frequency, width, size in bands:
        x += size * SIGMA * resonance(rng, n, frequency, width)
    if cutoff is not None:
        x = lfilter(*butter(2, 2 * cutoff / RATE), x) + rng.normal(0, 0.03 * SIGMA, n)
    record = Record(
        rate_hz=RATE, stride=1, axes=("gx",), values=(np.round(x / LSB) * LSB)[:, np.newaxis],
        lsb=(LSB,), temperature_c=np.full(n, np.nan), start_s=np.arange(n) / RATE,
        segments=np.array([[0, n]]),
    )  # fmt: skip
    return explain(record).axes["gx"]


@pytest.mark.parametrize(
    ("bands", "frequencies"),
    [
        ([(6.5, 0.4, 2.5), (6.9, 0.3, 2), (8.7, 0.6, 1.5), (12.7, 1, 0.6)], [6.7, 8.7, 12.7]),
        (
            [
                (12.7, 0.35, 1.7),
                (15.2, 0.4, 2),
                (16.7, 1.6, 1.9),
                (20.4, 1, 0.9),
                (24.3, 0.35, 0.7),
            ],
            [12.7, 15.2, 16.7, 20.4, 24.3],
        ),
        ([(8.9, 0.1, 2.4), (11.8, 1, 2), (22, 1.6, 2)], [8.9, 11.8, 22]),
    ],
)
def test_resonances_side_by_side_are_bands_and_no_low_pass(bands, frequencies):
    """A low-pass that ends with the last had N up to 2.7 times too large."""
    found = found_in(1, bands)
    assert {effect.kind for effect in found.effects} == {"narrowband"}
    at = sorted(effect.parameters["frequency"].value for effect in found.effects)
    assert at == pytest.approx(frequencies, abs=0.2)
    assert found.coefficients_after["N"].value == pytest.approx(N, rel=0.04)


def test_resonances_side_by_side_are_told_from_the_low_pass_behind_them():
    found = found_in(2, [(9.5, 0.07, 0.6), (11.1, 0.86, 1.5), (12.6, 0.33, 0.7)], cutoff=31)
    bands = [e.parameters["frequency"].value for e in found.effects if e.kind == "narrowband"]
    assert sorted(bands) == pytest.approx([9.5, 11.1, 12.6], abs=0.1)
    (low_pass,) = (e for e in found.effects if e.kind == "band_limit")
    assert low_pass.parameters["cutoff"].value == pytest.approx(31, rel=0.03)
    assert found.coefficients_after["N"].value == pytest.approx(N, rel=0.03)
