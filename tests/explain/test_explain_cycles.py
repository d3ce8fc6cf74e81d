"""A level that repeats one waveform, in cycles whose length wanders."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.analysis import findings_of
from allanscope.explain import explain
from allanscope.explain.cycles import phase_of, settled
from allanscope.explain.effects import cycle
from allanscope.explain.effects.cycle import Cycle
from allanscope.explain.series import series_of
from allanscope.explain.view import View

RATE, SIGMA, SECONDS, COUNT = 52.0, 4e-3 * 52.0**0.5, 7200.0, 60


def instants(b, mean_s=400.0):
    """Return when each cycle begins, from before the record until after it."""
    lengths = mean_s * b.rng.uniform(0.6, 1.4, COUNT)
    return np.cumsum(lengths) - 1.5 * lengths[0]


def air_conditioner(b, begins):
    """Return a level that is heated in a third of each cycle and follows slowly."""
    before = np.arange(-300.0, 0.0, 1 / RATE)
    is_on = phase_of(begins, np.append(before, b.t)) % 1 < 1 / 3
    lag = 30.0 * RATE
    level = lfilter([1 / lag], [1, -(1 - 1 / lag)], is_on - 1 / 3)[len(before) :]
    return level / level.std()


def kinds(explanation):
    return [effect.kind for effect in explanation.effects]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_air_conditioner_is_one_finding_with_its_instants(bench, seed):
    b = bench(seed, SECONDS)
    begins = instants(b)
    level = air_conditioner(b, begins)
    sizes = (0.5, -0.3, 0.8)
    axes = explain(b.record(*(b.noise() + a * SIGMA * level for a in sizes))).axes
    for size, one in zip(sizes, axes.values(), strict=True):
        assert kinds(one) == ["cycle"]
        assert one.after.chi2_per_dof < 0.1 * one.before.chi2_per_dof
        (effect,) = one.effects
        assert effect.parameters["sigma"].value == pytest.approx(abs(size) * SIGMA, rel=0.05)
        inside = begins[(begins > 0) & (begins < SECONDS)]
        period, lengths = effect.parameters["period"], np.diff(inside)
        assert period.value == pytest.approx(lengths.mean(), rel=0.03)
        half = 2.11 * lengths.std(ddof=1) / np.sqrt(len(lengths))  # Student's t of some 17 lengths
        assert period.upper - period.value == pytest.approx(half, rel=0.15)
        found = np.array(effect.evidence["begins"])
        assert found[0] <= 0 < found[1]
        assert found[-2] < SECONDS - 1 / RATE <= found[-1]
        # Where in its waveform a cycle begins is a matter of words, so one offset of all is free.
        late = phase_of(begins, found[1:-1])
        assert np.std((late - late[0] + 0.5) % 1) < 0.04
    assert [one.axes for one in findings_of({a: one.effects for a, one in axes.items()})] == [
        ("gx", "gy", "gz")
    ]


def test_axes_that_follow_two_air_conditioners_are_two_findings(bench):
    b = bench(4, SECONDS)
    room, other = (air_conditioner(b, instants(b)) for _ in range(2))
    levels = 0.5 * room, -0.3 * room, 0.8 * other
    axes = explain(b.record(*(b.noise() + SIGMA * level for level in levels))).axes
    found = findings_of({axis: one.effects for axis, one in axes.items()})
    assert sorted((one.kind, one.axes) for one in found) == [
        ("cycle", ("gx", "gy")), ("cycle", ("gz",)),
    ]  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_waves_of_one_length_are_lines(bench, seed):
    b = bench(seed, SECONDS)
    turn = 2 * np.pi * b.t / b.rng.uniform(200.0, 500.0)
    wave = np.sin(turn) + 0.4 * np.sin(2 * turn + 1)
    (one,) = explain(b.record(b.noise() + 0.5 * SIGMA * wave)).axes.values()
    assert set(kinds(one)) == {"sinusoid"}


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5, 6])
def test_noise_in_a_band_has_no_waveform(bench, seed):
    b = bench(seed, SECONDS)
    pole = np.exp((-np.pi / b.rng.uniform(2.0, 10.0) + 2j * np.pi) / (200.0 * RATE))
    e = b.rng.standard_normal(2 * len(b.t))
    noise = lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], e)[len(b.t) :]
    (one,) = explain(b.record(b.noise() + SIGMA * noise / noise.std())).axes.values()
    assert "cycle" not in kinds(one)


@pytest.mark.parametrize("seed", range(8))
def test_noise_gains_less_than_its_instants_cost(bench, monkeypatch, seed):
    b = bench(seed, SECONDS)
    monkeypatch.setattr(cycle, "slow_excess", lambda _: b.rng.uniform(0.002, 0.01))
    (one,) = Cycle.candidates(View.of(series_of(b.record(b.noise())), "gx"))
    assert one.effect.price_of_instants > 0
    assert one.excess < 0


def test_cycles_cover_the_record(bench):
    b = bench(9, SECONDS)
    begins = instants(b)
    rows = b.noise() + 0.5 * SIGMA * air_conditioner(b, begins)
    view = View.of(series_of(b.record(rows)), "gx")
    inside = begins[(begins > 0) & (begins < SECONDS)] * RATE
    found = settled(view, inside, 3)  # without the two that are there in part
    assert len(found.begins) == len(inside) + 2
    assert found.begins[0] <= 0
    assert found.begins[-1] >= len(rows) - 1


def test_a_step_beside_regular_cycles_keeps_its_name(bench):
    b = bench(7, SECONDS)
    level = air_conditioner(b, instants(b)) + np.where(b.t > 4000.0, 2.0, 0.0)
    (one,) = explain(b.record(b.noise() + 0.5 * SIGMA * level)).axes.values()
    assert sorted(kinds(one)) == ["cycle", "step"]
    (step,) = (e for e in one.effects if e.kind == "step")
    assert step.parameters["time"].value == pytest.approx(4000.0, abs=2.0)


def test_a_record_that_has_grown_is_cut_again(bench):
    b = bench(8, SECONDS)
    rows = b.noise() + 0.5 * SIGMA * air_conditioner(b, instants(b))
    half = len(b.t) // 2
    short, whole = (View.of(series_of(b.record(x)), "gx") for x in (rows[:half], rows))
    (found,) = Cycle.candidates(short)
    grown = found.effect.prolong(whole, found)
    assert grown.effect.count > 1.6 * found.effect.count
    left = np.std(whole.data - grown.signal)
    assert left == pytest.approx(SIGMA, rel=0.02)
