"""Ranges without a name never take the whole spectrum out of the fit."""

from __future__ import annotations

import re

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.explain.effects.step import Step
from allanscope.explain.effects.unexplained import _bands, left_over, united
from allanscope.explain.gates import judge, refused
from allanscope.explain.series import series_of
from allanscope.explain.view import View
from allanscope.noise.components import Rounding


@pytest.fixture
def view(bench):
    b = bench(501, 120.0)
    return View.of(series_of(b.record(b.noise())), "gx")


def cut(view, low, high):
    return left_over(view, (low, high), 1e3, 0.1, "more power than the model")


def test_ranges_are_not_united_to_the_whole_spectrum(view):
    for low, high in ((1.0, 12.0), (15.0, 26.0)):
        view = view.accept(cut(view, low, high))
    rest, union = united(view, cut(view, 0.0, 11.0))
    after = rest.accept(union)
    assert after.spectrum.kept.mean() > 0.1
    assert np.all(after.spectrum.ordinates > 0)
    assert after.spectrum.model.value("N") == pytest.approx(4e-3, rel=0.15)


def test_a_range_that_leaves_nothing_to_fit_is_refused(view):
    view = view.accept(cut(view, 4.0, 26.0))
    refused, why = judge(view, cut(view, 0.0, 3.9))
    assert refused is None
    assert "nothing would be left to fit" in why
    allowed, _ = judge(view, cut(view, 0.5, 0.8))
    assert allowed is not None


@pytest.fixture
def long_view(bench):
    b = bench(502, 1000.0)
    return View.of(series_of(b.record(b.noise())), "gx")


def test_rounding_stays_in_the_model_beside_what_is_left_out(long_view):
    rest = long_view.without_range(8.0, 20.0)
    symbol = Rounding.symbol
    assert rest.model.get(symbol) == long_view.model.get(symbol) == Rounding(long_view.step)


def test_nothing_gains_where_all_that_would_know_is_left_out(long_view):
    rest = long_view.without_range(0.0, 20.0)
    at = np.arange(100, 50_000, 100)
    assert np.all(rest.scan.step(at) == 0)
    assert np.all(rest.scan.boxes(range(100, 50_000, 100), 100) == 0)
    assert np.all(long_view.scan.step(at) > 0)


def test_what_the_model_lacks_has_its_size(bench):
    """Noise between 7 and 9 Hz: a twentieth of the power of the whole, added there."""
    b = bench(503, 1000.0)
    f = np.fft.rfftfreq(len(b.t), b.t[1])
    spectrum = np.fft.rfft(b.rng.standard_normal(len(b.t))) * ((f > 7) & (f < 9))
    added = np.fft.irfft(spectrum, len(b.t))
    added *= 7e-3 / added.std()
    view = View.of(series_of(b.record(b.noise() + added)), "gx")
    (found,) = _bands(view)
    size = re.search(r"its rms is (\S+) mdps", found.effect.words)
    assert size is not None
    assert float(size[1]) == pytest.approx(7.0, rel=0.15)


def test_an_axis_of_which_a_few_samples_leave_one_code_is_searched(bench):
    """Taken for outliers, they left a constant, and the axis failed."""
    b = bench(741, 500.0)
    values = np.zeros(len(b.t))
    values[b.rng.choice(len(b.t), 15, replace=False)] = b.rng.choice([-1.0, 1.0], 15)
    found = explain(b.record(values, lsb=1.0))
    assert not found.axes["gx"].failure
    assert "outliers" not in [effect.kind for effect in found.axes["gx"].effects]


def test_a_step_that_the_level_does_not_have_is_refused(bench):
    """Without the low frequencies a jolt looks like a step: its edge is all that is fitted."""
    b = bench(503, 120.0)
    at, size = len(b.t) // 2, 0.5
    edge = np.zeros(len(b.t))
    edge[at : at + 16] = size * np.exp(-np.arange(16) / 4)  # is there, and gone
    for jump, has_place in ((edge, False), (size * (np.arange(len(b.t)) >= at), True)):
        rows = View.of(series_of(b.record(b.noise() + jump)), "gx").without_range(0.0, 5.0)
        (step,) = Step.propose(rows)
        assert step.excess > 0.0
        assert abs(step.effect.size.value / size) > 0.4
        assert bool(refused(rows, step)) is not has_place


@pytest.mark.parametrize("seed", range(504, 510))
def test_a_tone_that_is_left_out_says_nothing_of_a_step(bench, seed):
    """Its ordinates are far above the noise: what a step has there is nothing beside them."""
    b = bench(seed, 300.0)
    tone = 0.3 * np.sin(2 * np.pi * 0.2 * b.t + b.rng.uniform(0, 7))
    jump = 0.02 * (b.t >= 150.0)
    rows = View.of(series_of(b.record(b.noise() + tone + jump)), "gx").without_range(0.18, 0.22)
    (step,) = Step.propose(rows)
    assert not refused(rows, step)
