"""Pictures show what was measured, say what they show, and can be had as files."""

import os
import re
import time
from collections import Counter
from dataclasses import replace
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from allanscope.analysis import ReferenceCurve
from allanscope.analysis.comparison import compare_curve
from allanscope.report import MEASURED, MODEL, Picture, pictures, save_pictures
from allanscope.report.curve_pictures import compare_picture, deviation_picture, overlay_picture
from allanscope.report.data_pictures import lag_picture
from allanscope.report.picture import draw_forked


@pytest.fixture(scope="module")
def gallery(analysis):
    return pictures(analysis)


def drawn(picture):
    """Return the axes of a picture after it was drawn and laid out."""
    figure = Figure(figsize=(picture.width, picture.height), layout="constrained")
    picture.draw(figure)
    figure.draw_without_rendering()
    return figure.axes


def line(ax, label):
    (found,) = [one for one in ax.get_lines() if one.get_label().startswith(label)]
    return found


def test_there_is_one_picture_of_everything(gallery):
    each = {f"{axis}-{what}" for axis in ("gx", "ax") for what in NAMES}
    each |= {f"{name}-{what}" for name in ("gyroscope", "accelerometer") for what in OF_SENSOR}
    assert set(gallery) == each | {"dynamic", "ratio", "transfer"}


OF_SENSOR = ("overlay", "series")
NAMES = ("deviation", "residual", "density", "lag")


def test_the_map_over_time_shows_each_axis_over_its_own_median_and_the_marks(gallery, analysis):
    *charts, bar = drawn(gallery["dynamic"])
    shown = [ax for ax in charts if ax.get_visible()]
    assert [ax.get_title() for ax in shown] == ["gx", "ax"]
    dynamic = analysis.dynamic
    assert dynamic is not None
    for column, ax in enumerate(shown):
        ratio = np.asarray(ax.collections[0].get_array()).reshape(len(dynamic.tau), -1)
        assert ratio.shape[1] == min(len(dynamic.start_s), 200)
        np.testing.assert_allclose(ratio[0, 0], dynamic.relative(column)[0, 0])
    assert [text.get_text() for text in bar.get_yticklabels()] == ["¼", "½", "1", "2", "4"]


@pytest.mark.parametrize(("name", "factor"), [("gx", 1e3), ("ax", 1e6)])
def test_the_curve_is_drawn_in_mdps_or_ug_with_its_model_and_the_datasheet(
    gallery, analysis, name, factor
):
    (ax,) = drawn(gallery[f"{name}-deviation"])
    axis = analysis.axes[name]
    curve = axis.curves["oadev"]
    measured = line(ax, f"{name}, measured")
    np.testing.assert_allclose(
        measured.get_ydata(), factor * curve.deviation[curve.trusted], rtol=1e-12
    )
    assert measured.get_color() == MEASURED
    np.testing.assert_allclose(line(ax, "model").get_ydata(), factor * axis.model.total)
    # The datasheet's one-sided density over sqrt(2) is what white noise has at 1 s.
    sheet = line(ax, "datasheet")
    at_one_second = np.interp(0.0, np.log(sheet.get_xdata()), sheet.get_ydata())
    limit = factor * axis.datasheet["density"].limit / np.sqrt(2)
    assert at_one_second == pytest.approx(limit, rel=0.02)
    assert ax.get_ylabel() == {"gx": "σ(τ) (mdps)", "ax": "σ(τ) (µg)"}[name]
    assert ax.get_xscale() == ax.get_yscale() == "log"


def test_parts_are_named_and_names_do_not_overlap(analysis):
    axis = analysis.axes["gx"]
    # A part as flat as B and a little lower would be named in the same place.
    parts = {**axis.model.components, "rounding": 0.95 * axis.model.components["B"]}
    crowded = replace(axis, model=replace(axis.model, components=parts))
    (ax,) = drawn(deviation_picture("gx", crowded))
    names = [text.get_text() for text in ax.texts]
    assert {"N", "B", "rounding", "line"} == set(names), "K was not detected"
    boxes = [text.get_window_extent() for text in ax.texts]
    assert not [1 for one, other in combinations(boxes, 2) if one.overlaps(other)]
    frame = ax.get_window_extent()
    assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 for box in boxes)


def test_before_and_after_are_both_drawn_and_what_they_leave(gallery, analysis):
    top, bottom = drawn(gallery["gx-residual"])
    axis = analysis.axes["gx"]
    for label, model in (("model before", axis.model_before), ("model after", axis.model)):
        np.testing.assert_allclose(line(top, label).get_ydata(), 1e3 * model.total)
        expected = 100 * (axis.curves["oadev"].deviation / model.total - 1)
        np.testing.assert_allclose(line(bottom, label).get_ydata(), expected, atol=1e-9)


def test_what_was_found_is_marked_in_the_density(gallery):
    (ax,) = drawn(gallery["gx-density"])
    assert [text.get_text() for text in ax.texts] == ["line 49.98 Hz"]
    assert line(ax, "model").get_color() == MODEL


def test_a_lag_plot_counts_each_value_against_the_one_before(analysis):
    record = analysis.record
    (ax,) = drawn(lag_picture(record, "gx", "dps"))
    (mesh,) = ax.collections
    corners = mesh.get_coordinates()
    x = 1e3 * (record.values[:, 0] - record.values[:, 0].mean())
    counts = np.histogram2d(x[1:], x[:-1], bins=[corners[:, 0, 1], corners[0, :, 0]])[0]
    assert counts.sum() > 0.99 * len(x)
    np.testing.assert_array_equal(np.ma.filled(mesh.get_array(), 0).reshape(counts.shape), counts)


def test_a_lag_plot_of_one_value_can_be_drawn(analysis):
    record = analysis.record
    record.values[:, 0] = 0.31
    assert drawn(lag_picture(record, "gx", "dps"))


def test_pictures_are_saved_as_svg_and_png(gallery, tmp_path):
    chosen = {name: gallery[name] for name in ("gx-deviation", "ax-lag")}
    files = save_pictures(chosen, tmp_path / "figures")
    assert [file.name for file in files] == [
        "gx-deviation.svg",
        "gx-deviation.png",
        "ax-lag.svg",
        "ax-lag.png",
    ]
    text = files[0].read_text()
    assert "σ(τ) (mdps)" in " ".join(ElementTree.fromstring(text).itertext())
    assert "currentColor" not in text, "a file has its own ink"
    with Image.open(files[1]) as image:
        assert image.size == (1050, 630)
        shown = {image.convert("RGB").getpixel((0, 0))} | set(
            image.convert("RGB").resize((350, 210)).get_flattened_data()
        )
    assert (255, 255, 255) in shown
    assert len(shown) > 100


def test_on_the_page_a_picture_takes_the_ink_of_the_page(gallery):
    svg = gallery["ratio"].svg()
    assert svg.startswith("<svg")
    assert "currentColor" in svg
    assert "#808080" not in svg


def test_names_of_sessions_are_no_mathematics_and_never_dropped(analysis):
    curve = analysis.axes["gx"].curves["oadev"]
    names = ("$\\frac{", "_hidden", "<b>&amp;</b>", "plain")
    picture = compare_picture(dict.fromkeys(names, curve), "dps")
    (ax,) = drawn(picture)
    shown = [text.get_text().strip("\u200b") for text in ax.get_legend().get_texts()]
    assert shown == ["\\$\\frac{", "_hidden", "<b>&amp;</b>", "plain"]
    assert "<b>" not in picture.svg()


@pytest.mark.parametrize("name", ["gx-deviation", "gx-residual", "gyroscope-series", "gx-lag"])
def test_plain_axes_have_the_ticks_the_grid_and_the_labels_of_matplotlib(
    gallery, name, monkeypatch
):
    def with_grid(figure):
        for ax in figure.axes:
            ax.grid(visible=True)

    plain = gallery[name].svg()
    monkeypatch.setattr("allanscope.report.picture.draw_plain_axes", with_grid)
    whole = gallery[name].svg()
    told = [Counter(re.findall(r"<text[^>]*>([^<]+)</text>", svg)) for svg in (plain, whole)]
    assert told[0] == told[1]
    places = [len(_grid_places(svg)) for svg in (plain, whole)]
    assert places[0] == places[1] > 4


def _grid_places(svg):
    """Return the strokes of the grid: of one path, or each of its own."""
    faint = re.findall(r'<path d="([^"]*)"[^>]*stroke-opacity: 0.25', svg)
    return [one for path in faint for one in re.findall(r"M [^M]*", path)]


def test_a_picture_is_drawn_only_when_it_is_wanted():
    def fail(_):
        raise AssertionError

    Picture(fail)


def test_no_picture_is_typeset(gallery, monkeypatch):
    """Mathtext takes as long as all else in a chart; powers of ten are plain text."""

    def refuse(*_, **__):
        raise AssertionError("typeset as mathtext")

    monkeypatch.setattr("matplotlib.mathtext.MathTextParser.parse", refuse)
    texts = [picture.svg() for picture in gallery.values()]
    assert any("10⁻⁸" in text for text in texts)


def test_a_mask_is_drawn_once_over_all_axes_of_a_sensor(analysis):
    gx = analysis.axes["gx"]
    mask = ReferenceCurve(
        "mask.csv", gx.curves["oadev"].tau, np.full(len(gx.curves["oadev"].tau), 0.1)
    )
    known = replace(gx, comparison=compare_curve(gx.curves["oadev"], mask))
    (ax,) = drawn(overlay_picture({"gx": known, "gy": known}, "dps"))
    np.testing.assert_allclose(line(ax, "mask.csv").get_ydata(), 100.0)
    assert sum(np.allclose(one.get_ydata(), 100.0) for one in ax.get_lines()) == 1
    (plain,) = drawn(overlay_picture({"gx": gx}, "dps"))
    assert not any(one.get_label() == "mask.csv" for one in plain.get_lines())


forked = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")


@forked
def test_two_processes_share_the_pictures_and_their_order_stays():
    def drawn():
        time.sleep(0.05)
        return str(os.getpid())

    found = draw_forked({f"p{k}": drawn for k in range(12)})
    assert list(found) == [f"p{k}" for k in range(12)]
    assert len(set(found.values())) == 2
    assert str(os.getpid()) in found.values()


@forked
def test_what_the_other_process_leaves_undone_is_drawn_here():
    here = os.getpid()

    def drawn():
        time.sleep(0.05)
        if os.getpid() != here:
            os._exit(1)
        return "here"

    assert draw_forked({f"p{k}": drawn for k in range(4)}) == dict.fromkeys(
        ["p0", "p1", "p2", "p3"], "here"
    )


@forked
def test_an_error_is_raised_here_whoever_draws():
    here = os.getpid()

    def fails_there():
        time.sleep(0.05)
        if os.getpid() != here:
            raise ValueError("cannot be drawn there")
        return "drawn"

    def fails():
        raise ValueError("cannot be drawn")

    assert set(draw_forked(dict.fromkeys("abcd", fails_there)).values()) == {"drawn"}
    with pytest.raises(ValueError, match="cannot be drawn"):
        draw_forked(dict.fromkeys("abcd", fails))
