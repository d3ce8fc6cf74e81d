"""Motors and pumps: two at nearly one speed are two lines, couple no axes and are no shocks."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.history import Record

RATE, SECONDS, SIGMA = 104.0, 60.0, 0.05


def wander(rng, n, sigma_hz, tau_s):
    """Return a frequency that wanders about zero."""
    phi = np.exp(-1 / (tau_s * RATE))
    out = np.zeros(n)
    for i, one in enumerate(rng.normal(0, sigma_hz * np.sqrt(1 - phi**2), n)):
        out[i] = phi * out[i - 1] + one
    return out


def motor(rng, n, mean_hz, harmonics=(), sigma_hz=0.05):
    """Return a line whose frequency wanders, with its harmonics as {multiple: amplitude}."""
    phase = 2 * np.pi * np.cumsum(mean_hz + wander(rng, n, sigma_hz, 5.0)) / RATE
    return np.sin(phase) + sum(size * np.sin(k * phase + k) for k, size in harmonics)


def record(*columns):
    values = np.column_stack(columns)
    n = len(values)
    return Record(
        rate_hz=RATE, stride=1, axes=("gx", "gy", "gz")[: len(columns)], values=values,
        lsb=(1e-7,) * len(columns), temperature_c=np.full(n, np.nan),
        start_s=np.arange(n) / RATE, segments=np.array([[0, n]]),
    )  # fmt: skip


@pytest.mark.parametrize("seed", [31, 32])
def test_two_motors_a_hertz_and_a_half_apart_are_two_lines(seed):
    """Loud enough that all between them is above the noise; they were one line within 1.8 Hz."""
    rng = np.random.default_rng(seed)
    n = int(SECONDS * RATE)
    near = 2.0 * motor(rng, n, 31.2) + 3.0 * motor(rng, n, 32.7)
    (axis,) = explain(record(near + rng.normal(0, SIGMA, n))).axes.values()
    lines = [e.parameters for e in axis.effects if e.kind in ("drifting_line", "narrowband")]
    lines = sorted((p["frequency"].value, p["sigma"].value) for p in lines if p["sigma"].value > 1)
    assert [f for f, _ in lines] == pytest.approx([31.2, 32.7], abs=0.2)
    assert [s for _, s in lines] == pytest.approx([2 / np.sqrt(2), 3 / np.sqrt(2)], rel=0.1)


def test_the_lines_of_two_motors_couple_no_axes():
    """Beside each line two axes agree in what is left of it; 2.8 % of coupling were named."""
    rng = np.random.default_rng(41)
    n = int(600 * RATE)
    overtones = ((2, 0.5), (3, 0.3))
    first, second = motor(rng, n, 11.3, overtones), motor(rng, n, 14.1, overtones)
    noise = rng.normal(0, SIGMA, (3, n))
    axes = (
        0.020 * first + 0.015 * second + noise[0],
        0.010 * first + 0.012 * second + noise[1],
        0.006 * first + noise[2],
    )
    result = explain(record(*axes))
    found = {e.kind for axis in result.axes.values() for e in axis.effects}
    assert found <= {"drifting_line", "narrowband", "sinusoid"}
    for axis in ("gx", "gy", "gz"):
        n_after = result.models_after[axis].value("N")
        assert n_after == pytest.approx(SIGMA / np.sqrt(RATE), rel=0.02)


def test_a_pump_that_is_switched_on_and_off_is_no_shock():
    """Its first waves ring in what its spectrum whitened: shocks of ten times its amplitude."""
    rng = np.random.default_rng(45)
    n = int(600 * RATE)
    pump = 0.2 * motor(rng, n, 24.7, sigma_hz=0.02) * (np.arange(n) / RATE % 60 < 25)
    (axis,) = explain(record(pump + rng.normal(0, SIGMA, n))).axes.values()
    (line,) = axis.effects
    assert line.kind == "drifting_line"
    assert line.parameters["frequency"].value == pytest.approx(24.7, abs=0.05)
    assert line.evidence["share_of_time"] == pytest.approx(25 / 60, abs=0.05)
