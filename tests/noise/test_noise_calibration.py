"""The table of penalties: a row for every kind, and a number where no equation tells it."""

import tomllib
from importlib.resources import files

import pytest

from allanscope.explain.effects import KINDS
from allanscope.noise.selection import calibrated_penalty

TABLE = tomllib.loads(files("allanscope.noise").joinpath("calibration.toml").read_text("utf-8"))


def test_every_row_is_a_kind():
    """A kind that is new needs a row only where no equation gives its penalty."""
    assert set(TABLE) <= {*KINDS, "drift"}


@pytest.mark.parametrize("kind", sorted(TABLE))
def test_a_penalty_is_a_number_where_its_origin_is_a_calibration(kind):
    row = TABLE[kind]
    assert ("penalty" in row) == row["origin"].startswith("calibration")
    assert row["axes"] > 0
    assert row["false_alarms"] <= 0.02 * row["axes"]


def test_a_calibrated_penalty_is_read_from_the_table():
    assert calibrated_penalty("excursion") == TABLE["excursion"]["penalty"]
    assert calibrated_penalty("drift") > TABLE["drift"]["gain_of_1_in_100"]
