"""What is cut off at a limit is saturation, what collects within it is a dead zone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from allanscope.explain import explain
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import KINDS

SIGMA = 4e-3 * 52.0**0.5
SECONDS = 600.0
SEEDS = range(400, 403)


def of_three(bench, seed, change, **options):
    """Explain three axes of noise that was changed in the same way."""
    b = bench(seed, SECONDS)
    axes = explain(b.record(*(change(b.noise()) for _ in range(3)), **options)).axes
    return list(axes.values())


def names(found):
    return [effect.kind for effect in found.effects]


@pytest.mark.parametrize("at", [-0.5, 0.5, 1.6, 2.5])
@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_cut_off_on_one_side_is_saturation_and_not_repeats(bench, seed, at):
    limit = np.round(at * SIGMA / 4.375e-3) * 4.375e-3
    for found in of_three(bench, seed, lambda noise: np.minimum(noise, limit)):
        assert names(found) == ["saturation"]
        p = found.effects[0].parameters
        assert p["level"].value == pytest.approx(limit, abs=1e-6)
        assert p["side"].value == 1
        beyond = norm.sf((limit - 4.375e-3 / 2) / SIGMA)  # half a step below is rounded up to it
        five_sigma = 5 * np.sqrt(beyond / (SECONDS * 52.0))
        walk = 0.2 * beyond  # which moves the level by a twentieth of a sigma
        assert p["fraction"].value == pytest.approx(beyond, abs=five_sigma + walk)
        assert p["fraction"].lower <= p["fraction"].value <= p["fraction"].upper


def test_both_ends_are_named_each_with_its_level(bench):
    limit = np.round(1.6 * SIGMA / 4.375e-3) * 4.375e-3
    for found in of_three(bench, 403, lambda noise: np.clip(noise + 1, 1 - limit, 1 + limit)):
        assert names(found) == ["saturation", "saturation"]
        levels = sorted(e.parameters["level"].value for e in found.effects)
        assert levels == pytest.approx([1 - limit, 1 + limit], abs=4.4e-3)


def test_numbers_without_a_lattice_pile_up_all_the_same(bench):
    found = of_three(bench, 404, lambda noise: np.maximum(noise, -1.6 * SIGMA), lsb=1e-9)
    for axis in found:
        assert names(axis) == ["saturation"]
        assert axis.effects[0].parameters["side"].value == -1


@pytest.mark.parametrize("depth", [0.5, 1.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_dead_zone_has_its_level_and_width(bench, seed, depth):
    def dead(noise):
        return np.where(np.abs(noise - 0.4 * SIGMA) < depth * SIGMA, 0.4 * SIGMA, noise)

    for found in of_three(bench, seed, dead):
        assert names(found) == ["dead_zone"]
        p = found.effects[0].parameters
        assert p["level"].value == pytest.approx(0.4 * SIGMA, abs=4.4e-3)
        assert p["width"].lower <= 2 * depth * SIGMA <= p["width"].upper


def test_a_dead_zone_without_a_lattice_has_the_same_name(bench):
    for found in of_three(bench, 409, lambda x: np.where(np.abs(x) < SIGMA / 2, 0.0, x), lsb=1e-9):
        assert names(found) == ["dead_zone"]
        assert found.effects[0].parameters["width"].value == pytest.approx(SIGMA, rel=0.01)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_dead_zone_of_a_step_has_no_name_and_is_no_repeat(bench, seed):
    def dead(noise):
        return np.where(np.abs(noise) < 0.15 * SIGMA, 0.0, noise)

    for found in of_three(bench, seed, dead):
        assert not found.explained
        assert "unexplained" in names(found)
        assert not {"repeated_samples", "saturation", "dead_zone"} & set(names(found))


def test_what_was_cut_off_before_a_filter_is_lopsided_and_has_no_name(bench):
    def soft(noise):
        cut = np.minimum(noise, SIGMA)
        return (cut + np.roll(cut, 1)) / 2 + 1e-3 * np.sin(np.arange(len(cut)))

    for found in of_three(bench, 405, soft, lsb=1e-6):
        assert not found.explained
        assert "unexplained" in names(found)


@pytest.mark.parametrize("step", [0.3, 1.0, 1.4])
def test_coarse_and_skewed_levels_are_not_saturated(bench, step):
    b = bench(406, SECONDS)
    hops = b.telegraph(5 * SIGMA, 20.0)
    columns = [b.noise(), b.noise() + 0.37 * step * SIGMA, b.noise() + hops]
    for found in explain(b.record(*columns, lsb=step * SIGMA)).axes.values():
        assert "saturation" not in names(found)


@pytest.mark.parametrize("seed", [4, 6])
def test_neighbours_at_a_limit_behind_a_filter_are_no_repeats(bench, seed):
    """They are equal more often than far rows are: the filter keeps both beyond the limit."""
    b = bench(seed, 200.0)
    passed = lfilter([0.8], [1, -0.2], b.rng.normal(0, 0.0182, len(b.t)))
    limit = np.round(np.median(passed) / 4.375e-3) * 4.375e-3
    found = explain(b.record(np.minimum(passed, limit))).axes["gx"]
    assert names(found) == ["saturation", "band_limit"]


def test_repeats_of_a_row_are_still_repeats_beside_a_limit(bench):
    b = bench(407, SECONDS)
    rows = np.arange(len(b.t))
    rows[b.rng.random(len(b.t)) < 0.05] = 0
    rows = np.maximum.accumulate(rows)
    columns = [np.minimum(b.noise(), 1.6 * SIGMA)[rows], b.noise()[rows]]
    cut, free = explain(b.record(*columns)).axes.values()
    assert set(names(cut)) == {"saturation", "repeated_samples"}
    assert names(free) == ["repeated_samples"]


def test_decimals_of_a_step_that_is_none_are_no_repeats(bench):
    b = bench(408, SECONDS)
    printed = [np.round(np.round(b.noise() / 8.75e-3) * 8.75e-3, 2) for _ in range(3)]
    for column in printed:
        found = explain(b.record(column, lsb=0.01)).axes["gx"]
        assert not {"repeated_samples", "saturation"} & set(names(found))


def test_their_sizes_are_said_in_units_that_people_read():
    share, level = Estimate.exact(0.1), Estimate.exact(124.99, "dps")
    cut = KINDS["saturation"](level=level, side=Estimate.exact(1.0), fraction=share)
    assert "at the upper end, 125 dps:" in cut.words
    empty = KINDS["dead_zone"](Estimate.exact(0.03, "g"), Estimate.exact(1e-3, "g"), share)
    assert "dead zone of 1000 ug around 30.0 mg are replaced" in empty.words
    assert "step of 8.75 mdps" in KINDS["quantization"](Estimate.exact(8.75e-3, "dps"), 0.4).words
