"""A machine that is switched on for a while is its lines, and nothing beside them."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain

SIGMA = 4e-3 * 52.0**0.5
ON, OFF = 300.0, 330.0


def machine(b, size, frequency=15.0, span=(ON, OFF), wander=0.0, over_s=1.0):
    """Return a tone of a peak in sigma that is switched on and off, over a second each."""
    part = (b.t >= span[0]) & (b.t < span[1])
    phase = 2 * np.pi * frequency * b.t
    if wander:
        phase += wander * np.cumsum(b.rng.normal(size=len(b.t))) / 52**0.5
    edge = np.clip(np.minimum(b.t - span[0], span[1] - b.t) / over_s, 0.0, 1.0)
    return size * SIGMA * np.sin(phase) * edge * part


def is_around(effect, frequency):
    """Return whether an effect, with a name or without, is at a frequency and nowhere else."""
    at = [effect.parameters[name].value for name in effect.parameters if "frequency" in name]
    return all(abs(one - frequency) < 0.2 for one in at)


def found(b, *signals):
    return explain(b.record(b.noise() + sum(signals))).axes["gx"]


@pytest.mark.parametrize("wander", [0.0, 0.3, 1.0])
@pytest.mark.parametrize(("seed", "size"), [(0, 30.0), (1, 30.0), (3, 30.0)])
def test_a_machine_that_is_switched_is_one_line_however_loud(bench, seed, size, wander):
    one = found(b := bench(seed, 1800.0), machine(b, size, wander=wander))
    (line,) = one.effects
    assert line.kind == "drifting_line"
    assert line.parameters["frequency"].value == pytest.approx(15.0, abs=0.1)
    (first, last), *_ = line.evidence["present"]
    assert first == pytest.approx(ON, abs=8.0)
    assert last == pytest.approx(OFF, abs=8.0)
    assert one.explained
    assert one.coefficients_after["N"].value == pytest.approx(4e-3, rel=0.03)


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_two_speeds_whose_phase_wanders_are_two_lines(bench, seed):
    b = bench(seed, 5400.0)
    slow = machine(b, 1.0, 15.0, (0.0, 1800.0), wander=0.3)
    fast = machine(b, 1.0, 17.1, (1800.0, 3600.0), wander=0.3)
    one = found(b, slow, fast)
    assert [effect.kind for effect in one.effects] == ["drifting_line"] * 2
    lines = sorted(effect.parameters["frequency"].value for effect in one.effects)
    assert lines == pytest.approx([15.0, 17.1], abs=0.02)
    assert one.explained


def test_machines_that_take_turns_leave_rows_to_be_judged_by(bench):
    b = bench(3, 1800.0)
    spans = [(0.0, 600.0), (600.0, 1200.0), (1200.0, 1800.0)]
    turns = [machine(b, 10.0, f, span) for f, span in zip((11.0, 15.0, 19.0), spans, strict=True)]
    one = found(b, *turns)
    lines = [e.parameters["frequency"].value for e in one.effects if e.kind == "drifting_line"]
    assert sorted(lines) == pytest.approx([11.0, 15.0, 19.0], abs=0.02)


@pytest.mark.parametrize(("seed", "size"), [(8, 20.0), (11, 10.0)])
def test_the_noise_is_not_louder_where_a_machine_begins(bench, seed, size):
    b = bench(seed, 3600.0)
    one = found(b, machine(b, size, 11.5, (1800.0, 1860.0), over_s=2.0))
    assert [effect.kind for effect in one.effects] == ["drifting_line"]


def test_noise_that_is_louder_at_another_time_is_told(bench):
    b = bench(935, 3600.0)
    louder = b.noise() * ((b.t > 600.0) & (b.t < 620.0))
    one = found(b, machine(b, 10.0, 11.5, (1800.0, 1860.0), over_s=2.0), louder)
    assert {effect.kind for effect in one.effects} == {"drifting_line", "variance_change"}


@pytest.mark.parametrize("seed", [930, 932, 933, 934])
def test_a_line_that_is_there_all_along_beside_it_is_constant(bench, seed):
    b = bench(seed, 1200.0)
    hum = 0.12 * SIGMA * np.sin(2 * np.pi * 14.0 * b.t)
    effects = {effect.kind: effect for effect in found(b, machine(b, 30.0), hum).effects}
    assert set(effects) == {"drifting_line", "sinusoid"}
    line = effects["sinusoid"].parameters
    assert line["frequency"].value == pytest.approx(14.0, abs=2e-4)
    assert line["amplitude"].value == pytest.approx(0.12 * SIGMA, rel=0.25)


def test_a_faint_line_that_is_there_all_along_beside_it_is_not_lost(bench):
    b = bench(932, 1200.0)
    hum = 0.06 * SIGMA * np.sin(2 * np.pi * 14.0 * b.t)
    assert any(is_around(effect, 14.0) for effect in found(b, machine(b, 30.0), hum).effects)


def test_a_machine_at_another_time_is_another_one(bench):
    b = bench(931, 1200.0)
    other = machine(b, 1.5, 14.0, (700.0, 760.0))
    one = found(b, machine(b, 30.0), other)
    lines = sorted(effect.parameters["frequency"].value for effect in one.effects)
    assert lines == pytest.approx([14.0, 15.0], abs=0.02)


def test_a_second_line_of_the_same_machine_is_told(bench):
    b = bench(932, 1200.0)
    one = found(b, machine(b, 30.0), machine(b, 3.0, 17.0))
    assert any(is_around(effect, 17.0) for effect in one.effects)


def test_a_range_without_a_name_at_another_time_is_not_lost(bench):
    b = bench(933, 1200.0)
    sweep = (
        2 * np.pi * np.cumsum(13.0 + (b.t > 700) * (b.t < 1100) * 1.2 * np.sin(b.t / 5) ** 2) / 52
    )
    loud = 0.8 * SIGMA * np.sin(sweep) * ((b.t > 700) & (b.t < 1100))
    one = found(b, machine(b, 30.0), loud)
    assert any(effect.kind != "drifting_line" for effect in one.effects)


def test_heavy_tails_that_are_not_those_of_the_machine_are_told(bench):
    b = bench(934, 1200.0)
    heavy = b.noise() * np.where(b.rng.random(len(b.t)) < 0.05, 2.5, 0.0)
    one = found(b, machine(b, 30.0), heavy)
    assert any("heavier tails" in effect.evidence["words"] for effect in one.effects)
