"""From a result to drawings: the values that are drawn are those of the result."""

from dataclasses import replace

import numpy as np
import pytest

from allanscope.allan import AllanBank
from allanscope.analysis import Analysis, ModelCurve, ReferenceCurve, with_comparison
from allanscope.quantities import DENSITY, DEVIATION
from allanscope.view.chart import HEIGHT, WIDTH, Chart, Linear, Log
from allanscope.view.chart_builder import ChartBuilder
from allanscope.view.chart_content import draw_curve, draw_map, percent_of_model
from allanscope.view.palette import AXIS, EFFECT, MODEL, muted
from allanscope.watch import Event, Occurrence
from support.demo_analysis import DATASHEET, LINE_HZ, demo_analysis, noise_of


class Wall:
    """Takes drawings by entity."""

    def __init__(self):
        self.drawings = {}
        self.count = {}

    def log(self, path, drawing):
        self.drawings[path] = drawing
        self.count[path] = self.count.get(path, 0) + 1


@pytest.fixture(scope="module")
def painted(analysis):
    wall = Wall()
    charts = ChartBuilder(wall.log)
    charts.paint(analysis)
    return wall.drawings, charts.scales


def test_a_curve_that_is_nowhere_trusted_keeps_its_name(painted, analysis):
    _, scales = painted
    gx = analysis.axes["gx"]
    curve = gx.curves["mdev"]
    nowhere = replace(curve, trusted=np.zeros_like(curve.trusted))
    drawing = draw_curve(scales.allan(gx.unit), nowhere, DEVIATION[gx.unit], AXIS["gx"], True)
    assert [word for _, word, _ in drawing.words] == ["MDEV"]


@pytest.mark.parametrize("axis", ["gx", "gz", "ax", "az"])
@pytest.mark.parametrize("kind", ["oadev", "mdev", "ohdev"])
def test_every_dot_is_a_point_of_the_estimate(painted, analysis, axis, kind):
    drawings, scales = painted
    curve, unit = analysis.axes[axis].curves[kind], analysis.axes[axis].unit
    chart = scales.allan(unit)
    drawn = chart.values(np.array(drawings[f"/{axis}/allan/{kind}"].dots))
    order = np.argsort(drawn[:, 0])
    sigma = DEVIATION[unit].factor * curve.deviation
    on = (sigma >= chart.y.read(0.0)) & (sigma <= chart.y.read(1.0))
    np.testing.assert_allclose(drawn[order, 0], curve.tau[on], rtol=2e-5)
    np.testing.assert_allclose(drawn[order, 1], sigma[on], rtol=2e-5)
    assert on[curve.trusted].all(), "every trusted point has its place on the chart"


def test_a_dot_says_what_it_is_when_pointed_at(painted, analysis):
    drawings, _ = painted
    curve = analysis.axes["gx"].curves["oadev"]
    texts = drawings["/gx/allan/oadev"].dot_texts
    assert texts[0].startswith("OADEV  τ = 1.501e-4 s  σ = ")
    assert "mdps" in texts[0]
    assert sum("not trusted" in text for text in texts) == (~curve.trusted).sum()


def test_what_is_not_trusted_is_faint_and_dashed(painted, analysis):
    drawings, scales = painted
    curve = analysis.axes["gx"].curves["oadev"]
    drawing = drawings["/gx/allan/oadev"]
    last_trusted = curve.tau[curve.trusted][-1]
    chart = scales.allan("dps")
    edge = chart.points([last_trusted], [1.0])[0, 0]
    solid = [
        strip
        for strip, colour in zip(drawing.strips, drawing.strip_colours, strict=True)
        if colour == AXIS["gx"]
    ]
    assert max(strip[:, 0].max() for strip in solid) == pytest.approx(edge, abs=0.01)
    dashes = [
        strip
        for strip, colour in zip(drawing.strips, drawing.strip_colours, strict=True)
        if colour == muted(AXIS["gx"]) and len(strip) == 2 and strip[0, 0] != strip[1, 0]
    ]
    assert min(d[:, 0].min() for d in dashes) == pytest.approx(edge, abs=0.01), "joined"
    faint = [colour for colour in drawing.dot_colours if colour == muted(AXIS["gx"])]
    assert len(faint) == (~curve.trusted).sum()


def test_the_interval_is_drawn_to_its_limits(painted, analysis):
    drawings, scales = painted
    curve = analysis.axes["az"].curves["oadev"]
    chart = scales.allan("g")
    drawing = drawings["/az/allan/oadev"]
    i = np.flatnonzero(curve.trusted)[-1]
    low, high = 1e6 * curve.lower[i], 1e6 * curve.upper[i]
    whiskers = [chart.values(s) for s in drawing.strips if len(s) == 2 and s[0, 0] == s[1, 0]]
    (mine,) = [w for w in whiskers if np.allclose(w[:, 0], curve.tau[i], rtol=1e-5)]
    np.testing.assert_allclose(mine[:, 1], [low, high], rtol=1e-4)


def test_the_model_is_drawn_with_its_parts_by_name(painted, analysis):
    drawings, scales = painted
    drawing = drawings["/gx/allan/model"]
    assert {word: colour for _, word, colour in drawing.words} == {
        "N": MODEL,
        "B": MODEL,
        "line": EFFECT,
    }
    assert not analysis.axes["gx"].coefficients["K"].detected, "hence it has no line"
    total = max(drawing.strips, key=len)
    model = analysis.axes["gx"].model
    drawn = scales.allan("dps").values(total)
    np.testing.assert_allclose(
        drawn[:, 1], 1e3 * np.interp(drawn[:, 0], model.x, model.total), rtol=1e-3
    )


def test_words_stay_on_the_chart(painted):
    drawings, _ = painted
    for path, drawing in drawings.items():
        if not path.endswith("grid"):
            for (x, y), _, _ in drawing.words:
                assert 0.0 <= x <= WIDTH
                assert -40.0 <= y <= HEIGHT


def test_the_datasheet_crosses_one_second_at_its_density_over_root_two(painted):
    drawings, scales = painted
    for axis, unit in (("gx", "dps"), ("ax", "g")):
        chart = scales.allan(unit)
        points = np.concatenate(drawings[f"/{axis}/allan/datasheet"].strips)
        tau, sigma = chart.values(points).T
        at_one = np.exp(np.interp(0.0, np.log(tau), np.log(sigma)))
        expected = DEVIATION[unit].factor * DATASHEET[unit] / np.sqrt(2)
        assert at_one == pytest.approx(expected, rel=1e-3)


def test_an_earlier_session_is_drawn_where_it_was_with_its_name(analysis):
    gx = analysis.axes["gx"]
    earlier = ReferenceCurve("first", gx.curves["oadev"].tau, 2.0 * gx.curves["oadev"].deviation)
    wall = Wall()
    charts = ChartBuilder(wall.log)
    charts.paint(with_comparison(analysis, {"gx": earlier}))
    assert "/gy/allan/reference" not in wall.drawings
    drawing = wall.drawings["/gx/allan/reference"]
    assert [text for _, text, _ in drawing.words] == ["first"]
    drawn = charts.scales.allan("dps").values(np.concatenate(drawing.strips))
    expected = np.interp(np.log(drawn[:, 0]), np.log(earlier.tau), np.log(earlier.deviation))
    np.testing.assert_allclose(np.log(drawn[:, 1] / 1e3), expected, atol=1e-3)


def test_axes_of_one_sensor_share_their_scales(painted):
    drawings, scales = painted
    assert drawings["/gx/allan/grid"].words == drawings["/gz/allan/grid"].words
    assert scales.allan("dps") != scales.allan("g")


def test_time_deviations_have_a_chart_of_their_own(painted, analysis):
    drawings, scales = painted
    curve = analysis.axes["gx"].curves["tdev"]
    assert "/gx/allan/tdev" not in drawings
    drawn = scales.time("dps").values(np.array(drawings["/gx/time/tdev"].dots))
    np.testing.assert_allclose(np.sort(drawn[:, 0])[:20], curve.tau[:20], rtol=2e-5)


def test_the_spectrum_is_the_root_of_the_density(painted, analysis):
    drawings, scales = painted
    density = analysis.axes["gy"].density
    line = max(drawings["/gy/spectrum/measured"].strips, key=len)
    f, root = scales.spectrum("dps").values(line).T
    expected = np.interp(f, density.frequency, DENSITY["dps"].factor * np.sqrt(density.density))
    np.testing.assert_allclose(root[5:-5], expected[5:-5], rtol=1e-3)


def test_the_interval_of_a_density_is_that_of_chi_square(painted, analysis):
    drawings, scales = painted
    drawing = drawings["/gz/spectrum/measured"]
    density = analysis.axes["gz"].density
    n = np.flatnonzero(density.averages < 20)[-1]
    bands = [scales.spectrum("dps").values(s) for s in drawing.strips if len(s) == 2]
    near = min(bands, key=lambda band: abs(np.log(band[0, 0] / density.frequency[n])))
    ratio = near[1, 1] / near[0, 1]
    # 95 % of chi-square with 2 n degrees of freedom about its mean: +-1.96 sqrt(1/n), halved by
    # the root of the density
    assert np.log(ratio) == pytest.approx(1.96 / np.sqrt(density.averages[n]), rel=0.15)


def test_a_line_that_was_found_is_marked_where_it_sits(painted):
    drawings, scales = painted
    drawing = drawings["/gx/spectrum/effects"]
    x = np.concatenate(drawing.strips)[:, 0]
    np.testing.assert_allclose(
        scales.spectrum("dps").values([[x[0], 0.0]])[0, 0], LINE_HZ, rtol=1e-5
    )
    assert [word for _, word, _ in drawing.words] == ["line 49.98 Hz"]
    assert drawings["/ax/spectrum/effects"].strips == []


def test_the_residual_shows_what_the_loop_removed(analysis):
    axis = analysis.axes["gx"]
    curve = axis.curves["oadev"]
    near_line = (curve.tau > 0.005) & (curve.tau < 0.012)
    before = percent_of_model(curve, axis.model_before)[near_line]
    after = percent_of_model(curve, axis.model)[near_line]
    assert before.max() > 5.0
    assert np.abs(after).max() < 1.0


def test_the_residual_is_unknown_where_there_is_no_model(analysis):
    curve = analysis.axes["gx"].curves["oadev"]
    short = ModelCurve(curve.tau[:10], curve.deviation[:10])
    percent = percent_of_model(curve, short)
    np.testing.assert_allclose(percent[:10], 0.0, atol=1e-9)
    assert np.isnan(percent[10:]).all()
    assert np.isnan(percent_of_model(curve, ModelCurve(np.empty(0), np.empty(0)))).all()


def test_only_what_changes_is_drawn_at_every_result(analysis):
    wall = Wall()
    charts = ChartBuilder(wall.log)
    charts.paint(analysis)
    charts.paint(analysis, everything=False)
    assert wall.count["/gx/allan/oadev"] == 2
    assert wall.count["/gx/allan/model"] == 2
    assert wall.count["/gx/allan/mdev"] == 1
    assert wall.count["/gx/allan/grid"] == 1
    charts.paint(analysis)
    assert wall.count["/gx/allan/grid"] == 2, "drawn again now and then for viewers that join late"


def test_a_run_that_outgrows_its_chart_gets_a_new_grid_and_new_curves():
    wall = Wall()
    charts = ChartBuilder(wall.log)
    charts.paint(demo_analysis(9.0))
    small = charts.scales.allan("dps")
    charts.paint(demo_analysis(3000.0), everything=False)
    large = charts.scales.allan("dps")
    assert large.x.high > small.x.high
    assert wall.count["/gx/allan/grid"] == 2
    assert wall.count["/gx/allan/mdev"] == 2, "else it would lie on the old grid"
    charts.paint(demo_analysis(9.0), everything=False)
    assert charts.scales.allan("dps") == large, "a chart never shrinks"


def test_a_result_without_anything_yet_draws_nothing(analysis):
    wall = Wall()
    axes = {
        name: replace(
            axis,
            curves={},
            coefficients={},
            datasheet={},
            density=None,
            model=None,
            model_before=None,
            density_model=None,
            explanation=None,
        )
        for name, axis in analysis.axes.items()
    }
    ChartBuilder(wall.log).paint(replace(analysis, axes=axes))
    assert wall.drawings == {}


def test_any_subset_of_axes_can_be_drawn(analysis):
    wall = Wall()
    ChartBuilder(wall.log).paint(replace(analysis, axes={"az": analysis.axes["az"]}))
    assert {path.split("/")[1] for path in wall.drawings} == {"az"}


def test_the_demo_itself_has_the_noise_that_it_claims(analysis: Analysis):
    N, _, _ = noise_of("gx")
    curve = analysis.axes["ax"].curves["oadev"]
    N_ax, _, _ = noise_of("ax")
    np.testing.assert_allclose(curve.deviation[:20] * np.sqrt(curve.tau[:20]), N_ax, rtol=0.02)
    assert pytest.approx(2.9e-3) == N


def test_the_map_over_time_is_red_where_an_axis_has_more_noise_than_usual(analysis):
    wall = Wall()
    ChartBuilder(wall.log).paint(analysis)
    gx, gz = (wall.drawings[f"/{axis}/dynamic/map"].image for axis in ("gx", "gz"))
    known = gx[..., 3] > 0
    assert known.any()
    assert not known.all()
    red = (gx[..., 0].astype(int) - gx[..., 2] > 100) & known
    assert 0.05 < red.sum() / known.sum() < 0.2
    assert ((gz[..., 0].astype(int) - gz[..., 2] > 100) & (gz[..., 3] > 0)).mean() < 0.02


def test_the_map_has_no_hole_between_two_averaging_times():
    """The second one is twice the first, and farther from it than any others are."""
    bank = AllanBank(100.0, axes=1, window=0.0)
    bank.update(np.random.default_rng(1).normal(size=(20_000, 1)))
    dynamic = bank.dynamic()
    assert dynamic is not None
    rows = Log.around(dynamic.tau[:2], least=1)
    chart = Chart(Linear(0.0, float(dynamic.stop_s[-1]), 1.0), rows, "s", "s")
    image = draw_map(chart, dynamic, 0, []).image
    shown = np.flatnonzero((image[..., 3] > 0).any(axis=1))
    assert len(shown) == shown[-1] - shown[0] + 1 > 20


def test_an_event_is_marked_on_every_map_and_paler_where_it_is_of_other_axes(analysis):
    once = Occurrence(1.0, 0.9, 1.1, 2.0, None, 0.1, 104, 208)
    kinds = (("step", ("gx",)), ("rate_change", ()))
    events = tuple(Event(kind, axes, "", (once,), 1, 30.0) for kind, axes in kinds)
    wall = Wall()
    ChartBuilder(wall.log).paint(replace(analysis, events=events))
    for axis, strong in (("gx", 2), ("az", 1)):
        drawing = wall.drawings[f"/{axis}/dynamic/map"]
        assert drawing.strip_colours.count(EFFECT) == strong
        assert drawing.strip_colours.count(muted(EFFECT)) == 2 - strong
