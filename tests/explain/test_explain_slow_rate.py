"""A row every ten seconds, or every minute: what is found does not depend on the unit of time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from allanscope.explain import explain
from support.measured import analysed

SIGMA = 0.03
HZ = 0.1


def at_every_ten_seconds(record):
    n = len(record.values)
    return replace(record, rate_hz=HZ, start_s=np.arange(n) / HZ)


@pytest.fixture
def quiet(bench):
    """Return a bench with 6000 rows of white noise: 17 hours, if one comes every ten seconds."""
    return bench(811, 6000 / 52.0)


def found(record):
    axis = explain(at_every_ten_seconds(record)).axes["gx"]
    assert axis.explained
    return {effect.kind: effect for effect in axis.effects}


def test_a_level_that_follows_the_temperature(quiet):
    """Blocks of a second held no row each second time, and nothing was ever held out."""
    n = len(quiet.t)
    room = 2 * np.sin(2 * np.pi * 3.3 * np.arange(n) / n) + 0.4 * np.cumsum(
        quiet.rng.normal(0, 0.05, n)
    )
    rows = quiet.rng.normal(0, SIGMA, n) + 0.01 * room
    effect = found(quiet.record(rows, temperature=25 + room))["temperature"]
    slope = effect.parameters["slope"]
    assert slope.lower < 0.01 < slope.upper
    assert effect.evidence["held_out_nats"] > 20
    assert effect.evidence["held_out_design"] == "interleaved blocks of 10 s"


def test_a_step_and_a_line(quiet):
    n = len(quiet.t)
    i = np.arange(n)
    rows = quiet.rng.normal(0, SIGMA, n) + 0.01 * np.sin(2 * np.pi * 0.123 * i) + 0.03 * (i > 3500)
    effects = found(quiet.record(rows))
    assert set(effects) == {"step", "sinusoid"}
    assert effects["step"].parameters["time"].value == pytest.approx(35000, abs=1000)
    assert effects["sinusoid"].parameters["frequency"].value == pytest.approx(0.0123, abs=1e-6)


def test_noise_alone_has_no_effect(quiet):
    assert not found(quiet.record(quiet.rng.normal(0, SIGMA, len(quiet.t))))


def test_a_row_a_minute_is_searched(quiet):
    """Thirty seconds held no row, and the search of the axis failed."""
    n = len(quiet.t)
    rows = quiet.rng.normal(0, SIGMA, n) + 0.03 * (np.arange(n) > 3500)
    record = replace(quiet.record(rows), rate_hz=1 / 60, start_s=60.0 * np.arange(n))
    axis = explain(record).axes["gx"]
    assert [effect.kind for effect in axis.effects] == ["step"]
    assert axis.explained


@pytest.mark.parametrize("axis", ["ax", "ay", "az"])
def test_the_level_of_a_measured_accelerometer_follows_the_room(axis):
    """57 hours of an LSM9DS1. A straight line through hourly means has 424 to 586 ug/degC."""
    found = analysed("lsm9ds1-astropi").axes[axis].explanation
    effect = next(effect for effect in found.effects if effect.kind == "temperature")
    assert 350e-6 < abs(effect.parameters["slope"].value) < 600e-6
    assert found.after.rms_percent < 0.7 * found.before.rms_percent
    before, after = found.coefficients_before["K"], found.coefficients_after["K"]
    assert after.upper < before.lower
