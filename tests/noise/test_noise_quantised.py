"""Steps that hide the sensor: found on the lattice, and said."""

import numpy as np
import pytest

from allanscope.noise.quantised import find_step, lattice_of, on_lattice


def rounded(sigma, mean, n=20_000, seed=1):
    """Return samples in steps of 1, and the generator's sigma and mean in steps."""
    return np.round(mean + sigma * np.random.default_rng(seed).standard_normal(n))


@pytest.mark.parametrize("mean", [0.0, 0.25, 0.5])
@pytest.mark.parametrize(
    ("sigma", "limited"), [(0.05, True), (0.2, True), (0.35, True), (0.6, False), (3.0, False)]
)
def test_noise_below_half_a_step_is_called_limited(sigma, mean, limited):
    lattice = lattice_of(0.07 * rounded(sigma, mean))
    assert lattice.limited == limited
    assert bool(lattice.advice) == limited


def test_noise_before_rounding_is_recovered():
    lattice = lattice_of(0.07 * rounded(0.8, 0.3))
    assert lattice.step == pytest.approx(0.07)
    assert lattice.sigma == pytest.approx(0.8 * 0.07, rel=0.02)
    assert lattice.ratio == pytest.approx(0.8, rel=0.02)


def test_a_slow_drift_is_not_noise():
    drift = np.linspace(0, 50, 20_000)
    lattice = lattice_of(np.round(drift + rounded(0.1, 0.0)))
    assert lattice.limited


def test_a_constant_axis_is_dead_and_not_quiet():
    lattice = lattice_of(np.full(1000, 3.0), step=1e-3, unit="g", truncated=True)
    assert lattice.limited
    assert lattice.codes == 1
    assert lattice.sigma == 0.0
    assert "constant" in lattice.advice
    assert "raw counts" in lattice.advice


def test_advice_names_a_full_scale_of_that_sensor():
    assert "125 or 250 dps" in lattice_of(0.07 * rounded(0.2, 0.5)).advice
    assert "2 g" in lattice_of(0.07 * rounded(0.2, 0.5), unit="g").advice


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


def test_bad_values_are_refused():
    with pytest.raises(ValueError, match="3 finite"):
        lattice_of([1.0, 2.0])
    with pytest.raises(ValueError, match="3 finite"):
        lattice_of([1.0, 2.0, np.nan])
