"""How the viewer is laid out: which tab shows which entities.

The layout is made in code and travels with the data, so that a viewer that joins late, or a
recording that is opened years later, looks the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import rerun as rr
import rerun.blueprint as rrb

from allanscope.analysis import coefficient_unit
from allanscope.quantities import LEVEL, MAIN_LETTERS, SENSOR_NAMES, symbols
from allanscope.samples import unit_of
from allanscope.view.chart import HEIGHT, MARGIN, WIDTH
from allanscope.view.chart_builder import DEFAULT_ESTIMATOR, TIME_DEVIATIONS
from allanscope.view.palette import AXIS, NAMED
from allanscope.view.rerun_drawing import POINTS
from allanscope.view.rerun_series import SENSORS

__all__ = ["TABS", "layout"]

TABS = (
    "σ(τ)",
    "axis by axis",
    "axes together",
    "estimators",
    "spectra",
    "closed loop",
    "time series",
    "σ(τ) over time",
    "temperature and rate",
    "link",
    "findings",
    "tables",
)
"""Names of the tabs, in order."""


_DOT = 1.8
"""Radius of the dots of curves, in points of the screen."""

_MAP_KEY = "σ(τ) over its median; blue less, red more"


def layout(axes: Sequence[str], estimators: Sequence[str], active_tab: int = 0) -> rrb.Blueprint:
    """Return the layout for these axes and estimators.

    Parameters
    ----------
    axes : sequence of str
        Names of the axes that are measured.
    estimators : sequence of str
        Names of the estimators that are computed, the default one among them.
    active_tab : int
        Tab that is open at first.
    """
    others = [kind for kind in estimators if kind != DEFAULT_ESTIMATOR]
    tabs = [
        rrb.Vertical(
            _text("/tables/verdict", "verdict"),
            _charts(axes, [_overview(axis) for axis in axes]),
            row_shares=[1, 5],
        ),
        rrb.Tabs(*[_axis(axis, others) for axis in axes]),
        rrb.Horizontal(*[_together(unit, axes) for unit in _units(axes)]),
        rrb.Tabs(*[_estimator(axes, kind) for kind in estimators]),
        _charts(axes, [_chart(f"/{axis}/spectrum", axis) for axis in axes]),
        rrb.Tabs(*[_loop(unit, axes) for unit in _units(axes)]),
        rrb.Tabs(*[_time_series(unit, axes) for unit in _units(axes)]),
        _charts(axes, [_chart(f"/{axis}/dynamic", f"{axis}: {_MAP_KEY}") for axis in axes]),
        rrb.Vertical(
            _plot("/samples/temperature", "temperature, °C"),
            _plot("/rate", "measured over nominal rate, ppm (± 1 σ)"),
        ),
        _link(),
        rrb.Horizontal(
            _text("/tables/findings", "effects found"),
            _log(),
            column_shares=[3, 2],
        ),
        rrb.Horizontal(
            _text("/tables/coefficients", "coefficients"),
            _text("/tables/run", "this run"),
            column_shares=[3, 2],
        ),
    ]
    for tab, name in zip(tabs, TABS, strict=True):
        tab.name = name
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=active_tab, name="allanscope"),
        rrb.TimePanel(timeline="elapsed", state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _chart(
    origin: str,
    name: str,
    contents: Sequence[str] = ("$origin/**",),
    hidden: Sequence[str] = (),
    curves: Sequence[str] = (DEFAULT_ESTIMATOR,),
) -> rrb.Spatial2DView:
    """Return a view of one chart: its rectangle, with room for the labels.

    Only the dots of curves answer when they are pointed at, with their numbers: of a line or a word
    the viewer would tell how it is stored.
    """
    still, live = (rrb.EntityBehavior(interactive=value) for value in (False, True))
    return rrb.Spatial2DView(
        origin=origin,
        name=name,
        contents=list(contents),
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-MARGIN["left"], WIDTH + MARGIN["right"]],
            y_range=[-MARGIN["top"], HEIGHT + MARGIN["bottom"]],
        ),
        defaults=[rr.Points2D.from_fields(radii=rr.Radius.ui_points(_DOT))],
        overrides={
            origin: still,
            **{f"{origin.rstrip('/')}/{curve}/{POINTS}": live for curve in curves},
            **{f"{origin}/{path}": rrb.EntityBehavior(visible=False) for path in hidden},
        },
    )


def _overview(axis: str) -> rrb.Spatial2DView:
    parts = ("grid", "datasheet", "reference", "model", DEFAULT_ESTIMATOR)
    return _chart(f"/{axis}/allan", axis, [f"$origin/{part}/**" for part in parts])


def _together(unit: str, axes: Sequence[str]) -> rrb.Spatial2DView:
    """Return the curves of all axes of a sensor in one chart: their charts have one frame.

    So have their references, a mask or an earlier session, of which only the first shows its name.
    """
    chosen = [axis for axis in axes if unit_of(axis) == unit]
    grid = [f"/{chosen[0]}/allan/{part}/**" for part in ("grid", "datasheet", "reference")]
    grid += [f"/{axis}/allan/reference" for axis in chosen[1:]]
    curves = [f"/{axis}/allan/{DEFAULT_ESTIMATOR}/**" for axis in chosen]
    colours = ", ".join(f"{axis} {NAMED[AXIS[axis]]}" for axis in chosen)
    name = f"{SENSOR_NAMES[unit]} σ(τ): {colours}"
    return _chart("/", name, [*grid, *curves], curves=[f"{axis}/allan/oadev" for axis in chosen])


def _estimator(axes: Sequence[str], kind: str) -> rrb.Grid:
    chart = "time" if kind in TIME_DEVIATIONS else "allan"
    paths = [f"$origin/{part}/**" for part in ("grid", kind)]
    grid = _charts(axes, [_chart(f"/{axis}/{chart}", axis, paths, (), [kind]) for axis in axes])
    grid.name = kind.upper()
    return grid


def _axis(axis: str, others: Sequence[str]) -> rrb.Horizontal:
    hidden = ["noise_model", *(kind for kind in others if kind not in TIME_DEVIATIONS)]
    sensor, about = SENSORS[unit_of(axis)], "x y z (± 1 σ; ▼ upper limit)"
    trends = [
        _plot(
            f"/coefficients/{sensor}/{letter}",
            f"{letter}, {coefficient_unit(unit_of(axis), letter)}, of {sensor} {about}",
            legend=False,
        )
        for letter in MAIN_LETTERS
    ]
    return rrb.Horizontal(
        _chart(
            f"/{axis}/allan", f"{axis} σ(τ)", hidden=hidden, curves=[DEFAULT_ESTIMATOR, *others]
        ),
        rrb.Vertical(_text(f"/tables/{axis}", "numbers"), *trends, row_shares=[11, 3, 3, 3]),
        column_shares=[6, 5],
        name=axis,
    )


def _loop(unit: str, axes: Sequence[str]) -> rrb.Vertical:
    chosen = [axis for axis in axes if unit_of(axis) == unit]
    parts = ("grid", "noise_model", "model", DEFAULT_ESTIMATOR)
    paths = [f"$origin/{part}/**" for part in parts]
    curves = [
        _chart(f"/{axis}/allan", f"{axis}: model before (grey) and after", paths) for axis in chosen
    ]
    residuals = [
        _chart(f"/{axis}/residual", f"{axis}: residual, before (grey) and after") for axis in chosen
    ]
    return rrb.Vertical(
        rrb.Grid(*curves, *residuals, grid_columns=len(chosen)),
        _text(f"/tables/loop_{SENSORS[unit]}", "model error before and after"),
        row_shares=[7, 2],
        name=SENSOR_NAMES[unit],
    )


def _time_series(unit: str, axes: Sequence[str]) -> rrb.Grid:
    """Return drift, spikes and the last minute of a sensor, an axis a row, from the same entity.

    Three axes in one plot hide each other.
    """
    origin = f"/samples/{SENSORS[unit]}"
    chosen = [axis for axis in axes if unit_of(axis) == unit]
    level = symbols(LEVEL[unit].unit)
    views = []
    for axis in chosen:
        for name, parts, last_s in (
            (f"{axis}, {level} since the start: means", (0,), None),
            (f"{axis}: minimum and maximum", (1, 2), None),
            (f"{axis}: last minute", (0, 1, 2), 60.0),
        ):
            shown = [part in parts and other == axis for part in range(3) for other in chosen]
            style = rr.SeriesLines.from_fields(visible_series=shown)
            views.append(_plot(origin, name, last_s, {origin: style}, False))
    return rrb.Grid(*views, grid_columns=3, name=SENSOR_NAMES[unit])


def _link() -> rrb.Vertical:
    return rrb.Vertical(
        rrb.Horizontal(
            _plot("/link/throughput", "received, kB/s"),
            _plot("/link/lost", "lost since the start"),
            _plot("/link/errors", "errors since the start"),
            _plot("/link/health", "device counters"),
        ),
        rrb.StateTimelineView(
            origin="/link/state", name="state of the link", time_view=_whole_run()
        ),
        _log(),
        row_shares=[3, 1, 2],
    )


def _plot(
    origin: str,
    name: str,
    last_s: float | None = None,
    styles: Mapping[rr.EntityPath | str, rr.SeriesLines] | None = None,
    legend: bool = True,
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=_whole_run() if last_s is None else _last(last_s),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
        overrides=styles,
    )


def _text(origin: str, name: str) -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin=origin, name=name)


def _log() -> rrb.TextLogView:
    return rrb.TextLogView(
        origin="/log",
        name="log",
        columns=rrb.TextLogColumns(
            timeline_columns=["elapsed"], text_log_columns=["LogLevel", "Body"]
        ),
    )


def _charts(axes: Sequence[str], views: Sequence[rrb.View]) -> rrb.Grid:
    return rrb.Grid(*views, grid_columns=min(len(axes), 3))


def _units(axes: Sequence[str]) -> list[str]:
    return [unit for unit in SENSORS if any(unit_of(axis) == unit for axis in axes)]


def _whole_run() -> rrb.TimeAxis:
    """Return the whole run: the viewer's own default is half a minute about the cursor."""
    forever = rrb.TimeRangeBoundary.infinite()
    return rrb.TimeAxis(view_range=rr.TimeRange(start=forever, end=forever))


def _last(seconds: float) -> rrb.TimeAxis:
    cursor = rrb.TimeRangeBoundary.cursor_relative
    return rrb.TimeAxis(
        view_range=rr.TimeRange(start=cursor(seconds=-seconds), end=cursor(seconds=0.0))
    )
