"""Scales and charts: where values land on the rectangle, and what is cut off."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from allanscope.view.chart import HEIGHT, WIDTH, Chart, Linear, Log, dashed

CHART = Chart(Log(-4, 4), Log(-1, 3), "s", "mdps")


def test_decades_hold_their_values_and_edges_open_no_further_decade():
    assert Log.around([1e-4, 1.0, 99.0]) == Log(-4, 2)
    assert Log.around([1e-3, 1e2]) == Log(-3, 2)
    assert Log.around([0.1 * 3 / 3 * (1 + 1e-15)]) == Log(-1, 0)
    assert Log.around([np.nan, -1.0, 0.0], least=3) == Log(0, 3)
    assert Log.around([5.0], least=3) == Log(0, 3)


def test_a_scale_needs_a_range():
    with pytest.raises(ValueError, match="low < high"):
        Log(2, 2)


def test_a_frame_only_grows():
    assert Log(-2, 1).union(Log(0, 3)) == Log(-2, 3)


def test_every_decade_has_a_label_until_there_are_too_many():
    labels = [label for _, label in Log(-4, 2).ticks() if label]
    assert labels == ["10⁻⁴", "10⁻³", "10⁻²", "0.1", "1", "10", "100"]
    assert [label for _, label in Log(-10, 10).ticks() if label][:2] == ["10⁻¹⁰", "10⁻⁷"]


def test_minor_ticks_lie_at_the_logarithms_of_two_to_nine():
    places = [place for place, label in Log(0, 1).ticks() if not label]
    np.testing.assert_allclose(places, np.log10(np.arange(2, 10)))


def test_linear_ticks_carry_the_unit_but_not_at_zero():
    assert [label for _, label in Linear(-50, 50, 25, "%").ticks()] == [
        "-50 %",
        "-25 %",
        "0",
        "25 %",
        "50 %",
    ]


@given(st.floats(-3.9, 3.9), st.floats(-0.9, 2.9))
def test_values_survive_the_way_to_the_chart_and_back(x, y):
    there = CHART.points([10.0**x], [10.0**y])
    back = CHART.values(there)[0]
    np.testing.assert_allclose(np.log10(back), [x, y], atol=1e-6)


def test_larger_values_are_higher_up():
    low, high = CHART.points([1.0, 1.0], [1.0, 10.0])
    assert high[1] < low[1]


def test_a_white_noise_line_is_straight_and_cut_at_the_edge():
    tau = np.geomspace(1e-5, 1e5, 101)
    (strip,) = CHART.line(tau, 3.0 / np.sqrt(tau))
    assert strip.min() >= 0.0
    assert (strip.max(axis=0) <= [WIDTH, HEIGHT]).all()
    start, end = CHART.values(strip[[0, -1]])
    np.testing.assert_allclose(start, [1e-4, 300.0], rtol=1e-4)
    np.testing.assert_allclose(end, [900.0, 0.1], rtol=1e-4)
    slope = np.diff(strip[:, 1]) / np.diff(strip[:, 0])
    np.testing.assert_allclose(slope, slope[0], rtol=1e-2)


def test_a_line_breaks_at_what_is_not_known_and_where_it_leaves_the_chart():
    x = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    assert [len(s) for s in CHART.line(x, [1, 1, np.nan, 1, 1, 1, 1])] == [2, 4]
    assert [len(s) for s in CHART.line(x, [1, 1, 1e9, 1, 1, 0.0, 1])] == [3, 3]
    assert CHART.line(x, np.full(7, 1e9)) == []
    assert CHART.line([1.0], [1.0]) == []
    assert CHART.line([], []) == []


@given(st.lists(st.tuples(st.floats(-6, 6), st.floats(-3, 5)), min_size=2, max_size=30))
def test_nothing_is_ever_drawn_off_the_chart(points):
    x, y = 10.0 ** np.array(points).T
    for strip in [*CHART.line(x, y), *CHART.whiskers(x, y, 3 * y)]:
        assert np.isfinite(strip).all()
        assert (strip >= -1e-2).all()
        assert (strip <= np.array([WIDTH, HEIGHT]) + 1e-2).all()


def test_a_whisker_reaches_from_lower_to_upper_and_down_to_the_edge_for_zero():
    whole, open_ended = CHART.whiskers([1.0, 10.0], [1.0, 0.0], [10.0, 10.0])
    np.testing.assert_allclose(CHART.values(whole)[:, 1], [1.0, 10.0], rtol=1e-4)
    np.testing.assert_allclose(CHART.values(open_ended)[:, 1], [0.1, 10.0], rtol=1e-4)


def test_intervals_too_small_to_see_are_not_drawn():
    assert CHART.whiskers([1.0], [1.0], [1.001]) == []
    assert CHART.band([1.0, 10.0], [1.0, 1.0], [1.001, 1.001], 4.0) == []


def test_a_band_fills_between_its_curves_with_strips_that_touch():
    strips = np.array(CHART.band([1.0, 100.0], [1.0, 1.0], [10.0, 1000.0], pitch=4.0))
    np.testing.assert_allclose(np.diff(strips[:, 0, 0]), 4.0)
    x, upper = CHART.values(strips[:, 1]).T
    np.testing.assert_allclose(np.log10(upper), 1.0 + np.log10(x), atol=1e-4)
    np.testing.assert_allclose(CHART.values(strips[:, 0])[:, 1], 1.0, rtol=1e-4)


def test_dashes_cover_their_share_of_the_line():
    (line,) = CHART.line([1e-4, 1e4], [1.0, 1.0])
    dashes = dashed([line])
    lengths = [np.hypot(*(dash[1] - dash[0])) for dash in dashes]
    assert sum(lengths) == pytest.approx(WIDTH * 14 / 24, rel=0.02)
    assert all(dash[1, 0] - dash[0, 0] <= 14.01 for dash in dashes)


def test_the_last_tick_carries_the_unit_and_labels_do_not_overlap():
    labels = {text: at for at, text in CHART.labels()}
    assert "10⁴ s" in labels
    assert "mdps" in labels
    below = sorted(at[0] for text, at in labels.items() if at[1] > HEIGHT)
    assert min(np.diff(below)) > 90.0
