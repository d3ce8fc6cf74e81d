"""The clock is compared with a rate that somebody claims, and with nothing else."""

from __future__ import annotations

import json

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.explain import explain


def effects(path, *options, capsys):
    assert main(["analyse", str(path), "--json", "-", "--quiet", *options]) == 0
    return json.loads(capsys.readouterr().out)["axes"]["gx"]["effects"]


@pytest.fixture
def timed(tmp_path):
    """Write 80 s at 104 Hz with times in whole milliseconds: the first rows say 103.9 Hz."""
    n = 104 * 80
    t = np.round(1000 * np.arange(n) / 104.0)
    values = np.random.default_rng(2).normal(0, 0.04, n)
    path = tmp_path / "timed.csv"
    np.savetxt(path, np.column_stack([t, values]), fmt=["%.0f", "%.6f"], delimiter=",",
               header="t[ms],gx[dps]", comments="")  # fmt: skip
    return path


def test_a_rate_that_nobody_claims_is_never_wrong(timed, capsys):
    assert effects(timed, capsys=capsys) == []


def test_a_rate_that_is_claimed_is_compared_with_the_times(timed, capsys):
    (effect,) = effects(timed, "--rate", "100", capsys=capsys)
    assert effect["kind"] == "clock_error"
    assert effect["parameters"]["relative"]["value"] == pytest.approx(0.04, abs=1e-4)
    assert effect["axes"] == ["gx"]


def test_without_a_better_clock_nothing_is_said_of_the_clock(bench):
    b = bench(50, 80.0)
    assert explain(b.record(b.noise()), nominal_hz=50.0).axes["gx"].effects == ()


def test_a_device_off_its_nominal_rate_is_not_unexplained(bench):
    b = bench(51, 80.0)
    record = b.record(b.noise())
    unaware = explain(record).axes["gx"]
    result = explain(record, nominal_hz=50.0, rate_fit=(52.0, 1e-3)).axes["gx"]
    assert [e.kind for e in result.effects] == ["clock_error"]
    assert (result.explained, result.after) == (unaware.explained, unaware.after)
