"""Shares: every part of the excess over sampling error is named, nameless or left, once."""

from __future__ import annotations

import math

import numpy as np
import pytest

from allanscope.analysis import findings_of
from allanscope.explain import AxisExplanation, Effect, explain
from support.measured import analysed


def adds_up(one: AxisExplanation) -> None:
    """Check the sums of one axis."""
    shares = one.shares
    assert shares is not None
    parts = (shares.named, shares.nameless, shares.left)
    if not shares.excess_nats:
        assert all(map(math.isnan, parts))
        return
    assert min(parts) >= 0
    assert sum(parts) == pytest.approx(1.0, abs=1e-9)
    named = [e.share for e in one.own_effects if e.kind != "unexplained"]
    nameless = [e.share for e in one.own_effects if e.kind == "unexplained"]
    assert min([*named, *nameless], default=0.0) >= 0
    assert sum(named) == pytest.approx(shares.named, abs=1e-9)
    assert sum(nameless) <= shares.nameless + 1e-9, "the smooth remainder has the rest"


@pytest.fixture(scope="module")
def simulated(bench):
    """Return a line beside a step, a tone that sweeps beside another step, and noise."""
    b = bench(12)
    line = b.noise() + 3e-3 * np.sin(2 * np.pi * 7 * b.t) + 0.05 * (b.t > 500)
    sweep = b.noise() + 0.02 * np.sin(2 * np.pi * (3 * b.t + 2 * b.t**2 / 2400))
    sweep += 0.02 * (b.t > 700)
    return explain(b.record(line, sweep, b.noise())).axes


@pytest.mark.parametrize("axis", ["gx", "gy", "gz"])
def test_the_parts_add_up_on_simulated_axes(simulated, axis):
    adds_up(simulated[axis])


def test_named_effects_hold_all_that_they_are(simulated):
    shares = simulated["gx"].shares
    assert shares.named > 0.95
    step, line = (
        next(e for e in simulated["gx"].effects if e.kind == kind) for kind in ("step", "sinusoid")
    )
    assert step.share > line.share > 0.01, "the step gains several times as much as the line"


def test_what_has_no_name_has_its_part(simulated):
    shares = simulated["gy"].shares
    kinds = {e.kind for e in simulated["gy"].effects}
    assert kinds & {"unexplained", "drifting_line"}
    assert shares.excess_nats > 100


def test_noise_alone_has_no_excess(simulated):
    assert simulated["gz"].shares.excess_nats == 0


@pytest.mark.parametrize("name", ["actigraph-table", "ism330dhcx-fan-off"])
def test_the_parts_add_up_on_measured_axes(name):
    analysis = analysed(name)
    for one in analysis.axes.values():
        adds_up(one.explanation)
    shares = [one.share for one in analysis.findings if not math.isnan(one.share)]
    assert all(share > 0 for share in shares)
    assert sum(shares) <= 1 + 1e-9
    result = analysis.to_dict()
    axis = result["axes"]["ax"]
    assert axis["residual"]["shares"]["named"] == pytest.approx(
        sum(e["share"] for e in axis["effects"] if e["kind"] != "unexplained")
    )


@pytest.fixture(scope="module")
def fan():
    """Return the explanations of a sensor beside a fan that shakes it at 31.2 and 32.7 Hz."""
    analysis = analysed("ism330dhcx-fan-on")
    return {axis: one.explanation for axis, one in analysis.axes.items()}


def test_lines_that_were_cut_out_together_have_each_its_own_part(fan):
    """On gz the one has eleven times the power of the other, and they are in one range."""
    share = {
        round(e.parameters["frequency"].value, 1): e.share
        for e in fan["gz"].effects
        if e.kind == "drifting_line"
    }
    assert set(share) == {31.2, 32.7}
    assert share[32.7] > 5 * share[31.2]


def test_q_is_in_the_textbook_model_too_and_has_no_part_in_what_was_named(fan):
    assert fan["az"].coefficients_after["Q"].value > 1e-5
    for one in fan.values():
        adds_up(one)


def test_findings_are_in_the_order_of_their_shares():
    """What gained more on an axis with little excess comes after a large part of a large one."""
    small, large = Effect("step", {}, share=0.9), Effect("warm_up", {}, share=0.5)
    found = findings_of({"gx": [small], "gy": [large]}, {"gx": 20.0, "gy": 1000.0})
    assert [one.kind for one in found] == ["warm_up", "step"]
    assert [one.share for one in found] == pytest.approx([500 / 1020, 18 / 1020])


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_coarse_values_are_no_part_of_what_the_tails_of_the_noise_gain(bench, step):
    """Lumps a step apart were taken for it: three quarters of the excess of an accelerometer."""
    b = bench(31)
    heavy = b.rng.standard_t(12, len(b.t)) * np.std(b.noise())
    line = 0.4 * np.std(heavy) * np.sin(2 * np.pi * 7 * b.t)
    fine, coarse = (
        explain(b.record(heavy + line, lsb=size * np.std(heavy))).axes["gx"]
        for size in (1e-3, step)
    )
    assert "unexplained" in {e.kind for e in fine.effects}
    assert coarse.shares.nameless == pytest.approx(fine.shares.nameless, abs=0.05)
