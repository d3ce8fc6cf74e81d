"""Transfer functions against the estimators themselves, densities against closed forms."""

import numpy as np
import pytest

from allanscope.allan import (
    density_of_deviation,
    deviation,
    deviation_of_density,
    phase_to_rate_density,
    rate_to_phase_density,
    transfer,
)
from allanscope.allan.estimators import REGISTRY
from allanscope.noise.components import (
    AngleQuantization,
    Flicker,
    FlickerPhase,
    FlickerWalk,
    RandomRun,
    RandomWalk,
    White,
)

KINDS = ["ostdev", "oadev", "mdev", "tdev", "ohdev", "pdev", "theo1"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("turn", [0.003, 0.02, 0.11, 0.37])
def test_a_sinusoid_passes_as_the_transfer_function_says(kind, turn):
    """Of a line of amplitude 1 the variance is |H|^2 / 2, averaged over its phase."""
    m, n = 12, 40_000
    time = np.arange(n)
    if kind == "ostdev":
        turn = round(turn * n) / n
    variances = []
    for phase in (0.0, np.pi / 2):
        x = np.append(0.0, np.cumsum(np.sin(2 * np.pi * turn * time + phase)))
        variances.append(REGISTRY[kind].exact(x, m)[0])
    expected = transfer(kind, turn, m, 1.0) / 2
    assert np.mean(variances) == pytest.approx(float(expected), rel=2e-3)


def test_names_of_the_classics():
    f, m, rate = np.array([0.5, 2.0, 3.3]), 10, 100.0
    x = np.pi * f * m / rate
    np.testing.assert_allclose(transfer("stdev", f, m, rate), np.sinc(f * 0.1) ** 2, rtol=5e-3)
    np.testing.assert_allclose(transfer("adev", f, m, rate), 2 * np.sin(x) ** 4 / x**2, rtol=5e-3)
    assert transfer("totdev", f, m, rate) == pytest.approx(transfer("oadev", f, m, rate))
    assert transfer("adev", 0.0, m, rate) == pytest.approx(0.0, abs=1e-12)
    assert transfer("stdev", 0.0, m, rate) == pytest.approx(1.0)
    with pytest.raises(ValueError, match="theoh is a hybrid"):
        transfer("theoh", f, m, rate)


@pytest.mark.parametrize("part", [White(0.3), Flicker(0.2), RandomWalk(0.01)])
@pytest.mark.parametrize("kind", ["oadev", "ohdev", "mdev"])
def test_densities_become_the_deviations_of_closed_forms(part, kind):
    rate, m = 100.0, np.array([1, 7, 100, 3000])
    f = np.geomspace(1e-5, 50.0, 4000)
    found = deviation_of_density(f, part.density(f, 1 / rate), m, rate, kind)
    exact = {"oadev": part.avar, "ohdev": part.hvar, "mdev": part.mvar}[kind](m, 1 / rate)
    np.testing.assert_allclose(found, np.sqrt(exact), rtol=4e-3)


@pytest.mark.parametrize(
    ("kind", "parts"),
    [
        ("adev", (White(0.3), Flicker(0.2), RandomWalk(0.01))),
        ("totdev", (AngleQuantization(0.1), White(0.3), RandomWalk(0.01))),
        ("mdev", (FlickerPhase(0.1), White(0.3), Flicker(0.2))),
        ("hdev", (White(0.3), Flicker(0.2), RandomWalk(0.01))),
        ("hdev", (White(0.3), FlickerWalk(1e-3))),
        ("hdev", (White(0.3), RandomRun(1e-4))),
    ],
)
def test_a_deviation_becomes_the_density_it_came_from(kind, parts):
    """Deviations by closed forms; what is found from them, beside the densities of the parts."""
    f, rate, m = np.geomspace(1e-3, 1.0, 50), 10.0, 2.0 ** np.arange(12)
    family = {"mdev": "mvar", "hdev": "hvar"}.get(kind, "avar")
    curve = np.sqrt(sum(getattr(part, family)(m, 1 / rate) for part in parts))
    expected = sum(part.density(f, 1 / rate) for part in parts)
    found = density_of_deviation(m / rate, curve, f, kind, rate)
    np.testing.assert_allclose(found, expected, rtol=1e-2)


@pytest.mark.parametrize("kind", ["tdev", "pdev", "theo1"])
def test_other_deviations_go_there_and_back(kind):
    """2 + 0.04 / f, as a table of numbers: TDEV, PVAR (6/5 of AVAR in white noise) and THEO1."""
    f, rate, m = np.geomspace(1e-4, 5.0, 200), 10.0, 2 ** np.arange(1, 11)
    density = White(1.0).density(f, 1 / rate) + Flicker(0.35).density(f, 1 / rate)
    curve = deviation_of_density(f, density, m, rate, kind)
    tau = (0.75 if kind == "theo1" else 1.0) * m / rate
    back = density_of_deviation(tau, curve, f[50:], kind, rate)
    np.testing.assert_allclose(back, density[50:], rtol=5e-3)


def test_pvar_of_white_noise_is_six_fifths_of_avar():
    """Vernotte, Lenczner, Bourgeois and Rubiola 2016: 3/5 h0 / tau; with h0 = 2 N^2."""
    found = deviation_of_density([0.01, 50.0], [2.0, 2.0], [100, 4096], 100.0, "pdev")
    assert found**2 * [1.0, 40.96] == pytest.approx(1.2, rel=2e-3)


def test_measured_deviations_become_densities():
    white = np.random.default_rng(1).normal(size=50_000)
    for kind in ("oadev", "mdev", "ohdev", "pdev", "totdev"):
        measured = deviation(white, 1.0, kind, taus=[1.0, 4.0, 16.0, 64.0])
        back = density_of_deviation(measured.tau, measured.deviation, [0.01], kind)
        assert back == pytest.approx(2.0, rel=0.1), kind


def test_what_has_no_value_is_refused():
    f = [0.1, 1.0, 10.0]
    steep, run = [1e3, 1.0, 1e-3], [1e4, 1.0, 1e-4]
    for kind in ("oadev", "mdev"):
        with pytest.raises(ValueError, match=r"infinite for a density that goes on as f\^-3"):
            deviation_of_density(f, steep, [4], 20.0, kind)
    assert np.isfinite(deviation_of_density(f, run, [4], 20.0, "hdev")).all()
    for call in (
        lambda: deviation_of_density(f, [1.0, 1.0, 1.0], [4], 20.0, "stdev"),
        lambda: density_of_deviation([1.0, 2.0], [1.0, 0.7], f, "stdev"),
    ):
        with pytest.raises(ValueError, match="classical variance of flicker noise"):
            call()


def test_phase_noise_of_a_carrier():
    """-140 dBc/Hz at 10 Hz from 10 MHz: S_phi = 2e-14, S_y = 2e-26."""
    density = phase_to_rate_density([10.0], [2 * 10**-14.0], carrier=1e7)
    assert density == pytest.approx(2e-26)
    assert rate_to_phase_density([10.0], density, carrier=1e7) == pytest.approx(2e-14)
    assert phase_to_rate_density([2.0], [1.0]) == pytest.approx((4 * np.pi) ** 2)
    with pytest.raises(ValueError, match="the carrier must be a frequency"):
        phase_to_rate_density([1.0], [1.0], carrier=-1.0)
