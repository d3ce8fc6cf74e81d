"""Text in physical units: the step of the numbers is found from them, not taken for one unit."""

import json

import numpy as np
import pytest

from allanscope.__main__ import main

STEP_G = 6.1e-5


@pytest.fixture
def centred(tmp_path):
    """Write ten steps of white noise about zero, rounded to the part's step."""
    random = np.random.default_rng(3)
    values = np.round(10 * random.normal(size=4000)) * STEP_G
    path = tmp_path / "centred.csv"
    np.savetxt(path, values, fmt="%.7g", header="ax[g]", comments="")
    return path


def test_fine_steps_about_zero_are_not_taken_for_coarse_ones(centred, capsys):
    assert main(["analyse", str(centred), "--rate", "104", "--json", "-", "--quiet"]) == 0
    axis = json.loads(capsys.readouterr().out)["axes"]["ax"]
    assert axis["effects"] == []
    density = 10 * STEP_G / np.sqrt(104)
    assert axis["coefficients"]["N"]["value"] == pytest.approx(density, rel=0.05)


def test_the_step_of_the_numbers_tells_the_full_scale(centred, capsys):
    main(["analyse", str(centred), "--rate", "104", "--part", "LSM6DSM", "--json", "-", "--quiet"])
    assert json.loads(capsys.readouterr().out)["axes"]["ax"]["datasheet"]["density"]["limit"]
