"""What the named parts of a model leave over: found where it is, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from allanscope.noise.components import Flicker, LineProfile, Ramp, RandomWalk, White
from allanscope.noise.evidence import Ordinates
from allanscope.noise.filters import Remainder
from allanscope.noise.grid import grid_of
from allanscope.noise.likelihood import Likelihood
from allanscope.noise.model import NoiseModel
from allanscope.noise.remainder import smooth_log_ratio, with_remainder
from allanscope.noise.selection import textbook
from allanscope.noise.transfer import response

RATE = 100.0
GRID = grid_of(200_000, RATE)
MODEL = NoiseModel((White(4e-3), Flicker(5e-4), RandomWalk(1e-4)), 1 / RATE)


def evidence(rng, factor=1.0, line=None):
    """Draw the binned powers of a record whose density is a factor times that of the model."""
    expected = sum(GRID.column(part) for part in MODEL) * factor
    power = expected * rng.chisquare(GRID.count) / GRID.count
    if line is not None:
        power = power + GRID.column(line)
    return Ordinates(GRID, power, GRID.count)


def fitted(part):
    return Likelihood([part]).amplitudes(textbook(1 / RATE, None))


def test_a_clean_record_leaves_nothing_over():
    rng = np.random.default_rng(1)
    for _ in range(200):
        fit = fitted(evidence(rng))
        assert with_remainder(fit, fit.likelihood.evidence) is fit


def test_a_shelf_is_described_and_leaves_n_alone():
    rng = np.random.default_rng(2)
    f = GRID.centre
    shelf = np.where((f > 15) & (f < 30), 1.2, 1.0)
    part = evidence(rng, shelf)
    bare = fitted(part)
    fit = with_remainder(bare, (part,))
    assert abs(bare.model.value("N") / 4e-3 - 1) > 0.02
    assert fit.model.value("N") == pytest.approx(4e-3, rel=0.01)
    remainder = fit.model.get("remainder")
    assert remainder is not None
    found = remainder.response(np.array([5.0, 22.0, 45.0]), 1 / RATE)
    np.testing.assert_allclose(found, [1.0, 1.2, 1.0], atol=0.04)


def test_a_rising_floor_leaves_n_where_it_is_read():
    rng = np.random.default_rng(3)
    part = evidence(rng, 1 + 8 / (1 + (20 / GRID.centre) ** 6))
    assert fitted(part).model.value("N") > 1.5 * 4e-3
    fit = with_remainder(fitted(part), (part,))
    assert fit.model.value("N") == pytest.approx(4e-3, rel=0.03)


def test_a_line_within_it_is_what_is_left_of_the_power_that_was_measured():
    rng = np.random.default_rng(5)
    f = GRID.centre
    shelf = np.where((f > 15) & (f < 30), 1.2, 1.0)
    line = LineProfile(0.04, 17.0, 24.0, (0.1, 0.3, 0.4, 0.2))
    part = evidence(rng, shelf, line)
    noise = 0.2 * MODEL.density((line.edges[1:] + line.edges[:-1]) / 2)
    measured = line.with_more(noise)  # over noise that is without the shelf
    bare = fitted(evidence(rng))
    bare = replace(bare, model=bare.model.plus(measured))
    fit = with_remainder(bare, (part,))
    expected = fit.likelihood.expected(fit.model)
    true = sum(GRID.column(one) for one in MODEL) * shelf + GRID.column(line)
    inside = (f > 17.5) & (f < 23.5)
    np.testing.assert_allclose(expected[inside] / true[inside], 1.0, atol=0.03)
    found = fit.model.get("drifting_line")
    assert isinstance(found, LineProfile)
    assert found.sigma == pytest.approx(0.04, rel=0.02)
    np.testing.assert_allclose(found.shares, line.shares, atol=0.03)


def test_a_line_with_its_profile_is_not_part_of_it():
    rng = np.random.default_rng(4)
    line = LineProfile(0.05, 8.0, 8.3, (0.2, 0.5, 0.3))
    part = evidence(rng, line=line)
    model = textbook(1 / RATE, None).plus(line)
    fit = Likelihood([part]).amplitudes(model)
    assert with_remainder(fit, (part,)) is fit
    assert fit.model.value("N") == pytest.approx(4e-3, rel=0.01)


def test_a_ramp_stands_beside_it():
    """It has no density that a factor could act on, and its Allan variance must stay."""
    bare = NoiseModel((White(4e-3), Ramp(1e-4)), 1 / RATE)
    both = bare.plus(Remainder((1.0, 10.0), (0.3, 0.0)))
    assert both.variance("avar", [200_000])[0] == pytest.approx(
        bare.variance("avar", [200_000])[0], rel=1e-3
    )


def test_too_few_bins_have_no_smooth_ratio():
    assert smooth_log_ratio(np.arange(1.0, 6.0), np.ones(5), np.ones(5)) is None


def test_a_deviation_knows_every_node():
    """A resonance at 10 Hz of noise at 100 Hz: averages over 3 and 4 samples see its flanks."""
    nodes, gain = (4.0, 9.0, 9.9, 10.1, 11.0, 18.0), (0.0, 2.0, 4.6, 4.6, 2.0, 0.0)
    model = NoiseModel((White(1.0),), dt=0.01, filters=(Remainder(nodes, gain),))
    m = np.array([1, 2, 3, 4, 6, 23, 64])
    f = (np.arange(400_000) + 0.5) * 50.0 / 400_000
    passed = [response("avar", 2 * np.pi * f / 100.0, k) for k in m]
    direct = [np.mean(model.density(f) * one) * 50.0 for one in passed]
    np.testing.assert_allclose(model.variance("avar", m), direct, rtol=1e-6)
