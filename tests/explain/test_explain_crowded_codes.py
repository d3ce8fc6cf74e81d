"""Uneven and missing codes of a converter are neither saturation nor a dead zone."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.explain.crowded_codes import crowded_codes, missing_codes
from allanscope.explain.values import step_of
from support.measured import analysed

SIGMA = 4e-3 * 52.0**0.5
STEP = SIGMA / 0.65


def without_a_code(noise, code, step=STEP):
    """Round to a lattice on which a code is missing: its width goes to both beside it."""
    codes = np.round(noise / step)
    return step * np.where(codes == code, code + np.sign(noise / step - code), codes)


def found_on(b, column, step):
    return explain(b.record(column, lsb=step)).axes["gx"]


@pytest.mark.parametrize("offset", [0.0, 0.3])
@pytest.mark.parametrize("code", [2, -2])
def test_the_last_code_beside_a_missing_one_is_no_limit(bench, code, offset):
    b = bench(510, 120.0)
    column = without_a_code(b.noise() + np.sign(code) * offset * STEP, code)
    column = np.clip(column, -3 * STEP, 3 * STEP)  # or one sample farther out hides the end
    found = found_on(b, column, STEP)
    assert "saturation" not in [effect.kind for effect in found.effects]
    (remark,) = [one for one in found.remarks if "missing code" in one]
    assert f"no sample is {code * STEP:.6g} dps" in remark


def test_a_limit_at_which_the_rest_is_collected_is_found_beside_a_missing_code(bench):
    b = bench(511, 120.0)
    column = without_a_code(np.minimum(b.noise(), 0.4 * SIGMA), -1, SIGMA / 5)
    kinds = [effect.kind for effect in found_on(b, column, SIGMA / 5).effects]
    assert kinds == ["saturation"]


def test_an_even_lattice_misses_nothing(bench):
    b = bench(512, 120.0)
    for noise_in_steps in (0.1, 0.3, 0.65, 1.0, 3.0):
        step = SIGMA / noise_in_steps
        rounded = np.round((b.noise() + 0.3 * step) / step) * step
        hops = np.round((b.noise() + b.telegraph(step, 5.0)) / step) * step
        assert missing_codes(rounded, step) == missing_codes(hops, step) == ()


def test_codes_printed_in_another_unit_keep_their_step_beside_a_missing_one():
    rng = np.random.default_rng(513)
    codes = np.round(rng.normal(-9.0, 0.65, 5000))
    codes = np.where(codes == -8, codes + np.sign(rng.normal(size=5000)), codes)
    printed = np.round(2.93 * codes) / 1e3
    step = step_of(printed, 1e-3)
    assert step == pytest.approx(2.93e-3, rel=0.08)
    assert len(missing_codes(printed, step)) == 1


@pytest.mark.parametrize("seed", range(520, 524))
def test_a_code_a_little_wide_or_in_a_tail_is_no_dead_zone(bench, seed):
    b = bench(seed, 120.0)
    step = SIGMA / 8
    width = 1 + 0.15 * np.sign(np.sin(np.pi * (np.arange(-60, 61) + 0.5)))  # every second code
    width[60 + 16] = 2.3  # and one in a tail
    edges = np.concatenate([[0.0], np.cumsum(width)])
    edges = (edges - edges[60]) * step
    column = (np.searchsorted(edges, b.noise()) - 61) * step
    assert [effect.kind for effect in found_on(b, column, step).effects] == []


def test_a_dead_zone_that_holds_a_per_cent_is_still_a_pile():
    rng = np.random.default_rng(525)
    noise = rng.normal(0, 10, 20_000)
    noise[np.abs(noise) < 1.5] = 0.0
    (pile,) = crowded_codes(np.round(noise), 1.0)
    assert pile.side == 0
    assert pile.value == 0.0


def test_actigraph_measured_has_a_missing_code_on_every_axis_and_no_limit():
    result = analysed("actigraph-table")
    for axis, at in (("ax", "0.038"), ("ay", "-0.0235"), ("az", "-0.965")):
        found = result.axes[axis].explanation
        assert "saturation" not in [effect.kind for effect in found.effects]
        assert any(f"no sample is {at} g" in remark for remark in found.remarks)


def test_fan_off_measured_has_no_dead_zone():
    result = analysed("ism330dhcx-fan-off")
    words = [effect.evidence["words"] for effect in result.axes["ax"].explanation.effects]
    assert not any("dead zone" in one for one in words)


def _white(rng, n):
    return rng.normal(size=n)


def _louder_in_a_tenth(rng, n):
    return rng.normal(size=n) * np.where(rng.random(n) < 0.1, 3.0, 1.0)


def _on_a_line(rng, n):
    return rng.normal(size=n) + 5 * np.sin(0.1 * np.arange(n))


def _between_two_levels(rng, n):
    return rng.normal(size=n) + 10.0 * (rng.random(n) < 0.5)


def _with_heavy_tails(rng, n):
    return rng.laplace(size=n)


def _without_its_top(rng, n):
    noise = rng.normal(size=2 * n)
    return noise[noise < 1.2][:n]


SHAPES = (
    *(_white, _louder_in_a_tenth, _on_a_line, _between_two_levels, _with_heavy_tails),
    _without_its_top,
)


@pytest.mark.parametrize("shape", SHAPES)
def test_no_distribution_ends_at_a_limit_on_a_coarse_lattice(shape):
    rng = np.random.default_rng(514)
    for steps in (1.0, 1.6, 2.4, 4.0, 7.0):
        for n in (2_000, 20_000, 200_000):
            samples = np.round(steps * shape(rng, n) + rng.uniform(-0.5, 0.5))
            assert crowded_codes(samples, 1.0) == (), (steps, n)


@pytest.mark.parametrize("steps", [2.4, 3.0, 4.0])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_limit_in_the_tail_is_found_though_the_code_beside_it_holds_more(steps, side):
    rng = np.random.default_rng(515)
    limit = np.round(2.05 * steps)  # cuts 2 %
    samples = side * np.minimum(np.round(steps * rng.normal(size=200_000)), limit)
    beside, last = (np.count_nonzero(side * samples == limit - k) for k in (1, 0))
    (crowded,) = crowded_codes(samples, 1.0)
    assert (crowded.value, crowded.side) == (side * limit, side)
    assert last < 1.2 * beside or steps > 3


@pytest.mark.parametrize(("steps", "share"), [(1.6, 0.08), (2.3, 0.03), (2.5, 0.01), (3.5, 0.006)])
def test_a_limit_is_found_at_which_a_tail_has_not_begun_to_rise(steps, share):
    """The last code holds less than those beside it; they tell how little it held."""
    rng = np.random.default_rng(516)
    for _ in range(5):
        noise = steps * rng.normal(size=30_000) + rng.uniform(0, 1)
        limit = np.round(np.quantile(noise, 1 - share))
        (crowded,) = crowded_codes(np.minimum(np.round(noise), limit), 1.0)
        assert (crowded.value, crowded.side) == (limit, 1)


@pytest.mark.parametrize("digits", [3, 6])
@pytest.mark.parametrize("off", [1e-9, 1e-6])
def test_digits_that_text_has_more_of_near_zero_leave_no_code_crowded(digits, off):
    """Counts that were scaled in floating point, and printed: 0 becomes many values, 1 does not."""
    rng = np.random.default_rng(7)
    for level in (0.0, 0.6, 1.05):
        counts = np.round(rng.normal(level, 1.5, 30_000))
        values = 8.75e-3 * counts + rng.normal(0, off, len(counts))
        printed = np.array([float(f"{value:.{digits}g}") for value in values])
        assert crowded_codes(printed, step_of(printed, 1.0)) == ()


def test_a_pile_among_values_without_a_step_is_crowded():
    noise = np.random.default_rng(8).normal(size=10_000)
    piled = np.where(np.abs(noise - 0.5) < 0.1, 0.5, noise)
    (found,) = crowded_codes(piled, 0.0)
    assert (found.value, found.side) == (0.5, 0)


def test_codes_that_a_correction_spreads_over_some_values_are_not_crowded():
    """As of an IMU that compensates temperature in fixed point: 77, 78 and 79, then 154 to 156."""
    rng = np.random.default_rng(9)
    codes = np.round(rng.normal(0.3, 1.4, 36_000))
    most = np.where(codes == 1, 0.6, 0.45)  # of one code at one value, of the others less
    chance = rng.random(len(codes))
    corrected = 77 * codes + (chance > 0.2) + (chance > 0.2 + most)
    assert crowded_codes(corrected, 1.0) == ()
    (pile,) = crowded_codes(np.where(rng.random(len(codes)) < 0.5, corrected, 80.0), 1.0)
    assert (pile.value, pile.side) == (80.0, 0)
