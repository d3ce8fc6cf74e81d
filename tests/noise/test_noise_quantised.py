"""Steps that hide the sensor: found on the lattice, and said."""

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.noise import find_step, fit_array, resolution_advice
from allanscope.noise.components import Rounding
from allanscope.noise.quantised import on_lattice, rounding_correlation


def rounded(sigma, mean, n=20_000, seed=1):
    """Return samples in steps of 1, and the generator's sigma and mean in steps."""
    return np.round(mean + sigma * np.random.default_rng(seed).standard_normal(n))


@pytest.mark.parametrize(
    ("unit", "step", "words"),
    [
        (
            "dps",
            0.07,
            "half a step of 70 mdps: choose a smaller full scale, such as 125 or 250 dps",
        ),
        ("dps", 8.75e-3, "such as 125 dps, to see"),
        ("dps", 4.375e-3, "the smallest full scale"),
        ("g", 0.488e-3, "such as 2 or 4 g, to see"),
        (
            "g",
            1e-3,
            "a step of 1 mg, which is no step of the sensor: use a firmware that sends raw",
        ),
        ("g", 0.0, "half a step: choose a smaller full scale, such as 2 or 4 g"),
    ],
)
def test_advice_helps_against_the_step_there_is(unit, step, words):
    assert words in resolution_advice(unit, step)
    assert resolution_advice(unit, step).endswith("the sensor's own noise")


def test_a_constant_axis_is_not_called_quiet():
    assert resolution_advice("dps", 0.07, constant=True).startswith(
        "no noise to measure; choose a smaller"
    )
    assert "raw counts" in resolution_advice("g", 1e-3, constant=True)


@pytest.mark.parametrize("mean", [0.0, 0.25, 0.5])
@pytest.mark.parametrize(("sigma", "limited"), [(0.2, True), (0.35, True), (0.6, False)])
def test_noise_below_half_a_step_is_called_limited(sigma, mean, limited):
    fit = fit_array(0.07 * rounded(sigma, mean), 104.0, lsb=0.07)
    assert fit.step_limited == limited
    assert any("smaller full scale" in remark for remark in fit.remarks) == limited


def test_values_truncated_to_a_milli_g_are_called_limited_by_it():
    """Towards zero, as stock firmware does: the code 0 is twice as wide."""
    noise = 0.65e-3 * np.random.default_rng(5).standard_normal(100_000)
    fit = fit_array(1e-3 * np.trunc(noise / 1e-3), 104.0, lsb=1e-3, unit="g")
    true = 0.65e-3 / np.sqrt(104.0)
    # Not a sensor three times as quiet as it is, but a step that is too coarse.
    assert fit.coefficients["N"].value < 0.5 * true
    assert fit.step_limited
    assert any("raw counts" in remark for remark in fit.remarks)


@pytest.mark.parametrize("step", [1e-3, 4.375e-3, 0.061e-3, 0.07, 1.0])
def test_steps_are_found(step):
    values = step * rounded(2.0, 100.0)
    assert find_step(values) == pytest.approx(step, rel=1e-6)
    assert on_lattice(values, step)
    assert not on_lattice(values + 0.3 * step, step)


def test_a_step_is_found_from_multiples_of_it():
    assert find_step(0.01 * np.array([0, 2, 5, 9])) == pytest.approx(0.01)


def test_numbers_without_a_lattice_have_no_step():
    values = np.random.default_rng(3).standard_normal(5000)
    assert find_step(values) == 0.0
    assert not on_lattice(values, 1e-2)
    assert not on_lattice(values, 0.0)


def test_rounded_decimals_in_a_text_still_lie_on_the_lattice():
    values = np.round(8.75e-3 * rounded(3.0, 0.2), 4)
    assert on_lattice(values, 8.75e-3)


@pytest.mark.parametrize(("step", "digits"), [(8.75e-3, 3), (4.375e-3, 4), (1.527e-4, 5)])
def test_the_step_of_numbers_printed_with_few_digits_is_found_to_a_thousandth(step, digits):
    values = np.round(step * rounded(3.0, 0.2), digits)
    assert find_step(values) == pytest.approx(step, rel=2e-3)


def slow(sigma, corner, n=200_000, rate=100.0, seed=2):
    """Return one-pole noise in steps of 1 before rounding, and its density at 0 Hz as N."""
    pole = np.exp(-2 * np.pi * corner / rate)
    values = lfilter([1 - pole], [1, -pole], np.random.default_rng(seed).standard_normal(n))
    size = sigma / np.sqrt((1 - pole) / (1 + pole))
    return size * values + 0.3, size / np.sqrt(rate)


@pytest.mark.parametrize(("sigma", "corner"), [(0.5, 1.6), (0.6, 0.5), (1.0, 0.5), (0.6, 3.0)])
def test_the_errors_of_slow_noise_follow_each_other_as_the_equation_says(sigma, corner):
    values, _ = slow(sigma, corner)
    error = np.round(values) - values
    seen = [np.mean(error[k:] * error[:-k]) * 12 for k in (1, 2, 3)]
    found = rounding_correlation(np.round(values), 1.0)
    assert [*found, 0.0, 0.0][:3] == pytest.approx(seen, abs=0.02)
    # 2 % of chi-squares in bands of some thousand ordinates.
    power = 2 * np.abs(np.fft.rfft(error))[1:-1] ** 2 / len(error) / 100.0
    expected = Rounding(1.0, found).density(np.arange(1, len(power) + 1) * 100 / len(error), 0.01)
    bands = [part.mean() for part in np.array_split(power / expected, 20)]
    assert bands == pytest.approx(np.ones(20), abs=0.06)


def test_errors_are_white_where_samples_change_by_half_a_step():
    assert rounding_correlation(rounded(0.5, 0.2), 1.0) == ()
    assert rounding_correlation(np.round(slow(4.0, 3.0)[0]), 1.0) == ()
    assert rounding_correlation(np.zeros(10), 1.0) == rounding_correlation([1.0], 0.0) == ()


def test_rounding_of_slow_noise_is_not_taken_for_noise_of_the_sensor():
    """It was white in the model: the least of the density went below it, and N with it."""
    values, _ = slow(0.6, 3.0, n=60_000)
    fit = fit_array(np.round(values), 100.0, lsb=1.0)
    (part,) = (c for c in fit.model if isinstance(c, Rounding))
    assert part.correlation
    assert not fit.step_limited
    assert fit_array(rounded(0.3, 0.2), 100.0, lsb=1.0).step_limited
