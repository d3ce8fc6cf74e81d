"""Short gaps are bridged so that neither the density nor what is read from it changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, welch

from allanscope.noise import fit_noise
from allanscope.noise.gap_bridging import bridge_gaps
from support.thinned import RATE, thinned

ROWS = 24_000
MISSING = 0.13
N, B, K = 5e-3, 2.6e-3, 3e-3
"""In dps/sqrt(Hz), dps, dps sqrt(Hz): of a second at 100 Hz the walk makes what N makes in one."""
SEEDS = range(4)


def _kept(rng: np.random.Generator, missing: float = MISSING) -> np.ndarray:
    kept = rng.random(ROWS) >= missing
    kept[[0, -1]] = True
    return kept


def _white(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(0, N * RATE**0.5, ROWS)


def _flicker_and_walk(rng: np.random.Generator) -> np.ndarray:
    """Return noise of the density B^2 / f + (K / 2 pi f)^2, two-sided halves of it."""
    long = 4 * ROWS  # so that what is cut from it is not periodic
    f = np.fft.rfftfreq(long, 1 / RATE)[1:]
    shape = np.sqrt(0.5 * RATE * (B**2 / (2 * np.pi) / f))
    white = np.fft.rfft(rng.standard_normal(long))
    flicker = np.fft.irfft(np.concatenate([[0], white[1:] * shape * np.sqrt(2)]), long)[:ROWS]
    return flicker + np.cumsum(rng.normal(0, K / RATE**0.5, ROWS))


@pytest.mark.parametrize("missing", [MISSING, 0.22])
@pytest.mark.parametrize("seed", SEEDS)
def test_white_noise_keeps_its_n_and_shows_nothing_slow(seed, missing):
    rng = np.random.default_rng([seed, 1])
    fit = fit_noise(thinned(_white(rng)[:, np.newaxis], _kept(rng, missing)), "gx")
    assert fit.coefficients["N"].value == pytest.approx(N, rel=0.03)
    assert not fit.coefficients["B"].detected
    assert not fit.coefficients["K"].detected
    assert fit.band_limit is None


@pytest.mark.parametrize("seed", SEEDS)
def test_slow_noise_keeps_its_coefficients(seed):
    rng = np.random.default_rng([seed, 2])
    samples = (_white(rng) + _flicker_and_walk(rng))[:, np.newaxis]
    found = fit_noise(thinned(samples, _kept(rng)), "gx").coefficients
    assert found["N"].value == pytest.approx(N, rel=0.03)
    for name, true in (("B", B), ("K", K)):
        assert found[name].lower <= true <= found[name].upper, name


def test_the_interval_of_n_knows_that_rows_are_missing():
    rng = np.random.default_rng(3)
    samples = _white(rng)[:, np.newaxis]

    def width(kept: np.ndarray | None) -> float:
        n = fit_noise(thinned(samples, kept), "gx").coefficients["N"]
        return n.upper - n.lower

    wider = width(_kept(rng, 0.2)) / width(None)
    assert wider == pytest.approx((1 / 0.8 + 0.2) ** 0.5, rel=0.05)


def test_a_line_and_a_low_pass_keep_their_density():
    rng = np.random.default_rng(4)
    t = np.arange(ROWS) / RATE
    smooth = lfilter(*butter(2, 30, fs=RATE), _white(rng)) + 0.1 * np.sin(2 * np.pi * 8.5 * t)
    bridged = bridge_gaps(thinned(smooth[:, np.newaxis], _kept(rng)))
    f, before = welch(smooth, RATE, nperseg=512)
    _, after = welch(bridged.values[:, 0], RATE, nperseg=512)
    line = np.abs(f - 8.5) < 0.5
    assert after[line].sum() == pytest.approx(before[line].sum(), rel=0.02)
    for low, high in ((1, 7), (10, 20), (20, 30), (30, 38), (38, 44)):
        band = (f > low) & (f < high)
        assert after[band].mean() == pytest.approx(before[band].mean(), rel=0.05), (low, high)


def test_what_is_chance_in_the_measured_rows_is_not_repeated_in_the_filling():
    bands, ratio = 64, []
    for seed in range(20):
        rng = np.random.default_rng([seed, 15])
        bridged = bridge_gaps(thinned(_white(rng)[:, np.newaxis], _kept(rng, 0.2)))
        power = np.abs(np.fft.rfft(bridged.values[:, 0])[1:]) ** 2
        means = [band.mean() for band in np.array_split(power, bands)]
        ratio.append(np.var(means) / np.mean(means) ** 2 / (bands / len(power)))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.12)  # 2.1 at the highest order


def test_axes_stay_as_coupled_as_they_were():
    rng = np.random.default_rng(5)
    common = rng.standard_normal(ROWS)
    table = np.column_stack([common, 0.6 * common + 0.8 * rng.standard_normal(ROWS)])
    bridged = bridge_gaps(thinned(table, _kept(rng, 0.22)))
    assert bridged.values.shape == table.shape
    assert np.corrcoef(bridged.values.T)[0, 1] == pytest.approx(0.6, abs=0.015)


def test_a_burst_does_not_make_the_rest_louder():
    rng = np.random.default_rng(6)
    samples = _white(rng)
    burst = slice(10_000, 10_200)
    samples[burst] *= 50
    record = bridge_gaps(thinned(samples[:, np.newaxis], _kept(rng)))
    assert record.filled is not None
    quiet = record.filled.copy()
    quiet[9_500:10_700] = False
    drawn = record.values[quiet, 0]
    assert drawn.std() == pytest.approx(N * RATE**0.5, rel=0.05)


def test_measured_rows_stay_and_filled_ones_are_known():
    rng = np.random.default_rng(7)
    samples = _white(rng)[:, np.newaxis]
    kept = _kept(rng)
    record = bridge_gaps(thinned(samples, kept))
    assert record.segments.tolist() == [[0, ROWS]]
    assert np.array_equal(record.filled, ~kept)
    assert np.array_equal(record.values[kept], samples[kept])
    assert record.start_s == pytest.approx(np.arange(ROWS) / RATE)
    again = bridge_gaps(record)
    assert again is record


def test_long_gaps_and_gaps_of_unknown_length_stay():
    rng = np.random.default_rng(8)
    kept = _kept(rng)
    kept[8_000:8_101] = False  # 1.01 s
    kept[16_000:16_099] = False
    kept[[7_999, 8_101, 15_999, 16_099]] = True
    record = bridge_gaps(thinned(_white(rng)[:, np.newaxis], kept))
    assert record.segments.tolist() == [[0, 8_000], [8_000, ROWS - 101]]
    assert record.start_s[8_000] - record.start_s[7_999] == pytest.approx(1.02)
    whole = replace(thinned(_white(rng)[:, np.newaxis]), segments=np.array([[0, 9], [9, ROWS]]))
    assert bridge_gaps(whole) is whole


def test_a_record_that_would_be_filling_for_more_than_a_quarter_is_left():
    rng = np.random.default_rng(9)
    record = thinned(_white(rng)[:, np.newaxis], _kept(rng, 0.27))
    assert bridge_gaps(record) is record


def test_an_axis_that_never_moves_stays_constant():
    rng = np.random.default_rng(10)
    table = np.column_stack([_white(rng), np.full(ROWS, 0.1)])
    bridged = bridge_gaps(thinned(table, _kept(rng)))
    assert np.all(bridged.values[:, 1] == 0.1)
