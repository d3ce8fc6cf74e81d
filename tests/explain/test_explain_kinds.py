"""What a kind says beside its name: other axes, coefficients, what else it might be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import idct
from scipy.signal import butter, lfilter

from allanscope.explain import AxisExplanation, Effect, explain

RATE, SIGMA, LSB = 52.0, 4e-3 * 52.0**0.5, 4.375e-3


def only(result: AxisExplanation) -> Effect:
    assert len(result.effects) == 1, [e.kind for e in result.effects]
    return result.effects[0]


def holds(effect: Effect, name: str, truth: float, stretch: float = 1.6) -> None:
    """Truth within the 95 % interval stretched to what five sigma in one test would be."""
    p = effect.parameters[name]
    low = p.value - stretch * (p.value - p.lower) * 1.6
    high = p.value + stretch * (p.upper - p.value) * 1.6
    assert low <= truth <= high, (name, truth, p)
    assert p.lower <= p.value <= p.upper


@pytest.mark.parametrize("seed", [1])
def test_clean_noise_is_given_no_effect(bench, seed):
    b = bench(seed)
    result = explain(b.record(b.noise(), b.noise())).axes
    for axis in result.values():
        assert axis.effects == ()
        assert axis.explained
        assert axis.after.chi2_per_dof < 3
        assert axis.coefficients_after["N"].lower < 4e-3 * 1.01
        assert axis.coefficients_after["N"].upper > 4e-3 * 0.99


def test_a_hole_in_counts_makes_no_rows_that_repeat(bench):
    """What bridges it lies on no lattice; neighbours that are equal by chance still are by chance.

    One row in twenty-three equals the row before where the noise is 6.6 counts.
    """
    b = bench(31, 140.0)
    whole = b.record(*(b.noise() for _ in range(3)))
    left = np.r_[0:3000, 3030 : len(whole.values)]
    holed = replace(
        whole,
        values=whole.values[left],
        temperature_c=whole.temperature_c[left],
        start_s=whole.start_s[left],
        segments=np.array([[0, 3000], [3000, len(left)]]),
    )
    assert all(axis.effects == () for axis in explain(holed).axes.values())


@pytest.mark.parametrize(("frequency", "amplitude"), [(25.2, 3e-3), (0.011, 8e-3)])
def test_a_line_is_found_from_a_few_cycles_to_nyquist(bench, frequency, amplitude):
    b = bench(4)
    line = amplitude * np.sin(2 * np.pi * frequency * b.t + 1)
    effect = only(explain(b.record(b.noise() + line)).axes["gx"])
    assert effect.kind == "sinusoid"
    holds(effect, "frequency", frequency)
    holds(effect, "amplitude", amplitude)
    assert effect.evidence["held_out_nats"] > 10
    assert effect.evidence["replicated"] is True


def test_gauss_markov_is_told_from_a_telegraph_with_the_same_spectrum(bench):
    b = bench(6)
    smooth = b.noise() + b.gauss_markov(12e-3, 10.0)
    hopping = b.noise() + b.telegraph(12e-3, 20.0)
    result = explain(b.record(smooth, hopping)).axes
    effect = only(result["gx"])
    assert effect.kind == "gauss_markov"
    assert effect.equivalent == ()
    holds(effect, "sigma", 12e-3)
    holds(effect, "correlation_time", 10.0)
    effect = only(result["gy"])
    assert effect.kind == "random_telegraph"
    holds(effect, "amplitude", 12e-3)
    holds(effect, "dwell", 20.0)


def test_weak_gauss_markov_admits_that_it_may_be_a_telegraph(bench):
    b = bench(7)
    effect = only(explain(b.record(b.noise() + b.gauss_markov(4e-3, 3.0))).axes["gx"])
    assert effect.kind == "gauss_markov"
    assert effect.equivalent == ("random_telegraph",)


@pytest.mark.parametrize("seed", [1404, 1411])
def test_weak_noise_of_another_slope_may_be_gauss_markov_and_is_told(bench, seed):
    b = bench(seed, 300.0)
    f = np.arange(1, len(b.t)) * RATE / (2 * len(b.t))
    power = np.append(0.0, 1.2 * SIGMA * f**-0.75)
    white = b.rng.normal(0, SIGMA, len(b.t))
    slope = idct(power * b.rng.normal(size=len(b.t)), norm="ortho")
    effect = only(explain(b.record(white + slope)).axes["gx"])
    assert effect.kind == "gauss_markov"
    assert "power_law" in effect.equivalent


def test_a_step_is_found_to_the_second_and_not_called_random_walk(bench):
    b = bench(9)
    step = np.where(b.t >= 913.0, 15e-3, 0.0)
    result = explain(b.record(b.noise() + step)).axes["gx"]
    effect = only(result)
    assert effect.kind == "step"
    holds(effect, "time", 913.0)
    holds(effect, "size", 15e-3)
    assert effect.evidence["replicated"] == "not replicated"
    before, after = (c["K"].upper for c in (result.coefficients_before, result.coefficients_after))
    assert after < before / 2


def test_a_step_near_the_end_of_a_short_record_is_no_excursion(bench):
    b = bench(10, 40.0)
    effect = only(explain(b.record(b.noise() + np.where(b.t >= 4.4, SIGMA, 0))).axes["gx"])
    assert effect.kind == "step"
    holds(effect, "time", 4.4)


def test_a_step_on_two_axes_is_named_once_with_both(bench):
    b = bench(10)
    step = np.where(b.t >= 600.0, 15e-3, 0.0)
    result = explain(b.record(b.noise() + step, b.noise() - step, b.noise())).axes
    assert only(result["gx"]).axes == ("gx", "gy")
    assert only(result["gx"]).evidence["replicated"] is True
    assert result["gz"].effects == ()


def test_a_ramp_is_the_coefficient_r_and_no_effect(bench):
    b = bench(13)
    result = explain(b.record(b.noise() + 4e-5 * b.t)).axes["gx"]
    assert result.effects == ()
    assert result.coefficients_after["R"].detected
    assert result.coefficients_after["R"].lower < 4e-5 < result.coefficients_after["R"].upper


def test_a_common_vibration_is_no_coupling(bench):
    b = bench(16)
    hum = 0.02 * np.sin(2 * np.pi * 11.0 * b.t)
    result = explain(b.record(b.noise() + hum, b.noise() + hum)).axes
    for axis in result.values():
        assert only(axis).kind == "sinusoid"
        assert only(axis).axes == ("gx", "gy")


def test_repeated_rows_are_told_from_a_low_pass(bench):
    b = bench(18)
    columns = np.column_stack([b.noise(), b.noise(), b.noise()])
    source = np.arange(len(columns))
    source[b.rng.random(len(columns)) < 0.02] = 0
    held = columns[np.maximum.accumulate(source)]
    result = explain(b.record(*held.T)).axes
    effect = only(result["gy"])
    assert effect.kind == "repeated_samples"
    assert effect.axes == ("gx", "gy", "gz")
    holds(effect, "fraction", 0.02)


def test_a_strong_low_pass_on_one_axis_repeats_no_rows(bench):
    b = bench(23)
    slow = lfilter(*butter(2, 2 * 2.0 / RATE), b.noise())
    result = explain(b.record(slow, b.noise(), lsb=2 * LSB)).axes
    assert "band_limit" in [e.kind for e in result["gx"].effects]
    assert "repeated_samples" not in [e.kind for e in result["gx"].effects]
    assert result["gy"].effects == ()


def test_a_coarse_step_is_named_and_a_fine_one_is_not(bench):
    b = bench(20)
    assert explain(b.record(b.noise(), lsb=SIGMA)).axes["gx"].effects == ()
    effect = only(explain(b.record(b.noise(), lsb=3 * SIGMA)).axes["gx"])
    assert effect.kind == "quantization"
    assert effect.evidence["gain_nats"] is None, "it is read off the values"
    assert effect.parameters["step"].value == pytest.approx(3 * SIGMA)


def test_a_step_of_no_whole_number_of_counts_is_read_off_the_values(bench):
    b = bench(22)
    step = 13.4 * LSB
    effect = only(explain(b.record(step * np.round(b.noise() / step))).axes["gx"])
    assert effect.kind == "quantization"
    holds(effect, "step", step)
