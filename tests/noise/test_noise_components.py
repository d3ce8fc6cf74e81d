"""Every component against integrals of its own density, and against simulated samples."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.fft import dct
from scipy.integrate import quad
from scipy.signal import lfilter

from allanscope.noise import components
from allanscope.noise.components import (
    AngleQuantization,
    BandPassed,
    Component,
    Flicker,
    FlickerPhase,
    FlickerWalk,
    Floor,
    GaussMarkov,
    IrregularCycles,
    LineProfile,
    MovingLine,
    Narrowband,
    PeakFiltered,
    PowerLaw,
    Ramp,
    RandomRun,
    RandomTelegraph,
    RandomWalk,
    Rounding,
    Sinusoid,
    WanderingLine,
    White,
)

DT = 0.01
EXAMPLES = [
    White(0.3),
    Flicker(0.7),
    RandomWalk(0.2),
    AngleQuantization(0.01),
    FlickerPhase(0.02),
    Rounding(0.5),
    Rounding(0.5, (0.4, 0.24, 0.1)),
    Floor(0.3),
    GaussMarkov(0.5, 0.3),
    GaussMarkov(0.5, 300.0),
    Narrowband(0.4, 2.0, 0.2),
    Narrowband(0.4, 0.02, 0.03),
    IrregularCycles(0.4, 0.02, 0.012),
    RandomTelegraph(0.5, 0.6),
    WanderingLine(0.4, 2.0, 0.2),
    MovingLine(0.4, 2.0, 0.2, (-0.3, 0.1, 0.5)),
    BandPassed(0.4, 20.0, 8.0),
    PeakFiltered(0.4, 20.0, 3.0),
    LineProfile(0.4, 2.0, 2.2, (0.3, 0.6, 0.1)),
    PowerLaw(0.3, 0.5),
    PowerLaw(0.3, 1.0),
    PowerLaw(0.3, 1.5),
]
WEIGHT = {
    "avar": lambda w, m: 2 * np.sin(m * w / 2) ** 4 / (m * np.sin(w / 2)) ** 2,
    "hvar": lambda w, m: 8 / 3 * np.sin(m * w / 2) ** 6 / (m * np.sin(w / 2)) ** 2,
    "mvar": lambda w, m: 2 * np.sin(m * w / 2) ** 6 / (m * np.sin(w / 2)) ** 4,
}


def names(component):
    return str(component)


def test_every_component_has_an_example():
    classes = {vars(components)[name] for name in components.__all__}
    others = {Component, Ramp, Sinusoid, FlickerWalk, RandomRun}
    assert {type(example) for example in EXAMPLES} | others == classes


def test_noise_steeper_than_a_random_walk_has_a_hadamard_variance_alone():
    """Third differences of the phase over m = 1 are first differences: of flicker, of a walk.

    Far above, HVAR of a random run tends to 11/120 D^2 tau^3.
    """
    walk, run = FlickerWalk(0.2), RandomRun(0.1)
    # HVAR(1) is a sixth of the mean square of second differences of the rate.
    of_flicker = 2 / 6 * Flicker(0.2).avar([1], DT)[0]
    assert walk.hvar([1], DT)[0] == pytest.approx(of_flicker * DT**2, rel=1e-4)
    of_walk = 1 / 6 * (0.1**2 * DT)
    assert run.hvar([1], DT)[0] == pytest.approx(of_walk * DT**2, rel=1e-4)
    tau = 1000 * DT
    assert run.hvar([1000], DT)[0] == pytest.approx(11 / 120 * 0.1**2 * tau**3, rel=1e-4)
    assert walk.hvar([2000], DT)[0] / walk.hvar([1000], DT)[0] == pytest.approx(4.0, rel=1e-3)
    for one in (walk, run):
        assert np.isinf(one.avar([1, 8], DT)).all()
        assert np.isinf(one.mvar([1, 8], DT)).all()
        assert one.density(1e-3, DT) == pytest.approx(
            2 * one.power * (2e-3 * np.pi) ** {"F": -3, "D": -4}[one.symbol], rel=1e-6
        )


@pytest.mark.parametrize("kind", ["avar", "hvar", "mvar"])
@pytest.mark.parametrize("component", EXAMPLES, ids=names)
def test_variances_are_integrals_of_the_density(component, kind):
    for m in (1, 2, 5, 13):
        low = np.geomspace(1e-7, 0.01, 12)
        corners = 2 * np.pi * DT * np.array(component.corners(DT))
        edges = np.unique(np.concatenate([low, np.linspace(0.01, np.pi, 4 * m + 9), corners]))

        def integrand(w, m=m):
            density = component.density(np.array([w / (2 * np.pi * DT)]), DT)[0]
            return density / (2 * DT) * WEIGHT[kind](w, m) / np.pi

        total = sum(quad(integrand, a, b, limit=200)[0] for a, b in pairwise(edges))
        assert float(getattr(component, kind)(m, DT)) == pytest.approx(total, rel=1e-4)


@pytest.mark.parametrize("component", EXAMPLES, ids=names)
def test_closed_forms_agree_with_the_general_integral_at_long_tau(component):
    m = np.array([100, 3000, 100_000])
    for kind in ("avar", "hvar"):
        general = Component._variance(component, kind, m, DT)
        np.testing.assert_allclose(getattr(component, kind)(m, DT), general, rtol=1e-4)


@pytest.mark.parametrize("component", EXAMPLES, ids=names)
def test_amplitude_scales_power_and_values_round_trip(component):
    if not component.quantities:
        return
    doubled = component.with_values((2 * component.values[0], *component.values[1:]))
    f, k = np.array([0.3, 5.0, 40.0]), np.array([1, 7, 300])
    np.testing.assert_allclose(doubled.density(f, DT), 4 * component.density(f, DT))
    if component.has_amplitude:
        assert component.power == pytest.approx(component.values[component.amplitude_index] ** 2)
        unit = component.with_power(1.0)
        np.testing.assert_allclose(component.power * unit.density(f, DT), component.density(f, DT))
    np.testing.assert_allclose(
        doubled.ordinates(k, 1000, DT, 3), 4 * component.ordinates(k, 1000, DT, 3), rtol=1e-12
    )
    assert doubled.with_values(component.values) == component


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_impossible_numbers_are_refused(bad):
    with pytest.raises(ValueError, match="N must be a finite number"):
        White(bad)
    with pytest.raises(ValueError, match="correlation_time"):
        GaussMarkov(1.0, 0.0)


@pytest.mark.parametrize(
    ("component", "kind", "m", "expected"),
    [
        (White(0.3), "avar", 100, 0.09),
        (White(0.3), "mvar", 1000, 0.0045 * (1 + 1e-6)),
        (Flicker(1.0), "avar", 1, 2 / np.pi),
        (Flicker(1.0), "avar", 10**7, 2 * np.log(2) / np.pi),
        (Flicker(1.0), "hvar", 10**7, np.log(256 / 27) / (2 * np.pi)),
        (RandomWalk(0.2), "avar", 10**6, 0.04 * 10**4 / 3),
        (RandomWalk(0.2), "hvar", 10**6, 0.04 * 10**4 / 6),
        (AngleQuantization(0.01), "avar", 100, 3e-4),
        (AngleQuantization(0.01), "hvar", 100, 1e-3 / 3),
        (Ramp(0.2), "avar", 100, 0.02),
        (Ramp(0.2), "mvar", 100, 0.02),
        (Ramp(0.2), "hvar", 100, 0.0),
        (Rounding(0.6), "avar", 10, 0.003),
    ],
)
def test_textbook_values(component, kind, m, expected):
    assert float(getattr(component, kind)(m, DT)) == pytest.approx(expected, rel=2e-6)


def test_a_power_law_of_a_classical_slope_is_the_classical_noise():
    k, m = np.array([1, 2, 3, 9, 40, 500]), np.array([1, 3, 100, 10**6])
    flicker, same = Flicker(0.7), PowerLaw(0.7 / np.sqrt(2 * np.pi), 1.0)
    np.testing.assert_allclose(same.avar(m, DT), flicker.avar(m, DT), rtol=1e-3)
    for stride in (1, 7):
        expected = flicker.ordinates(k, 1000, DT, stride)
        np.testing.assert_allclose(same.ordinates(k, 1000, DT, stride), expected, rtol=1e-4)


def test_flicker_at_short_tau_stands_above_its_floor():
    ratio = Flicker(1.0).avar([1, 2, 4, 8], DT) / (2 * np.log(2) / np.pi)
    np.testing.assert_allclose(ratio, [1.443, 1.154, 1.050, 1.015], atol=1e-3)


def test_gauss_markov_hump():
    tau = np.geomspace(0.1, 1e3, 4000)
    deviation = np.sqrt(GaussMarkov(1.0, 10.0).avar(tau / 1e-4, 1e-4))
    assert deviation.max() == pytest.approx(0.617, abs=1e-3)
    assert tau[deviation.argmax()] == pytest.approx(18.9, rel=0.01)


def test_sinusoid_variance_is_the_average_over_the_phase(overlapping_variance):
    line = Sinusoid(1.7, 1.23)
    turns = 2 * np.pi * 1.23 * DT * np.arange(20_000)
    quadratures = 1.7 * np.sin(turns + 0.1), 1.7 * np.cos(turns + 0.1)
    for m in (1, 20, 41, 100):
        allan = np.mean([overlapping_variance(part, m, 2) for part in quadratures])
        hadamard = np.mean([overlapping_variance(part, m, 3) for part in quadratures])
        assert float(line.avar(m, DT)) == pytest.approx(allan, rel=1e-6)
        assert float(line.hvar(m, DT)) == pytest.approx(hadamard, rel=1e-6)


def test_sinusoid_band_density_holds_its_power_once_even_aliased():
    frequency = np.arange(0.5, 50.0, 1.0)
    for true, seen in ((12.3, 12.3), (130.0, 30.0)):
        band = Sinusoid(2.0, true).band_density(frequency, np.ones(50), DT)
        assert band.sum() == pytest.approx(2.0)
        assert frequency[band.argmax()] == pytest.approx(seen, abs=0.51)


def first_order(sigma, time, n, rng):
    """Return a first-order Gauss-Markov process from its recursion, stationary from the start."""
    phi = np.exp(-DT / time)
    drive = rng.standard_normal(n) * sigma * np.sqrt(1 - phi**2)
    drive[0] = rng.standard_normal() * sigma
    return lfilter([1.0], [1.0, -phi], drive)


def oscillator(sigma, frequency, bandwidth, n, rng):
    """Return the position of a damped oscillator kicked by white noise in 400 parts of a step."""
    w0, b = 2 * np.pi * frequency, np.pi * bandwidth
    wd, fine = np.sqrt(w0**2 - b**2), 400
    t = (np.arange(fine) + 0.5) * DT / fine
    response = np.array([np.sin(wd * t) / wd, np.cos(wd * t) - b / wd * np.sin(wd * t)])
    response = np.exp(-b * t) * response
    strength = sigma**2 * 4 * b * w0**2
    chol = np.linalg.cholesky(strength * response @ response.T * DT / fine)
    c, s = np.cos(wd * DT), np.sin(wd * DT)
    step = np.array([[c + b / wd * s, s / wd], [-(w0**2) / wd * s, c - b / wd * s]])
    step *= np.exp(-b * DT)
    kicks = (chol @ rng.standard_normal((2, n))).T
    state = np.array([sigma, sigma * w0]) * rng.standard_normal(2)
    out = np.empty(n)
    for i in range(n):
        state = step @ state + kicks[i]
        out[i] = state[0]
    return out


SIMULATED = {
    White(0.3): lambda make, n, rng: make(n, DT, rng, N=0.3),
    Flicker(0.7): lambda make, n, rng: make(n, DT, rng, B=0.7),
    RandomWalk(0.2): lambda make, n, rng: make(n, DT, rng, K=0.2),
    AngleQuantization(0.01): lambda _, n, rng: np.diff(0.01 * rng.standard_normal(n + 1)) / DT,
    Rounding(0.5): lambda _, n, rng: 0.5 * (rng.random(n) - 0.5),
    GaussMarkov(0.5, 0.3): lambda _, n, rng: first_order(0.5, 0.3, n, rng),
    Narrowband(0.4, 2.0, 0.8): lambda _, n, rng: oscillator(0.4, 2.0, 0.8, n, rng),
}


@pytest.mark.parametrize("component", SIMULATED, ids=names)
def test_variances_are_those_of_simulated_samples(component, rng, make_noise, overlapping_variance):
    samples = SIMULATED[component](make_noise, 40_000, rng)
    for m in (1, 3, 10, 40):
        # 1000 independent windows at m = 40: 5 %, tested at three times that.
        allan, hadamard = (overlapping_variance(samples, m, order) for order in (2, 3))
        assert allan == pytest.approx(float(component.avar(m, DT)), rel=0.15)
        assert hadamard == pytest.approx(float(component.hvar(m, DT)), rel=0.18)


@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize(
    "component", [s for s in SIMULATED if not isinstance(s, Narrowband)], ids=names
)
def test_ordinates_are_those_of_simulated_rows(component, stride, rng, make_noise):
    n, records = 48, 3000
    length = n * stride
    if isinstance(component, RandomWalk | Flicker | GaussMarkov):
        # What remembers must start afresh in every record.
        parts = [SIMULATED[component](make_noise, length, rng) for _ in range(records)]
        samples = np.concatenate(parts)
    else:
        samples = SIMULATED[component](make_noise, length * records, rng)
    rows = samples.reshape(records, n, stride).mean(axis=2)
    power = np.mean(dct(rows, type=2, norm="ortho", axis=1)[:, 1:] ** 2, axis=0)
    ratio = power / component.ordinates(np.arange(1, n), n, DT, stride)
    # Means of 3000 squares of normal numbers scatter by 2.6 %; the worst of 47 by 3.5 times that.
    assert np.abs(ratio - 1).max() < 0.1
    assert ratio.mean() == pytest.approx(1.0, abs=0.012)


def test_flicker_ordinates_are_quadratic_forms_of_its_variogram():
    n = 4096
    h = np.arange(1, n)
    # Half the mean square difference of samples h apart: 2 / pi (1 + 1/3 + ... + 1/(2h - 1)).
    variogram = 2 / np.pi * np.cumsum(1 / (2 * h - 1.0))
    for k in (1, 2, 5, 16, 17, 18, 40, 200):
        angle = np.pi * k / n
        common = ((n - h) * np.cos(angle * h) - np.sin(angle * h) / np.sin(angle)) / n
        exact = -2 * np.sum(common * variogram)
        assert float(Flicker(1.0).ordinates(k, n, DT)) == pytest.approx(exact, rel=2e-4)


def test_differences_leave_a_floor_at_the_lowest_ordinates():
    # Cov of q_i - q_(i-1): 2 on the diagonal, -1 beside it.
    n = 40
    matrix = (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)) / DT**2
    for k in (1, 2, 20, 39):
        cosine = np.sqrt(2 / n) * np.cos(np.pi * k * (np.arange(n) + 0.5) / n)
        expected = AngleQuantization(1.0).ordinates(k, n, DT)
        assert float(expected) == pytest.approx(cosine @ matrix @ cosine, rel=1e-10)


def test_ordinates_of_a_line_average_over_the_phase():
    n, stride = 64, 3
    t = DT * np.arange(n * stride)
    phases = np.linspace(0, 2 * np.pi, 16, endpoint=False)[:, np.newaxis]
    rows = (1.3 * np.sin(2 * np.pi * 2.7 * t + phases)).reshape(16, n, stride).mean(axis=2)
    power = np.mean(dct(rows, type=2, norm="ortho", axis=1)[:, 1:] ** 2, axis=0)
    expected = Sinusoid(1.3, 2.7).ordinates(np.arange(1, n), n, DT, stride)
    np.testing.assert_allclose(expected, power, rtol=1e-9, atol=1e-12)
