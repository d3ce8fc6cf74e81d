"""What a user sees: the curve is on the screen where its values are, in its colour."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from allanscope.quantities import DEVIATION
from allanscope.view import RerunView
from allanscope.view.chart import HEIGHT, MARGIN, WIDTH
from allanscope.view.chart_builder import SharedScales
from allanscope.view.palette import AXIS, EFFECT
from support.demo_analysis import demo_analysis
from support.headless_viewer import HeadlessViewer, why_no_viewer

pytestmark = pytest.mark.skipif(bool(why_no_viewer()), reason=why_no_viewer() or "-")

STALE = 4.0
"""The first result is larger by this, to see that the screen shows the last one."""


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """Pictures of the chart of every axis, and the scales they were drawn in."""
    folder = tmp_path_factory.mktemp("pixels")
    final = demo_analysis(3000.0)
    view = RerunView(folder, "none")
    view.start()
    view.snapshot(_scaled(demo_analysis(2000.0), STALE))
    assert view.settle(30.0)
    view.close(final)
    scales = SharedScales()
    scales.fit(_scaled(demo_analysis(2000.0), STALE))
    scales.fit(final)
    with HeadlessViewer(str(folder / "session.rrd"), "1440x860") as viewer:
        state = viewer.wait(3000.0)
        assert not [report for shown in state.views for report in shown.reports]
        pictures = {}
        for shown in state.views:
            # Views of the same name stand in other tabs; only what is on the screen has a picture.
            if shown.name in AXIS and shown.origin == f"/{shown.name}/allan":
                with contextlib.suppress(ConnectionError):
                    pictures[shown.name] = viewer.picture(shown.view_id).astype(int)
        assert pictures.keys() == AXIS.keys()
        whole = viewer.picture().astype(int)
    return final, scales, pictures, whole


def _scaled(analysis, factor):
    axes = {}
    for name, axis in analysis.axes.items():
        curves = {
            kind: replace(
                c,
                deviation=factor * c.deviation,
                lower=factor * c.lower,
                upper=factor * c.upper,
            )
            for kind, c in axis.curves.items()
        }
        axes[name] = replace(axis, curves=curves)
    return replace(analysis, axes=axes)


def _pixels(picture, points):
    """Return where world positions are: the bounds fit into the picture with one scale, centred."""
    height, width, _ = picture.shape
    left, right = -MARGIN["left"], WIDTH + MARGIN["right"]
    top, bottom = -MARGIN["top"], HEIGHT + MARGIN["bottom"]
    scale = min(width / (right - left), height / (bottom - top))
    centre = np.array([left + right, top + bottom]) / 2
    return np.array([width, height]) / 2 + (points - centre) * scale


def _share(picture, points, colour, tolerance=50, reach=3):
    """Return the share of positions that have the colour within `reach` pixels."""
    hits = 0
    for x, y in _pixels(picture, points).astype(int):
        near = picture[y - reach : y + reach + 1, x - reach : x + reach + 1].reshape(-1, 3)
        hits += bool((np.abs(near - np.array(colour)).max(axis=1) < tolerance).any())
    return hits / len(points)


@pytest.mark.parametrize("axis", list(AXIS))
def test_the_curve_is_where_its_values_are(seen, axis):
    final, scales, pictures, _ = seen
    unit = final.axes[axis].unit
    curve = final.axes[axis].curves["oadev"]
    sigma = DEVIATION[unit].factor * curve.deviation[curve.trusted]
    tau = curve.tau[curve.trusted]
    chart = scales.allan(unit)
    assert _share(pictures[axis], chart.points(tau, sigma), AXIS[axis]) > 0.95
    stale = chart.points(tau, STALE * sigma)
    on = (stale[:, 1] > 20.0) & (stale[:, 1] < HEIGHT - 20.0)
    assert _share(pictures[axis], stale[on], AXIS[axis]) < 0.1


def test_an_effect_that_was_found_is_drawn_in_its_own_colour(seen):
    final, scales, pictures, _ = seen
    model = final.axes["gx"].model
    part = 1e3 * model.components["sinusoid"]
    chart = scales.allan("dps")
    rising = (model.x < 0.004) & (part > 1.2 * chart.y.read(0.0))
    points = chart.points(model.x[rising], part[rising])
    assert _share(pictures["gx"], points, EFFECT, reach=4) > 0.5, "it is dashed"
    assert _share(pictures["gz"], points, EFFECT, reach=4) < 0.1


def test_the_grid_is_visible_and_the_picture_is_neither_blank_nor_full(seen):
    _, _, pictures, whole = seen
    for picture in (*pictures.values(), whole):
        background = np.median(picture.reshape(-1, 3), axis=0)
        differs = (np.abs(picture - background).max(axis=2) > 20).mean()
        assert 0.02 < differs < 0.6


def test_labels_are_written_beside_the_axes(seen):
    _, scales, pictures, _ = seen
    chart = scales.allan("dps")
    picture = pictures["gx"]
    for at, text in chart.labels():
        (x, y) = _pixels(picture, np.array([at]))[0].astype(int)
        y = min(y, picture.shape[0] - 6)
        near = picture[max(y - 2, 0) : y + 22, max(x - 8, 0) : x + 9]
        assert near.max() - near.min() > 60, f"no text at {text!r}"
