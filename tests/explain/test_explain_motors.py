"""Motors that run freely: their lines wander over hertz, and each is on every axis."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.history import Record

N, RATE, SECONDS = 90e-6, 833.0, 90.0


def motor(rng, n, mean_hz):
    """Return a line and its harmonics; its frequency wanders and ends where it began."""
    walk = np.cumsum(rng.normal(0, 0.4 / RATE**0.5, n))
    frequency = mean_hz + walk - np.linspace(0, walk[-1], n)
    phase = 2 * np.pi * np.cumsum(frequency) / RATE
    return np.sin(phase) + 0.3 * np.sin(2 * phase + 1) + 0.15 * np.sin(3 * phase + 2)


@pytest.mark.parametrize("seed", [731, 732])
def test_two_loud_motors_are_two_lines_and_n_is_that_of_the_sensor(seed):
    """Their bands have no width of their own; all was unexplained, or a low-pass."""
    rng = np.random.default_rng(seed)
    n = int(SECONDS * RATE)
    loud = 0.02 * motor(rng, n, 61.3) + 0.01 * motor(rng, n, 140.0)
    values = loud + rng.normal(0, N * RATE**0.5, n)
    record = Record(
        rate_hz=RATE, stride=1, axes=("ax",), values=values[:, np.newaxis], lsb=(1e-7,),
        temperature_c=np.full(n, np.nan), start_s=np.arange(n) / RATE, segments=np.array([[0, n]]),
    )  # fmt: skip
    result = explain(record)
    axis = result.axes["ax"]
    lines = {
        round(one.parameters["frequency"].value, -1): one
        for one in axis.effects
        if one.kind in ("drifting_line", "narrowband") and one.parameters["sigma"].value > 5e-3
    }
    assert lines.keys() == {60.0, 140.0} or lines.keys() == {60.0, 130.0}
    assert lines[60.0].parameters["sigma"].value == pytest.approx(0.02 / np.sqrt(2), rel=0.05)
    assert "band_limit" not in [one.kind for one in axis.effects]
    assert result.models_after["ax"].value("N") == pytest.approx(N, rel=0.05)
    assert axis.after.rms_percent < max(1.5 * axis.after.expected_rms_percent, 20.0)
    assert axis.after.rms_percent < axis.before.rms_percent / 3
