"""A board that tilts with the temperature moves the horizontal axes as a bias would."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain


def record(b, means):
    """Six axes of which ax follows the temperature by 0.2 mg/degC."""
    temperature = 25 + 4 * np.sin(2 * np.pi * b.t / 300.0)
    accel = [b.noise() / 40 + mean for mean in means]
    accel[0] = accel[0] + 2e-4 * (temperature - 25)
    made = b.record(*(b.noise() for _ in range(3)), *accel, lsb=1e-6, temperature=temperature)
    return made


@pytest.mark.parametrize(
    ("means", "tilts"),
    [((0.02, -0.1, 0.99), True), ((0.98, 0.1, 0.1), False), ((0.0, 0.0, 0.0), False)],
    ids=["horizontal", "vertical", "without gravity"],
)
def test_a_slope_of_a_horizontal_axis_may_be_a_tilt(bench, means, tilts):
    axis = explain(record(bench(751, 900.0), means)).axes["ax"]
    assert [effect.kind for effect in axis.effects] == ["temperature"]
    words = axis.effects[0].evidence["words"]
    # 0.2 mrad/degC are 0.0115 deg/degC.
    assert ("or the board tilts by 0.011 deg/degC" in words or "0.012 deg" in words) == tilts
