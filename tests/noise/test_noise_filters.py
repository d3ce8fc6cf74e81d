"""Filters: their responses, what they act on, and the curves behind them, against samples."""

import numpy as np
import pytest
from scipy.fft import dct
from scipy.signal import butter, freqz, lfilter, welch

from allanscope.noise import NoiseModel
from allanscope.noise.components import Flicker, GaussMarkov, RandomWalk, Rounding, White
from allanscope.noise.filters import (
    AnalogueLowPass,
    Averaging,
    Butterworth,
    HeldPattern,
    HeldSamples,
    HighPass,
    MovingAverage,
    OnePole,
)

DT = 0.01
POLE = np.exp(-2 * np.pi * 20.0 * DT)
TAPS = {OnePole(20.0): ([1 - POLE], [1.0, -POLE]), Butterworth(20.0, 2.0): butter(2, 0.4)}
LOW_PASSES = [
    *(OnePole(20.0), Butterworth(20.0, 3.0), AnalogueLowPass(20.0, 1.5)),
    Averaging(20.0, 2.0),
]


@pytest.mark.parametrize("low_pass", TAPS, ids=str)
def test_response_is_that_of_the_recursion(low_pass):
    f = np.linspace(0.0, 49.0, 50)
    exact = np.abs(freqz(*TAPS[low_pass], worN=f, fs=1 / DT)[1]) ** 2
    np.testing.assert_allclose(low_pass.response(f, DT), exact, atol=1e-9)


@pytest.mark.parametrize("low_pass", LOW_PASSES, ids=str)
def test_a_low_pass_is_one_at_zero_and_falls(low_pass):
    response = low_pass.response(np.linspace(0.0, 49.0, 200), DT)
    assert response[0] == pytest.approx(1.0)
    assert np.all(np.diff(response) < 0)
    assert low_pass.symbol == "band_limit"


@pytest.mark.parametrize("low_pass", LOW_PASSES[1:], ids=str)
def test_half_the_power_passes_at_the_cutoff(low_pass):
    # A hundredth of what an average passes comes from beyond Nyquist.
    assert low_pass.response(np.array([20.0]), DT) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize(("taps", "every", "times"), [(10, 5, 2), (12, 12, 1), (16, 5, 3)])
def test_an_average_is_that_of_a_decimating_converter(rng, taps, every, times):
    """White noise, averaged over `taps` fine samples so many times, of which each n-th is kept."""
    window = np.ones(taps) / taps
    samples = rng.standard_normal(2_000_000)
    for _ in range(times):
        samples = np.convolve(samples, window, "valid")
    kept = samples[::every]
    f, measured = welch(kept, 1 / DT, nperseg=64, detrend=False)
    span = taps * DT / every
    half = {1: 0.442946, 2: 0.318920, 3: 0.261938}[times]
    expected = Averaging(half / span, float(times)).response(f[1:-1], DT)
    np.testing.assert_allclose(measured[1:-1] * every / DT / 2, expected, rtol=0.05, atol=2e-3)


@pytest.mark.parametrize("rows", [2, 5, 32])
def test_a_moving_average_is_that_of_its_taps(rows):
    average = MovingAverage.over(rows, DT)
    f = np.linspace(0.0, 50.0, 501)
    exact = np.abs(freqz(np.ones(rows) / rows, worN=f, fs=1 / DT)[1]) ** 2
    np.testing.assert_allclose(average.response(f, DT), exact, atol=1.01e-5)
    assert average.response(np.array([average.cutoff]), DT) == pytest.approx(0.5)


def test_variances_behind_a_moving_average_are_those_of_samples(rng, overlapping_variance):
    samples = np.convolve(rng.standard_normal(400_000), np.ones(7) / 7, "valid")
    model = NoiseModel((White(np.sqrt(DT)),), DT, (MovingAverage.over(7, DT),))
    for m in (1, 4, 7, 30):
        measured = overlapping_variance(samples, m)
        assert model.variance("avar", [m])[0] == pytest.approx(measured, rel=0.03)


@pytest.mark.parametrize("order", [1, 2])
def test_a_high_pass_and_what_leaks_into_a_record_are_those_of_ordinates(order, rng):
    """Mean squares of the cosine ordinates of 400 records of 40 s, from the lowest up."""
    n, corner = 4000, 0.8
    taps = butter(order, 2 * corner * DT, "high")
    records = lfilter(*taps, rng.standard_normal((400, n + 2000)), axis=1)[:, 2000:]
    squares = np.mean(dct(records, norm="ortho", axis=1)[:, 1:] ** 2, axis=0)
    f = np.arange(1, n) / (2 * n * DT)
    expected = HighPass(corner, float(order), n * DT).response(f, DT)
    for low, high in ((0, 4), (4, 10), (10, 25), (25, 60), (60, 120), (120, 400)):
        ratio = np.mean(squares[low:high] / expected[low:high])
        assert ratio == pytest.approx(1.0, abs=0.15), (low, high)


def test_a_low_pass_acts_on_the_sensor_and_holding_on_its_white_noise():
    sensor, later = (White(1.0), Flicker(1.0), RandomWalk(1.0)), (Rounding(1.0), GaussMarkov(1, 1))
    assert all(OnePole(1.0).acts_on(one) for one in sensor)
    assert not any(OnePole(1.0).acts_on(one) for one in later)
    assert [HeldSamples(0.1).acts_on(one) for one in (*sensor, *later)] == [True, *[False] * 4]
    assert HeldPattern((0.5,)).acts_on(White(1.0))


@pytest.mark.parametrize("low_pass", TAPS, ids=str)
def test_variances_behind_a_low_pass_are_those_of_samples(low_pass, rng, overlapping_variance):
    drive = rng.standard_normal(41_000) * 0.3 / np.sqrt(DT)
    samples = lfilter(*TAPS[low_pass], drive)[1000:]
    model = NoiseModel((White(0.3),), DT, (low_pass,))
    for m in (1, 3, 10, 40):
        # 1000 independent windows at m = 40: 5 %, tested at three times that.
        assert overlapping_variance(samples, m, 2) == pytest.approx(
            float(model.variance("avar", m)), rel=0.15
        )


def test_long_averages_show_the_white_noise_before_the_low_pass():
    model = NoiseModel((White(0.3),), DT, (OnePole(20.0),))
    assert float(model.variance("avar", 10_000)) == pytest.approx(0.09 / 100, rel=1e-3)


@pytest.mark.parametrize("fraction", [0.1, 0.5])
def test_holding_white_noise_gives_its_response(rng, fraction):
    n, parts = 4096, 200
    total = np.zeros(n // 2 + 1)
    for _ in range(parts):
        fresh, held = rng.standard_normal(n), rng.random(n) < fraction
        source = np.maximum.accumulate(np.where(held, 0, np.arange(n)))
        total += np.abs(np.fft.rfft(fresh[source])) ** 2 / n / parts
    f = np.fft.rfftfreq(n, DT)
    ratio = (total / HeldSamples(fraction).response(f, DT))[1:2041].reshape(24, 85)
    # 85 frequencies x 200 parts: 0.8 %, tested at five times that.
    np.testing.assert_allclose(ratio.mean(axis=1), 1.0, atol=0.04)


def test_rows_held_in_pairs_have_the_response_of_a_pattern(rng):
    fresh = rng.standard_normal((400, 2048))
    power = (np.abs(np.fft.rfft(np.repeat(fresh, 2, axis=1), axis=1)) ** 2).mean(axis=0) / 4096
    f = np.fft.rfftfreq(4096, DT)
    ratio = (power / HeldPattern((0.5,)).response(f, DT))[1:1985].reshape(-1, 64)
    np.testing.assert_allclose(ratio.mean(axis=1), 1.0, atol=0.04)
