"""A resonance whose frequency drifts is noise in a band, with how far its centre moves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from allanscope.explain import explain
from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.drifting_line import drifting_line, lines_of, range_of
from allanscope.explain.series import series_of
from allanscope.explain.view import View

RATE = 52.0
N = 4e-3
"""Density of the white noise of a bench, dps/sqrt(Hz)."""


def turned(amplitude, frequency):
    """Return the real part of an amplitude that turns at a frequency that changes."""
    return np.real(amplitude * np.exp(2j * np.pi * np.cumsum(frequency) / RATE))


def noise_of_width(b, width):
    """Return complex noise of unit variance in each part, its full width at half maximum in Hz."""
    phi = np.exp(-np.pi * width / RATE)
    e = (1 - phi**2) ** 0.5 * (b.rng.normal(size=len(b.t)) + 1j * b.rng.normal(size=len(b.t)))
    return lfilter([1], [1, -phi], e)


@pytest.mark.parametrize("seed", range(4))
def test_a_resonance_that_drifts_is_a_band_whose_centre_moves(bench, seed):
    b = bench(700 + seed, 2400.0)
    centre = 12.0 + 1.5 * np.exp(-b.t / 500)
    band = 0.02 * turned(noise_of_width(b, 0.4), centre)
    found = explain(b.record(b.noise() + band)).axes["gx"]
    (effect,) = found.effects
    assert effect.kind == "narrowband"
    assert effect.evidence["moves"] == pytest.approx(np.quantile(centre, [0.05, 0.95]), abs=0.2)
    assert effect.parameters["sigma"].value == pytest.approx(0.02, rel=0.06)
    assert "swells" not in effect.evidence
    assert effect.parameters["bandwidth"].value == pytest.approx(0.4, rel=0.25)
    white = found.coefficients_after["N"]
    assert white.value == pytest.approx(N, rel=0.03)


def test_it_is_found_where_the_noise_beside_it_is_not_known_yet(bench):
    b = bench(709, 2400.0)
    centre = 8.0 + np.exp(-b.t / 500)
    band = 0.05 * turned(noise_of_width(b, 0.5), centre)
    low_pass = lfilter(*butter(1, 15.0, fs=RATE), b.noise())
    found = explain(b.record(low_pass + band)).axes["gx"]
    assert {e.kind for e in found.effects} >= {"narrowband", "band_limit"}
    assert found.coefficients_after["N"].value == pytest.approx(N, rel=0.1)
    assert found.shares.named > 0.9


@pytest.mark.parametrize("seed", [736, 738])
def test_a_low_pass_is_found_though_the_band_within_it_moves(bench, seed):
    b = bench(seed, 3600.0)
    turn = 2 * np.pi * b.t / b.t[-1]
    centre = 5.2 + 0.5 * np.cos(1.3 * turn) + 0.2 * np.cos(5 * turn)
    band = 0.005 * turned(noise_of_width(b, 0.4), centre)
    found = explain(b.record(lfilter(*butter(1, 10.0, fs=RATE), b.noise()) + band)).axes["gx"]
    parameters = {e.kind: e.parameters for e in found.effects}
    assert set(parameters) == {"band_limit", "narrowband"}  # no process for what is far beside it
    cutoff = parameters["band_limit"]["cutoff"]
    assert cutoff.value == pytest.approx(10.0, rel=0.02)
    assert found.coefficients_after["N"].value == pytest.approx(N, rel=0.02)
    assert found.shares.named > 0.99


def test_a_line_that_wanders_fast_is_one_too(bench):
    b = bench(710, 2400.0)
    step = 0.5 * (1 - np.exp(-2 / (2.0 * RATE))) ** 0.5
    swing = lfilter([step], [1, -np.exp(-1 / (2.0 * RATE))], b.rng.normal(size=len(b.t)))
    line = 0.03 * turned(1.0, 12.0 + np.exp(-b.t / 500) + swing)
    found = explain(b.record(b.noise() + line)).axes["gx"]
    assert {e.kind for e in found.effects} == {"narrowband"}


def test_what_goes_through_its_band_once_has_no_name(bench):
    b = bench(711, 2400.0)
    line = 0.03 * turned(1.0, 11.0 + 3.0 * b.t / b.t[-1])
    found = explain(b.record(b.noise() + line)).axes["gx"]
    assert {e.kind for e in found.effects} == {"unexplained"}


def test_a_band_that_is_there_for_a_while_has_no_name(bench):
    b = bench(712, 2400.0)
    centre = 12.0 + 1.5 * np.exp(-b.t / 500)
    band = 0.03 * turned(noise_of_width(b, 0.4), centre) * (b.t < 800)
    found = explain(b.record(b.noise() + band)).axes["gx"]
    assert "narrowband" not in {e.kind for e in found.effects}


@pytest.mark.parametrize("seed", range(3))
def test_a_resonance_that_is_shaken_now_and_then_has_a_name_beside_a_line(bench, seed):
    b = bench(720 + seed, 600.0)
    times = b.rng.uniform(0, 600, 40)
    shaken = sum(np.exp(-(((b.t - at) / 3) ** 2)) for at in times)
    band = 0.06 * shaken * turned(noise_of_width(b, 0.4), np.full(len(b.t), 7.0))
    line = 0.05 * np.sin(2 * np.pi * 9.5 * b.t)
    found = explain(b.record(b.noise() + band + line)).axes["gx"]
    (effect,) = (e for e in found.effects if e.kind == "narrowband")
    assert effect.parameters["frequency"].value == pytest.approx(7.0, abs=0.2)
    least, most = effect.evidence["swells"]
    assert 3 * least < effect.parameters["sigma"].value < most / 1.5
    assert found.shares.named > 0.95


@pytest.mark.parametrize("seed", range(8))
def test_a_shaken_resonance_beside_a_line_is_a_band_too(bench, seed):
    """Together they are no band, and only the line had a name."""
    b = bench(720 + seed, 240.0)
    shaken = 1 + 0.5 * np.sin(2 * np.pi * b.t / 37)
    band = 0.045 * turned(noise_of_width(b, 0.3) * shaken, np.full(len(b.t), 6.8))
    line = 0.045 * np.sin(2 * np.pi * 8.5 * b.t + np.cumsum(b.rng.normal(0, 0.02, len(b.t))))
    found = explain(b.record(b.noise() + band + line)).axes["gx"]
    places = [(e.kind, e.parameters.get("frequency")) for e in found.effects]
    named = [(kind, at.value) for kind, at in places if at is not None and at.value < 12]
    assert [kind for kind, _ in named] == ["narrowband", "drifting_line"]
    assert [at for _, at in named] == pytest.approx([6.8, 8.5], abs=0.15)


def test_a_line_on_the_slope_of_a_known_band_stands_out(bench):
    b = bench(730, 240.0)
    band = 0.14 * turned(noise_of_width(b, 0.3), np.full(len(b.t), 6.8))
    line = 0.045 * np.sin(2 * np.pi * 7.7 * b.t + 4 * np.pi * np.sin(b.t / 20))
    view = View.of(series_of(b.record(b.noise() + band + line)), "gx")
    cluster, slope = range_of(view, 7.56, 7.84), range_of(view, 5.0, 7.54)
    found = drifting_line(view, cluster, Candidate(None, 0.0, 0.0), slope)
    assert found.effect.frequency.value == pytest.approx(7.7, abs=0.02)
    assert drifting_line(view, cluster, Candidate(None, 0.0, 0.0)) is None


@pytest.mark.parametrize("duration_s", [200.0, 2000.0, 20_000.0])
def test_noise_of_any_width_is_not_cut_at_its_valleys(bench, duration_s):
    """Of means over as many ordinates however many there are, some are low: it was many lines."""
    for seed in range(4):
        b = bench(720 + seed, duration_s)
        band = 0.05 * turned(noise_of_width(b, 1.0), np.full(len(b.t), 12.0))
        view = View.of(series_of(b.record(b.noise() + band)), "gx")
        whole = range_of(view, 11.0, 13.0)
        assert lines_of(view, whole) == [whole]
