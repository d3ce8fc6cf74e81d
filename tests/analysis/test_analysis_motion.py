"""A board that was taken in the hand is told of; one at rest is not, however it drifts."""

from __future__ import annotations

import re

import numpy as np
import pytest

import allanscope
from allanscope.analysis.motion import motion_remark
from allanscope.history import History, Record

RATE_HZ = 52.0
ROWS = 60 * 52
AXES = ("gx", "gy", "gz", "ax", "ay", "az")


def at_rest() -> np.ndarray:
    """Noise, a bias of 12 dps that drifts by 2, vibration of 20 dps and of 0.5 g at 20 Hz."""
    time_s = np.arange(ROWS) / RATE_HZ
    values = np.random.default_rng(1).normal(0.0, [0.1] * 3 + [1e-3] * 3, (ROWS, 6))
    values[:, 0] += 12.0 + 2.0 * time_s / 60.0
    values[:, 1] += 20.0 * np.sin(2 * np.pi * 20.0 * time_s)
    values[:, 3] += 0.5 * np.sin(2 * np.pi * 20.0 * time_s)
    values[:, 5] += 1.0
    return values


def record_of(values: np.ndarray, axes: tuple[str, ...] = AXES) -> Record:
    history = History(axes=len(axes))
    history.update(values)
    return history.record(RATE_HZ, axes, (1.0,) * len(axes))


def test_a_board_that_drifts_and_shakes_is_at_rest() -> None:
    assert motion_remark(record_of(at_rest())) == ""


@pytest.mark.parametrize("dps", [-8.0, 40.0])
def test_a_turn_is_told_with_its_times(dps: float) -> None:
    values = at_rest()
    values[20 * 52 : 24 * 52, 2] += dps
    told = motion_remark(record_of(values))
    begin, end = map(float, re.findall(r"between ([\d.]+) s and ([\d.]+) s", told)[0])
    assert 20.0 - 1.3 < begin < 20.0 + 1.3  # rows of 1.2 s
    assert 24.0 - 1.3 < end < 24.0 + 1.3
    turned = float(re.findall(r"turned at up to ([\d.]+) dps", told)[0])
    assert turned == pytest.approx(abs(dps), rel=0.03)
    assert "tilted" not in told


@pytest.mark.parametrize(("degrees", "moved"), [(3.0, False), (10.0, True)])
def test_a_tilt_counts_from_five_degrees(degrees: float, moved: bool) -> None:
    values = at_rest()
    values[40 * 52 :, 4] += np.sin(np.radians(degrees))
    told = motion_remark(record_of(values))
    assert ("tilted by up to" in told) is moved
    assert "turned" not in told


def test_two_axes_do_not_tell_the_direction_of_gravity() -> None:
    values = at_rest()[:, 3:5]
    values[40 * 52 :, 1] += 0.5
    assert motion_remark(record_of(values, ("ax", "ay"))) == ""


def test_acceleration_without_gravity_has_no_tilt() -> None:
    values = at_rest()
    values[:, 5] -= 1.0
    values[:, :3] = 0.0
    assert motion_remark(record_of(values)) == ""


def test_the_result_says_it_first() -> None:
    values = at_rest()
    values[20 * 52 : 24 * 52, 2] += 90.0
    found = allanscope.analyse(dict(zip(AXES, values.T, strict=True)), rate=RATE_HZ)
    assert found.remarks[0].startswith("The board was moved between ")
