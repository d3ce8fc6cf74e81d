"""The decimated time series: right values, right times, whatever the block sizes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.samples import Block, Gap, StreamInfo, Ticks
from allanscope.view.decimator import Decimator, Rows

INFO = StreamInfo(("gx", "az"), (0.5, 2.0), nominal_hz=100.0)


def block(counts, host_s=None, temperature=None):
    n = 1 if host_s is not None or temperature is not None else 0
    full = np.full(n, np.nan)
    ticks = Ticks(
        np.zeros(n, np.int64),
        full,
        full if host_s is None else np.array([host_s]),
        full if temperature is None else np.array([temperature]),
    )
    return Block(0, np.asarray(counts, np.int16).reshape(-1, 2), ticks)


@settings(deadline=None)
@given(st.lists(st.integers(0, 97), min_size=1, max_size=30), st.integers(1, 5))
def test_rows_do_not_depend_on_how_the_samples_were_cut(cuts, rows):
    rng = np.random.default_rng(5)
    counts = rng.integers(-3000, 3000, (sum(cuts), 2)).astype(np.int16)
    decimator = Decimator()
    out = []
    for piece in np.split(counts, np.cumsum(cuts)[:-1]):
        part = decimator.update(INFO, block(piece), rows)
        if part is not None:
            assert len(part.elapsed_s) >= rows
            out.append(part)
    if not out:
        assert len(counts) < (rows + 1) * 10 + 97
        return
    joined = Rows.joined(out)
    n = len(joined.elapsed_s)
    cut = counts[: n * 10].reshape(n, 10, 2)
    np.testing.assert_allclose(joined.mean, cut.mean(axis=1) * [0.5, 2.0])
    np.testing.assert_array_equal(joined.low, cut.min(axis=1) * [0.5, 2.0])
    np.testing.assert_array_equal(joined.high, cut.max(axis=1) * [0.5, 2.0])
    np.testing.assert_allclose(joined.elapsed_s, 0.05 + 0.1 * np.arange(n), atol=1e-9)


def test_a_spike_of_one_sample_is_never_lost():
    decimator = Decimator()
    counts = np.zeros((100, 2), np.int16)
    counts[37, 0] = 32000
    rows = decimator.update(INFO, block(counts))
    assert rows.high[3, 0] == 16000.0
    assert rows.high[:, 0].sum() == 16000.0


def test_a_gap_of_known_length_moves_the_time_and_no_row_spans_it():
    decimator = Decimator()
    decimator.update(INFO, block(np.ones((15, 2))))
    decimator.gap(Gap("link", 85))
    rows = decimator.update(INFO, block(np.full((20, 2), 7)))
    np.testing.assert_allclose(rows.elapsed_s, [1.05, 1.15])
    np.testing.assert_array_equal(rows.low, [[3.5, 14.0]] * 2)


def test_after_a_gap_of_unknown_length_the_host_clock_tells_the_time():
    decimator = Decimator()
    decimator.update(INFO, block(np.ones((20, 2)), host_s=500.0))
    decimator.gap(Gap("disconnected", None))
    rows = decimator.update(INFO, block(np.ones((20, 2)), host_s=560.0))
    np.testing.assert_allclose(rows.elapsed_s, [60.05, 60.15])


def test_without_a_rate_nothing_is_drawn_until_a_result_brings_it():
    decimator = Decimator()
    silent = StreamInfo(("gx", "az"), (0.5, 2.0))
    assert decimator.update(silent, block(np.ones((500, 2)))) is None
    decimator.rate(50.0, elapsed_s=10.0)
    rows = decimator.update(silent, block(np.ones((10, 2))))
    np.testing.assert_allclose(rows.elapsed_s, [10.05, 10.15])


def test_the_last_temperature_stays_until_the_next():
    decimator = Decimator()
    rows = decimator.update(INFO, block(np.ones((20, 2)), temperature=31.5))
    assert rows.temperature_c == 31.5
    rows = decimator.update(INFO, block(np.ones((20, 2)), host_s=1.0))
    assert rows.temperature_c == 31.5


def test_new_columns_begin_a_new_row():
    decimator = Decimator()
    decimator.update(INFO, block(np.ones((15, 2))))
    decimator.restart()
    other = StreamInfo(("gx",), (0.5,), nominal_hz=100.0)
    rows = decimator.update(other, Block(15, np.ones((20, 1), np.int16), Ticks.none()))
    assert rows.mean.shape == (2, 1)
    np.testing.assert_allclose(rows.elapsed_s, [0.2, 0.3])


def test_slow_streams_keep_every_sample():
    decimator = Decimator()
    slow = StreamInfo(("gx", "az"), (1.0, 1.0), nominal_hz=12.5)
    rows = decimator.update(slow, block(np.arange(8)), rows=4)
    np.testing.assert_array_equal(rows.mean, np.arange(8).reshape(4, 2))
    assert rows.elapsed_s == pytest.approx([0.04, 0.12, 0.20, 0.28])
