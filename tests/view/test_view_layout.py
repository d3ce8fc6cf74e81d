"""The layout: every axis and estimator has its place, and each chart shows only its own."""

import rerun.blueprint as rrb

from allanscope.samples import AXES
from allanscope.view.rerun_blueprint import TABS, layout
from support.demo_analysis import ESTIMATORS


def _views(part):
    """Return all views below a part of the layout."""
    if isinstance(part, rrb.View):
        return [part]
    return [view for child in part.contents for view in _views(child)]


def _tabs(axes=AXES, estimators=ESTIMATORS):
    root = layout(axes, estimators).root_container
    return {tab.name: tab for tab in root.contents}


def test_the_tabs_are_those_that_are_promised():
    assert tuple(_tabs()) == TABS


def test_every_estimator_has_a_chart_of_every_axis():
    tab = _tabs()["estimators"]
    assert [part.name for part in tab.contents] == [kind.upper() for kind in ESTIMATORS]
    for kind, grid in zip(ESTIMATORS, tab.contents, strict=True):
        chart = "time" if kind == "tdev" else "allan"
        for axis, view in zip(AXES, _views(grid), strict=True):
            assert view.origin == f"/{axis}/{chart}"
            assert view.contents == ["$origin/grid/**", f"$origin/{kind}/**"]


def test_charts_show_nothing_from_outside_themselves():
    for name, tab in _tabs().items():
        if name == "axes together":
            continue
        for view in _views(tab):
            contents = [view.contents] if isinstance(view.contents, str) else view.contents
            assert all(str(path).startswith("$origin/") for path in contents), view.name


def test_the_axes_of_a_sensor_stand_together_in_one_frame():
    gyro, accel = _views(_tabs()["axes together"])
    for view, axes in ((gyro, ("gx", "gy", "gz")), (accel, ("ax", "ay", "az"))):
        shown = [str(path) for path in view.contents]
        assert [f"/{axis}/allan/oadev/**" in shown for axis in axes] == [True] * 3
        assert sum("grid" in path for path in shown) == 1
        first, *others = axes
        assert f"/{first}/allan/reference/**" in shown, "with its name"
        assert all(f"/{axis}/allan/reference" in shown for axis in others), "curves alone"


def test_only_the_points_of_curves_answer_when_they_are_pointed_at():
    for name in ("σ(τ)", "axis by axis", "axes together", "closed loop"):
        for view in _views(_tabs()[name]):
            live = {
                path
                for path, behaviour in view.visualizer_overrides.items()
                if behaviour.interactive is not None
                and behaviour.interactive.as_arrow_array()[0].as_py()
            }
            assert all(path.endswith("/points") for path in live), view.name
            if "allan" in str(view.contents):
                assert any(path.endswith("/allan/oadev/points") for path in live), view.name


def test_other_estimators_are_hidden_on_the_axis_tab_until_they_are_wanted():
    (gx, *_) = _views(_tabs()["axis by axis"])
    hidden = {
        path
        for path, behaviour in gx.visualizer_overrides.items()
        if behaviour.visible is not None and not behaviour.visible.as_arrow_array()[0].as_py()
    }
    assert hidden == {
        f"/gx/allan/{kind}" for kind in ("noise_model", "adev", "mdev", "ohdev", "totdev")
    }


def test_a_sensor_that_is_not_there_has_no_charts():
    tabs = _tabs(axes=("gx", "gz"), estimators=("oadev",))
    origins = {view.origin for tab in tabs.values() for view in _views(tab)}
    assert not [origin for origin in origins if "accel" in origin or origin.startswith("/a")]
    assert "/gz/allan" in origins


def test_every_axis_has_time_series_of_its_own():
    gyro, accel = _tabs()["time series"].contents
    for grid, axes, origin in (
        (gyro, AXES[:3], "/samples/gyro"),
        (accel, AXES[3:], "/samples/accel"),
    ):
        views = _views(grid)
        assert [view.name[:2] for view in views] == [axis for axis in axes for _ in range(3)]
        for view in views:
            style = view.visualizer_overrides[origin]
            shown = style.visible_series.as_arrow_array().to_pylist()
            drawn = {axes[place % 3] for place, visible in enumerate(shown) if visible}
            assert drawn == {view.name[:2]}, view.name
