"""The bounded memory of a run keeps means, times and segments right whatever happens to it."""

import copy
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.history import History


def pieces(data, cuts):
    """Split an array at the given places."""
    return np.split(data, sorted(min(cut, len(data)) for cut in cuts))


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 300), st.lists(st.integers(0, 300), max_size=6))
def test_any_split_into_blocks_gives_the_same_rows(samples, cuts):
    data = np.random.default_rng(samples).integers(-30000, 30000, (samples, 2)).astype(np.int16)
    whole, split = History(2, rows=16), History(2, rows=16)
    whole.update(data)
    for piece in pieces(data, cuts):
        split.update(piece)
    assert whole.stride == split.stride
    np.testing.assert_array_equal(whole.means(), split.means())


def test_rows_are_the_means_of_consecutive_samples_and_never_more_than_allowed():
    data = np.arange(1000.0)[:, np.newaxis]
    history = History(1, rows=64)
    history.update(data)
    rows = history.means()
    stride = history.stride
    assert len(rows) <= 64
    assert stride == 16
    expected = data[: len(rows) * stride, 0].reshape(-1, stride).mean(axis=1)
    np.testing.assert_allclose(rows[:, 0], expected)


def test_no_row_spans_a_gap_and_time_goes_on_through_it():
    history = History(1, rows=32)
    history.update(np.zeros((5, 1)))
    history.gap(lost=95)
    history.update(np.ones((7, 1)))
    record = history.record(10.0, ("gx",), (1.0,))
    assert record.segments.tolist() == [[0, 5], [5, 12]]
    assert record.start_s[5] == pytest.approx(10.0)
    assert set(record.values[:, 0]) == {0.0, 1.0}


def test_halving_keeps_segments_apart():
    history = History(1, rows=8)
    for level in range(4):
        history.update(np.full((10, 1), float(level)))
        history.gap(lost=0)
    assert set(history.means()[:, 0]) <= {0.0, 1.0, 2.0, 3.0}


def test_temperature_is_averaged_where_there_is_one():
    history = History(1, rows=4)
    history.update(np.zeros((8, 1)), np.array([20.0, np.nan, 22.0, 24.0, *[np.nan] * 4]))
    record = history.record(1.0, ("gx",), (1.0,))
    np.testing.assert_array_equal(record.temperature_c, [20.0, 23.0, np.nan, np.nan])


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 200), st.integers(0, 9), st.booleans()), max_size=8),
    st.sampled_from([np.int16, np.float64]),
)
def test_rows_are_the_means_of_their_own_samples_and_temperatures(pieces, dtype):
    """Whatever was cut, lost or halved: each row covers `stride` samples from `start_s` on."""
    rng = np.random.default_rng(len(pieces))
    history, stream, warmth = History(2, rows=16), np.empty((0, 2)), np.empty(0)
    for samples, lost, has_gap in pieces:
        counts = (100.0 * rng.normal(size=(samples, 2))).astype(dtype)
        temperature_c = rng.normal(25.0, 9.0, samples)
        history.update(counts, temperature_c)
        stream, warmth = np.vstack([stream, counts]), np.append(warmth, temperature_c)
        if has_gap:
            history.gap(lost)
            stream = np.vstack([stream, np.full((lost, 2), np.nan)])
            warmth = np.append(warmth, np.full(lost, np.nan))
    record = history.record(1.0, ("gx", "ax"), (1.0, 1.0))
    covered = record.start_s.astype(int)[:, np.newaxis] + np.arange(record.stride)
    expected = stream[covered].mean(axis=1)
    np.testing.assert_allclose(record.values, expected, rtol=1e-12, atol=1e-12)
    expected = warmth[covered].mean(axis=1)
    np.testing.assert_allclose(record.temperature_c, expected, rtol=1e-12)


def test_equal_temperatures_have_no_other_mean():
    history = History(1, rows=8)
    history.update(np.zeros((1000, 1), np.int16), np.full(1000, 25.3))
    assert history.stride > 100
    assert set(history.record(1.0, ("gx",), (1.0,)).temperature_c) == {25.3}


def test_rows_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="3 temperatures of 4 samples"):
        History(1, rows=4).update(np.zeros((4, 1)), np.zeros(3))
    with pytest.raises(ValueError, match=r"need samples of shape \(n, 2\)"):
        History(2, rows=4).update(np.zeros((4, 3)))


def test_coarsened_rows_are_means_within_their_segments():
    rng = np.random.default_rng(4)
    history = History(2, rows=1 << 12)
    for samples, lost in ((700, 9), (3, 40), (1200, 0)):
        history.update(rng.normal(size=(samples, 2)), np.full(samples, 25.0))
        history.gap(lost)
    whole = history.record(104.0, ("gx", "ax"), (0.5, 2.0))
    thinned = whole.coarsened(128)
    assert whole.stride == 1
    assert thinned.stride == 16
    assert thinned.rate_hz == 104.0 / 16
    assert (thinned.segments == [[0, 43], [43, 118]]).all()
    for first, last in ((0, 43), (43, 118)):
        begin = 0 if first == 0 else 703
        rows = whole.values[begin : begin + 16 * (last - first)].reshape(-1, 16, 2).mean(axis=1)
        np.testing.assert_allclose(thinned.values[first:last], rows, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(
            thinned.start_s[first:last], whole.start_s[begin : begin + 16 * (last - first) : 16]
        )
    assert (thinned.temperature_c == 25.0).all()
    assert whole.coarsened(len(whole.values)) is whole


def test_a_copy_goes_on_as_the_history_that_it_was_made_of():
    data = np.random.default_rng(3).integers(-900, 900, (70_000, 2)).astype(np.int16)
    history = History(2, rows=1 << 16)
    history.update(data[:40_000])
    other = copy.deepcopy(history)
    assert len(other._sums) == 40_000
    for one in (history, other):
        one.update(data[40_000:])
    first, second = (one.record(10.0, ("gx", "gy"), (1.0, 1.0)) for one in (history, other))
    assert first.stride == 2
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.start_s, second.start_s)
    np.testing.assert_array_equal(first.segments, second.segments)


MEMORY = """
from pathlib import Path
import numpy as np
from allanscope.history import History

def resident_mb():
    text = Path("/proc/self/status").read_text()
    return float(text.partition("RssAnon:")[2].split()[0]) / 1024.0

samples = np.ones((1 << 17, 6), np.int16)
empty = resident_mb()
history = History(6, rows=1 << 20)
for _ in range(8):
    history.update(samples)
full = resident_mb() - empty
history.update(samples[:1])
assert history.stride == 2
print((resident_mb() - empty) / full)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="read from /proc")
def test_half_of_the_rows_take_half_of_the_memory():
    # In a process of its own: one that has freed memory takes none for the rows.
    ran = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True)
    assert float(ran.stdout) < 0.7
