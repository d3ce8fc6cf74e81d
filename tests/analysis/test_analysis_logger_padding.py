"""Equal rows at an end of a record are a logger's padding: named, and left out."""

from __future__ import annotations

import numpy as np
import pytest

import allanscope
from allanscope.analysis.logger_padding import Padding

RATE, N = 100.0, 5e-3
SIGMA = N * RATE**0.5


def noise(rows=8000, seed=1, step=1e-4):
    rng = np.random.default_rng([seed, 31])
    x = rng.normal(0.3, SIGMA, (rows, 3)) + 0.5 * (np.arange(rows) >= 5000)[:, np.newaxis]
    return np.round(x / step) * step


def analysed(rows):
    return allanscope.analyse(rows, RATE, axes=["gx", "gy", "gz"], units="dps")


def padding_of(result):
    return [remark for remark in result.remarks if "padding" in remark]


@pytest.mark.parametrize("value", [0.0, 0.125])
@pytest.mark.parametrize("end", ["first", "last"])
def test_padding_is_named_and_nothing_else_comes_of_it(end, value):
    rows, same = noise(), np.full((200, 3), value)
    result = analysed(np.concatenate([same, rows] if end == "first" else [rows, same]))
    (remark,) = padding_of(result)
    what = "the same row" if value else "zero"
    assert f"The {end} 2 s (200 rows) are {what} on every axis" in remark
    for axis in result.axes.values():
        (step,) = axis.explanation.effects
        assert step.kind == "step"
        time = step.parameters["time"]
        assert time.value == pytest.approx(50.0, abs=0.02)
        assert axis.coefficients["N"].value == pytest.approx(N, rel=0.04)
        assert axis.curves["oadev"].deviation[0] == pytest.approx(SIGMA, rel=0.03)


def test_a_run_of_equal_rows_within_a_record_stays_in_it():
    rows = noise()
    rows[3000:3200] = 0.0
    assert padding_of(analysed(rows)) == []


def test_one_axis_that_stands_still_is_no_padding():
    rows = noise()
    rows[-200:, 1] = 0.0
    assert padding_of(analysed(rows)) == []


def test_rows_that_are_equal_by_chance_are_no_padding():
    rng = np.random.default_rng(32)
    rows = np.round(rng.normal(0, 0.16, (8000, 3)))  # nearly all are 0
    rows[-70:] = 0.0
    assert padding_of(analysed(rows)) == []


def test_a_channel_that_never_moves_is_not_padding_from_end_to_end():
    result = analysed(np.ones((8000, 3)))
    assert padding_of(result) == []
    assert "constant" in result.axes["gx"].explanation.hindrance


def passed_on(padding, rows, size):
    """Return the rows that come out where they come in by so many at a time."""
    pieces = [rows[first : first + size] for first in range(0, len(rows), size)]
    passed = [counts.copy() for piece in pieces for counts, _ in padding.feed(piece, None)]
    return np.concatenate(passed)


@pytest.mark.parametrize("size", [7, 99, 100, 1000, 9000])
def test_what_is_left_out_at_the_end_does_not_depend_on_the_pieces(size):
    rows = np.concatenate([noise(600), np.zeros((150, 3))])
    padding = Padding()
    assert np.array_equal(passed_on(padding, rows, size), rows[:600])
    assert padding.trailing == 150


@pytest.mark.parametrize("size", [70, 220, 1000])
def test_both_ends_may_be_padded(size):
    rows = np.concatenate([np.zeros((150, 3)), noise(600), np.zeros((150, 3))])
    padding = Padding()
    kept = passed_on(padding, rows, size)
    if size > 150 + 64:  # what follows must show how seldom rows are equal
        assert np.array_equal(kept, rows[150:-150])
    assert np.array_equal(kept[-600:], rows[150:-150])


def test_what_waits_comes_back_when_the_record_goes_on():
    rows = noise(600)
    rows[300:400] = 0.0
    padding = Padding()
    pieces = [rows[:350], rows[350:400], rows[400:]]
    passed = [counts.copy() for piece in pieces for counts, _ in padding.feed(piece, None)]
    assert np.array_equal(np.concatenate(passed), rows)
    assert not padding.is_padding
