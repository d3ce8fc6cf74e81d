"""A step that no full scale of the named part has is said; whatever may be right is not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from allanscope.__main__ import main

ROWS = 4000


def remarks(path: Path, gyro: float, accel: float, written: str = "%.7f", part: str = "LSM6DSL"):
    """Return what is remarked of counts that are written at these scales in dps and g."""
    rng = np.random.default_rng(8)
    counts = rng.normal(0.0, 4.0, (ROWS, 6)).round()
    counts[:, 5] += round(1.0 / accel)
    values = counts * ([gyro] * 3 + [accel] * 3)
    header = "gx[dps],gy[dps],gz[dps],ax[g],ay[g],az[g]"
    np.savetxt(path / "a.csv", values, written, ",", header=header, comments="")
    named = ["--part", part] if part else []
    out = path / "a.json"
    asked = ["analyse", str(path / "a.csv"), "--rate", "104", "--json", str(out), "--quiet", *named]
    assert main(asked) == 0
    return [one for one in json.loads(out.read_text())["remarks"] if "are multiples of" in one]


@pytest.mark.parametrize("written", ["%.7f", "%.2f"])
def test_full_scale_over_32768_is_told_with_the_factor(tmp_path, written):
    (told,) = remarks(tmp_path, 2000 / 32768, 4 / 32768, written)
    assert "2000 dps / 32768; a count of the LSM6DSL is 70.00 mdps at 2000 dps" in told
    assert "12.8 % low, and so is the noise. Multiply them by 1.147." in told


@pytest.mark.parametrize("scale", [4.375e-3, 8.75e-3, 17.5e-3, 35e-3, 70e-3])
def test_the_scales_of_the_part_are_right(tmp_path, scale):
    assert remarks(tmp_path, scale, 0.061e-3) == []


def test_another_scale_is_told_with_the_nearest(tmp_path):
    (told,) = remarks(tmp_path, 0.05, 0.122e-3, "%.9f")
    assert "50.00 mdps, a step that no full scale of the LSM6DSL has" in told
    assert "70.00 mdps at 2000 dps" in told
    assert "multiply them by 1.400" in told


def test_the_step_of_the_digits_says_nothing(tmp_path):
    """Noise of many steps, written to 0.01: that is the step that shows."""
    assert remarks(tmp_path, 0.01, 1e-3) == []


def test_without_a_part_nothing_is_claimed(tmp_path):
    assert remarks(tmp_path, 2000 / 32768, 4 / 32768, part="") == []
