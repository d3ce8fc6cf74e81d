"""A board that is carried, turned or picked up: these rows go, and N is that of the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from allanscope.explain import explain
from allanscope.explain.moved_rows import blocks_of, find_moved_rows

SIGMA = 4e-3 * 52.0**0.5


def carried(b, first_s, last_s, size):
    """Return what an axis sees of a hand: noise below 3 Hz, that begins and ends softly."""
    part = np.flatnonzero((b.t >= first_s) & (b.t < last_s))
    low = butter(2, 3.0, fs=52.0, output="sos")
    swing = sosfilt(low, b.rng.normal(size=len(part) + 200))[200:]
    edge = np.minimum(np.arange(len(part)), np.arange(len(part))[::-1]) / 26.0
    signal = np.zeros(len(b.t))
    signal[part] = size * SIGMA * swing / swing.std() * np.minimum(edge, 1.0)
    return signal


def record(b, spans, size, jumps=(0.0,) * 3):
    """Return three axes that are carried, each to another level, and one that is not."""
    columns = []
    for jump in jumps:
        moved = sum(carried(b, *span, size) for span in spans)
        columns.append(b.noise() + moved + jump * SIGMA * (b.t >= spans[-1][1]))
    return b.record(*columns, b.noise())


@pytest.mark.parametrize("size", [15.0, 300.0, 1e4])
@pytest.mark.parametrize("span", [(300.0, 330.0), (0.0, 20.0), (570.0, 600.0)])
def test_n_is_that_of_the_rest_wherever_the_board_is_moved(bench, span, size):
    found = explain(record(bench(710, 600.0), [span], size)).axes
    for axis in ("gx", "gy", "gz"):
        (motion,) = found[axis].effects
        assert motion.kind == "motion"
        assert motion.axes == ("gx", "gy", "gz")
        begin, length = (motion.parameters[name].value for name in ("time", "duration"))
        assert begin == pytest.approx(span[0], abs=1.0)
        assert begin + length == pytest.approx(span[1], abs=1.0)
        assert found[axis].coefficients_after["N"].value == pytest.approx(4e-3, rel=0.03)
        assert found[axis].after.chi2_per_dof < 3.0
    assert not found["ax"].effects


def test_a_new_attitude_is_one_step_within_it(bench):
    jumps = (400.0, -20.0, 0.0)
    found = explain(record(bench(711, 600.0), [(300.0, 330.0)], 100.0, jumps)).axes
    kinds = [[effect.kind for effect in one.effects] for one in found.values()]
    assert [sorted(some) for some in kinds] == [
        ["motion", "step"], ["motion", "step"], ["motion"], []
    ]  # fmt: skip
    for axis, jump in zip(found, jumps[:2], strict=False):
        (step,) = (effect for effect in found[axis].effects if effect.kind == "step")
        assert step.parameters["size"].value == pytest.approx(jump * SIGMA, rel=0.03)
        assert 300.0 < step.parameters["time"].value < 330.0


def test_what_lies_between_a_motion_and_an_end_of_the_record_goes_with_it(bench):
    found = explain(record(bench(715, 600.0), [(3.0, 20.0)], 100.0)).axes["gx"]
    (motion,) = found.effects
    assert motion.evidence["end"] == "first"
    assert motion.parameters["time"].value == 0.0


def test_several_motions_are_several(bench):
    spans = [(0.0, 15.0), (200.0, 212.0), (400.0, 425.0)]
    found = explain(record(bench(712, 600.0), spans, 100.0)).axes["gy"]
    assert [effect.kind for effect in found.effects] == ["motion"] * 3
    begins = sorted(effect.parameters["time"].value for effect in found.effects)
    assert begins == pytest.approx([0.0, 200.0, 400.0], abs=1.0)


def test_a_record_that_is_moved_for_a_third_of_its_time_is_left_as_it_is(bench):
    found = explain(record(bench(713, 600.0), [(250.0, 430.0)], 100.0)).axes["gx"]
    assert "motion" not in {effect.kind for effect in found.effects}


def test_means_of_a_second_tell_motion_too(bench):
    """Between rows so far apart the board turns in any direction: they are white."""
    b = bench(714, 2500.0)
    quiet = b.record(*(b.noise() for _ in range(4)))
    rows = quiet.values[::52]
    turns = 100 * SIGMA * b.rng.normal(size=(8, 3))
    rows[1500:1508, :3] += turns
    slow = replace(
        quiet, rate_hz=1.0, values=rows,
        temperature_c=np.full(len(rows), np.nan), start_s=np.arange(len(rows), dtype=float),
        segments=np.array([[0, len(rows)]], np.int64),
    )  # fmt: skip
    found = explain(slow).axes
    assert [[e.kind for e in found[axis].effects] for axis in ("gx", "gy", "gz", "ax")] == [
        ["motion"], ["motion"], ["motion"], []
    ]  # fmt: skip


def rows_of(make, seed=1, size=30_000):
    """Return where two axes at 100 Hz are moved, 2000 rows of which `make` makes."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(2, size))
    rows[:, 9_000:11_000] += make(rng, np.arange(2_000) / 100.0)
    axes = {name: (x, blocks_of(x, 100.0, 0.0)) for name, x in zip("xy", rows, strict=True)}
    return [(one.first, one.stop) for one in find_moved_rows(axes, 100.0)]


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("louder noise", lambda rng, t: rng.normal(0, 30, (2, len(t)))),
        ("vibration", lambda rng, t: 30 * np.sin(2 * np.pi * 17 * t + rng.uniform(0, 6, (2, 1)))),
        ("another level", lambda rng, t: np.full((2, 1), 100.0)),
        ("hops on one axis", lambda rng, t: [[30.0], [0.0]] * np.sign(np.sin(3 * t))),
        ("a shock", lambda rng, t: np.where(t < 4, 50 * np.sin(5 * t), 0.0)),
    ],
)
def test_what_is_no_motion_is_left(name, make):
    del name
    assert rows_of(make) == []


def test_pauses_belong_to_a_motion():
    (found,) = rows_of(lambda rng, t: np.where((t > 9) & (t < 12), 0.0, 50 * np.sin(5 * t)))
    assert found == pytest.approx((9_000, 11_000), abs=20)
