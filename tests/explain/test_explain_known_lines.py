"""A line that one axis shows is found on another on which it is too faint to be searched for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.explain import explain
from allanscope.explain.effects.sinusoid import Sinusoid
from allanscope.explain.moves.add_known_lines import lines_of_others
from allanscope.explain.series import series_of
from allanscope.explain.view import View

SIGMA = 4e-3 * 52.0**0.5


def size_of(nats: float, b) -> float:
    """Return the amplitude of a line that gains so much over white noise."""
    return SIGMA * (4 * nats / len(b.t)) ** 0.5


def lines(explanation, axis: str) -> list[float]:
    found = (e for e in explanation.axes[axis].effects if e.kind == "sinusoid")
    return sorted(e.parameters["frequency"].value for e in found)


def test_a_line_is_found_on_the_axes_that_have_it_and_on_no_other(bench):
    """At any frequency 17.7 nats are needed, at one that is known 7.6."""
    found, alone = 0, 0
    for seed in range(8):
        b = bench(7000 + seed)
        wave = np.sin(2 * np.pi * 7.1234 * b.t)
        loud, faint = (b.noise() + size_of(nats, b) * wave for nats in (200.0, 14.5))
        whole = explain(b.record(loud, faint, b.noise()))
        assert lines(whole, "gx") == pytest.approx([7.1234], abs=1e-3)
        assert lines(whole, "gz") == []
        own = [e for e in whole.axes["gy"].effects if e.kind == "sinusoid"]
        found += len(own)
        alone += all(step.move != "add known line" for step in whole.axes["gy"].path)
        for line in own:
            assert line.axes == ("gx", "gy")
            assert line.parameters["frequency"].value == pytest.approx(7.1234, abs=1e-3)
            assert line.parameters["amplitude"].value == pytest.approx(size_of(14.5, b), rel=0.5)
    assert found >= 6
    assert alone <= 3


def test_a_line_that_wanders_is_found_on_another_axis_too(bench):
    """Its width is that of the loud one; by itself half of eight of 0.06 sigma are not found."""
    found = by_itself = 0
    for seed in range(8):
        b = bench(7100 + seed)
        phi = np.exp(-np.pi * 0.05 / 52.0)
        e = (1 - phi**2) ** 0.5 * (b.rng.normal(size=len(b.t)) + 1j * b.rng.normal(size=len(b.t)))
        wave = np.real(lfilter([1], [1, -phi], e) * np.exp(2j * np.pi * 7.1234 * b.t))
        loud, faint = (b.noise() + times * SIGMA * wave for times in (0.3, 0.06))
        whole = explain(b.record(loud, faint, b.noise()))
        (known,) = whole.axes["gx"].effects
        assert whole.axes["gz"].effects == ()
        own = whole.axes["gy"].effects
        found += len(own)
        by_itself += all(step.move != "add known line" for step in whole.axes["gy"].path)
        for line in own:
            assert line.axes == known.axes == ("gx", "gy")
            size = line.parameters["sigma"]
            assert size.value == pytest.approx(0.06 * SIGMA, rel=0.5)
            assert size.lower < 0.06 * SIGMA < size.upper
    assert found >= 5
    assert by_itself <= 4


def test_no_axis_is_asked_for_a_line_that_it_has(bench):
    """Nor for what a wider band of its own holds, nor twice for what two others have."""
    b = bench(7010)
    wave = 0.2 * SIGMA * np.sin(2 * np.pi * 7.1234 * b.t)
    drifting = 0.2 * SIGMA * np.sin(2 * np.pi * 7.1234 * b.t + np.sin(b.t / 100))
    found = explain(b.record(b.noise() + wave, b.noise() + wave, b.noise() + drifting, b.noise()))
    held = {axis: found.held.accepted[axis] for axis in found.axes}
    assert any(isinstance(c.effect, Sinusoid) for c in held["gx"])
    assert {len(lines(found, axis)) for axis in ("gx", "gy")} == {1}
    assert all(
        step.move != "add known line"
        for axis in ("gx", "gy", "gz")
        for step in found.axes[axis].path
    )
    assert lines_of_others({}) == {}


def test_no_axis_is_asked_within_a_range_that_is_left_out_of_its_fit(bench):
    """The power there is counted with the range already: chi-square rose from 0.9 to 7.9."""
    b = bench(7020)
    line = 0.2 * SIGMA * np.sin(2 * np.pi * 7.1234 * b.t)
    series = series_of(b.record(b.noise() + line, b.noise()))
    loud, other = View.of(series, "gx"), View.of(series, "gy")
    loud = loud.accept(next(iter(Sinusoid.propose(loud))))
    assert [*lines_of_others({"gx": loud, "gy": other})] == ["gy"]
    assert lines_of_others({"gx": loud, "gy": other.without_range(6.0, 8.0)}) == {}
