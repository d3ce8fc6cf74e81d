"""Effects put into measured noise are found there, and scrambled noise holds none."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from allanscope.explain.effect import Estimate

ROOT = Path(__file__).parents[2]
PATH = ROOT / "recordings" / "measured" / "ism330dhcx-fan-off.parquet"


@pytest.fixture(scope="module")
def injection():
    """Return the benchmark."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        return importlib.import_module("injection")
    finally:
        sys.path.remove(str(ROOT / "benchmarks"))


@pytest.fixture(scope="module")
def carriers(injection):
    """Return those of the axes that tests ask about: the recording is analysed once."""
    axes = ("gx", "gz", "ax")
    return dict(zip(axes, injection.carriers([PATH], axes), strict=True))


@pytest.fixture(scope="module")
def carrier(carriers):
    return carriers["gx"]


@pytest.mark.parametrize(
    ("kind", "times"), [("sinusoid", 5.0), ("step", 5.0), ("gauss_markov", 3.0)]
)
def test_what_is_above_the_limit_is_found_and_nothing_beside(injection, carrier, kind, times):
    outcome = injection.trial(carrier, kind, times, [1, 2])
    assert outcome == injection.Outcome(right=True, false=0)


def test_what_must_be_told_from_chance_is_sized_by_it(injection, carrier):
    """More rows are repeated where more are equal by chance, and each size cuts off more."""

    def inject(kind, times, one):
        put = injection.Injector(np.random.default_rng(5), one).inject(kind, times)
        return put[0]["fraction"]

    coarse = replace(carrier, record=replace(carrier.record, lsb=(0.035, 0.035)))
    assert inject("repeated_samples", 1.0, coarse) > 2 * inject("repeated_samples", 1.0, carrier)
    cut = [inject("saturation", times, carrier) for times in (1.0, 3.0, 10.0)]
    assert cut[0] > 20 / len(carrier.record.values)
    assert cut[2] > cut[1] > cut[0]


@pytest.mark.parametrize("blocks", [False, True])
def test_scrambled_noise_holds_nothing(injection, carrier, blocks):
    assert injection.control(carrier, blocks, [3]) == []


def test_a_run_that_was_interrupted_goes_on(injection, tmp_path):
    kept = injection.Kept(tmp_path / "outcomes")
    assert kept.once("one", lambda: 1) == injection.Kept(tmp_path / "outcomes").once("one", None)


def test_outcomes_are_counted(injection):
    tally = injection.Tally()
    tally.enter("step", 3.0, injection.Outcome(right=True, false=0))
    tally.enter("step", 3.0, injection.Outcome(right=False, false=2, said="gx: ramp, ramp"))
    assert "| `step` | 1 of 2 |" in injection.table(tally, (3.0,))
    assert tally.named[3.0] == 3
    assert tally.false[3.0] == 2
    assert tally.wrong["step", 3.0] == ["gx: ramp, ramp"]


def test_the_interval_is_that_of_wilson(injection):
    assert injection.interval(90, 100) == pytest.approx((82.56, 94.48), abs=0.01)
    assert injection.interval(0, 0) == (0.0, 100.0)


def test_a_band_is_where_its_width_is(injection):
    def band(kind, frequency, width):
        found = {"frequency": Estimate.exact(frequency, "Hz")}
        if width:
            found["bandwidth"] = Estimate.exact(width, "Hz")
        return injection.Effect(kind, found)

    known = band("narrowband", 12.1, 3.9)
    assert injection._is_same(band("narrowband", 11.25, 2.0), known)
    assert injection._is_same(band("sinusoid", 13.9, 0.0), known)
    assert not injection._is_same(band("narrowband", 18.0, 3.0), known)
    assert not injection._is_same(band("sinusoid", 13.9, 0.0), band("sinusoid", 12.1, 0.0))


@pytest.mark.parametrize(
    ("axis", "kind", "times", "seed"),
    [
        ("gz", "variance_change", 10.0, [7, 0, 11, 2, 100]),
        ("ax", "cross_coupling", 10.0, [7, 0, 17, 3, 100]),
    ],
)
def test_what_the_noise_itself_holds_hides_no_effect(injection, carriers, axis, kind, times, seed):
    """A filter is one in a record of two levels; and it tells not who leaks into whom."""
    assert injection.trial(carriers[axis], kind, times, seed) == injection.Outcome(
        right=True, false=0
    )
