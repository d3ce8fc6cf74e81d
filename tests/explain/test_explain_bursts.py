"""Vibration near Nyquist that comes in bursts, as of footsteps about a desk, beside a pump."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from allanscope.explain import explain
from allanscope.explain.effects.unexplained import _lifts_the_fit, left_over
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves.resolve_tones import resolve_tones
from allanscope.explain.residual import Bands
from allanscope.explain.series import series_of
from allanscope.explain.view import View

N, RATE, PUMP_HZ = 4e-3, 52.0, 17.16
SIGMA = N * RATE**0.5


def bursts(b, level=0.0, number=12, seconds=4.0):
    """Return an envelope of some bursts above a level."""
    loud = np.full(len(b.t), level)
    for at in b.rng.uniform(20, 580, number):
        loud += b.rng.uniform(3, 12) * np.exp(-(((b.t - at) / seconds) ** 2))
    return loud


def shaken(b, above=0.72, loud_pump=2.5):
    """Return white noise, bursts above a share of the band, and a pump that is on for 140 s."""
    white = b.rng.normal(0, SIGMA, len(b.t))
    loud = bursts(b, 0.3)
    shaking = sosfilt(butter(4, above, "high", output="sos"), b.rng.normal(0, SIGMA, len(b.t)))
    wander = 0.02 * np.sin(2 * np.pi * b.t / 37)
    pump = loud_pump * SIGMA * np.sin(2 * np.pi * np.cumsum(PUMP_HZ + wander) / RATE)
    return b.record(white + loud * shaking + pump * (abs(b.t - 320) < 70))


@pytest.mark.parametrize("seed", [1, 2])
def test_bursts_near_nyquist_are_no_q_and_hide_no_line(bench, seed):
    """With Q for them N was 10 and 38 % too low, and what lies below was unexplained."""
    found = explain(shaken(bench(seed, 600.0))).axes["gx"]
    assert not found.coefficients_after["Q"].detected
    assert found.coefficients_after["N"].value == pytest.approx(N, rel=0.03)
    (line,) = (e for e in found.effects if e.kind == "drifting_line")
    assert line.parameters["frequency"].value == pytest.approx(PUMP_HZ, abs=0.02)
    assert found.after.chi2_per_dof < 3


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_line_that_was_left_out_with_the_bursts_around_it_is_found(bench, seed):
    view = View.of(series_of(shaken(bench(seed, 600.0), above=0.5, loud_pump=4.0)), "gx")
    view = view.accept(left_over(view, (14.0, 23.0), 100.0, "a tone and what is beside it"))
    found = [c.effect for c in resolve_tones(view, SearchPath()).accepted]
    (line,) = (one for one in found if one.kind == "drifting_line")
    assert line.frequency.value == pytest.approx(PUMP_HZ, abs=0.02)
    assert len(found) > 1  # the bursts are still there


@pytest.mark.parametrize("seed", range(1, 5))
def test_bursts_in_the_middle_of_the_band_are_no_part_of_n(bench, seed):
    """N was read within them, where half of the lower frequencies lie: 24 to 40 % too high."""
    b = bench(seed, 600.0)
    band = butter(2, [4.0, 8.0], "band", fs=RATE, output="sos")
    shaking = bursts(b, number=20, seconds=7.0) * sosfilt(band, b.rng.normal(0, SIGMA, len(b.t)))
    found = explain(b.record(b.rng.normal(0, SIGMA, len(b.t)) + shaking)).axes["gx"]
    assert found.coefficients_after["N"].value == pytest.approx(N, rel=0.08)


@pytest.mark.parametrize(
    ("ratio", "lifts"),
    [
        ([0.4, 0.4, 3.0, 0.5, 0.4], True),
        ([0.8, 0.4, 3.0, 0.03, 0.02], False),  # a filter takes the top away
        ([3.0, 3.0, 0.4, 0.4, 0.4], False),
        ([0.4, 3.0, 3.0, 3.0, 0.4], False),  # most of the band
    ],
)
def test_what_lifts_a_fit_is_louder_than_one_floor_on_both_sides(ratio, lifts):
    ratio, count = np.array(ratio), np.full(5, 1000.0)
    edges = np.arange(6.0)
    z = (np.cbrt(ratio) - 1) * 60
    bands = Bands(edges[:-1] + 0.5, edges[:-1], edges[1:], np.arange(5), count, ratio, z)
    louder = np.flatnonzero(ratio > 1)
    assert _lifts_the_fit(bands, slice(louder[0], louder[-1] + 1), 5000) is lifts
