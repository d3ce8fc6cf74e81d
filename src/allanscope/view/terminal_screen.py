"""What the terminal shows of a result: a screen, a status line for a log file, a summary.

The screen fits 80 columns and uses 200; the summary at the end of a command is the same screen as
plain lines. Allan curves are dots of braille, two by four to a character::

    σ(τ), mdps   gx gy gz
      10 ┤⠑⢄
         │  ⠑⠢⢄
       1 ┤     ⠑⠒⠤⠤
         └┬────┬────┬─
         0.1   1    10 s
"""

from __future__ import annotations

import io
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, ConsoleOptions, Group, RenderResult
from rich.style import Style
from rich.table import Table
from rich.text import Text

from allanscope.analysis import (
    Analysis,
    AxisAnalysis,
    VerdictLine,
    as_of_text,
    best_text,
    clock_text,
    coefficient_text,
    coefficient_unit,
    density_verdict,
    losses_phrase,
    rate_text,
    recorded_text,
    simulation_notice,
    verdict,
    was_searched,
)
from allanscope.labels import DATASHEET, MINIMUM, MODEL_ERRORS
from allanscope.noise import Coefficient
from allanscope.quantities import (
    COEFFICIENTS,
    DEVIATION,
    MAIN_LETTERS,
    POWER_LAW_NAMES,
    SENSOR_NAMES,
    count,
    counted,
    number,
    symbols,
)
from allanscope.sanitize import one_line, sanitize
from allanscope.view.change_log import Direction, Trends
from allanscope.view.chart import Log
from allanscope.view.chart_builder import DEFAULT_ESTIMATOR
from allanscope.view.palette import AXIS, GRADE, Colour

__all__ = ["LEAST_LINES", "Curves", "Screen", "curve_lines", "status_line", "summary_lines"]

LEAST_LINES = 9
"""Lines below which a chart shows less than the table beside it does."""

_MARGIN = 7
"""Columns of the labels and of the axis on the left."""

_FRAME = 3
"""Lines of the title, of the axis below and of its labels."""

_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bits of the eight dots of a braille character, by row and column (Unicode 15, section 21.1)."""

_BLANK = 0x2800


def curve_lines(axes: Mapping[str, AxisAnalysis], width: int, height: int) -> list[Text]:
    """Return a chart of the overlapping Allan deviations, as far as they are trusted.

    Parameters
    ----------
    axes : mapping
        Axes of one sensor, by name.
    width, height : int
        Columns and lines of the chart, labels included.

    Returns
    -------
    list of Text
        `height` lines; none where there is no curve yet, or no room for one.
    """
    curves = {
        name: (axis.curves[DEFAULT_ESTIMATOR], DEVIATION[axis.unit])
        for name, axis in axes.items()
        if DEFAULT_ESTIMATOR in axis.curves
    }
    points = {
        name: (curve.tau[curve.trusted], reading.factor * curve.deviation[curve.trusted])
        for name, (curve, reading) in curves.items()
        if np.count_nonzero(curve.trusted) > 1
    }
    columns, rows = width - _MARGIN, height - _FRAME
    if not points or columns < 10 or height < LEAST_LINES:
        return []
    tau = Log.around(np.concatenate([tau for tau, _ in points.values()]))
    sigma = Log.around(np.concatenate([sigma for _, sigma in points.values()]))
    bits = np.zeros((rows, columns), np.int64)
    owner = np.full((rows, columns), "", object)
    for name, (x, y) in points.items():
        down, right = _dots(tau.place(x), sigma.place(y), rows, columns)
        np.bitwise_or.at(bits, (down // 4, right // 2), _DOTS[down % 4, right % 2])
        owner[down // 4, right // 2] = name
    reading = next(iter(curves.values()))[1]
    title = Text().append(f"σ(τ), {symbols(reading.unit)}  ", "dim")
    for name in points:
        title.append(f" {name}", style=_curve_style(name))
    labels = {rows - 1 - round(at * (rows - 1)): text for at, text in sigma.ticks() if text}
    lines = [title]
    for row in range(rows):
        label = f"{labels.get(row, ''):>{_MARGIN - 2}} {'┤' if row in labels else '│'}"
        line = Text().append(label, "dim")
        for cell, name in zip(bits[row], owner[row], strict=True):
            line.append(
                chr(_BLANK + cell) if cell else " ", style=_curve_style(name) if name else None
            )
        lines.append(line)
    return [*lines, *_below(tau, columns)]


def _dots(
    x: NDArray[np.float64], y: NDArray[np.float64], rows: int, columns: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row and column of the dots of a polyline through places between 0 and 1."""
    across, up = x * (2 * columns - 1), y * (4 * rows - 1)
    length = np.concatenate([[0.0], np.cumsum(np.maximum(*np.abs(np.diff([across, up]))))])
    steps = np.linspace(0.0, length[-1], 2 * int(length[-1]) + 2)
    column = np.rint(np.interp(steps, length, across)).astype(np.int64)
    row = 4 * rows - 1 - np.rint(np.interp(steps, length, up)).astype(np.int64)
    return row, column


def _below(tau: Log, columns: int) -> list[Text]:
    """Return the axis of the averaging times with its ticks, and their labels."""
    axis, labels = ["─"] * columns, [" "] * (columns + _MARGIN)
    end = 0
    for at, text in tau.ticks():
        if not text:
            continue
        place = round(at * (columns - 1))
        axis[place] = "┬"
        label = f"{text} s" if at == 1.0 else text
        start = min(place + _MARGIN - len(label) // 2, len(labels) - len(label))
        if start >= end:
            labels[start : start + len(label)] = label
            end = start + len(label) + 1
    corner = " " * (_MARGIN - 1) + "└"
    return [Text(corner + "".join(axis), style="dim"), Text("".join(labels), style="dim")]


def _curve_style(axis: str) -> Style:
    return Style.parse("bold rgb({},{},{})".format(*AXIS[axis]))


Curves = Literal["both", "gyroscope", "accelerometer", "none"]
"""Sensors whose Allan curves are drawn; of both as far as there is room."""

_WIDE = 130
_ARROWS: dict[Direction, str] = {"up": "↑", "down": "↓", "settled": "=", "": " "}
_NARROW = 72
"""Columns below which a line of the verdict may take three rows instead of two."""
_ROWS_A_LINE = 20
"""Rows of the screen for each that a line of the verdict may take: a summary cuts nothing."""

_LEAST_LINES = 5
"""Lines beside the verdict and the table that are always there: header, run, age, space, keys."""

_SIDE_BY_SIDE = 100
"""Columns from which two charts stand beside each other."""

_MOST_CHART_LINES = 18
_DETAILS_BESIDE_CHART = 4
"""Lines of details that a chart leaves room for."""

_HELP = (
    "m  set a mark in the recording        c  curves: both sensors, one of them, none",
    "q  end the run and write the report   ?  this help, or the details again",
    "N  white noise, B  bias instability, K  rate random walk   95 % intervals, < upper limit",
    "↑ ↓  changed since half of the run, =  stable",
)
"""Their columns stand below each other where they do not fit."""

_SIGNS = "95 % intervals, < upper limit"

_BETWEEN = "   "
"""What separates the parts of a line: its last parts are left out where it does not fit."""

_FOLDING = Console(file=io.StringIO(), width=1)
"""Rich folds a text by a console; nothing is written to it."""

_SUMMARY_WIDTH = 160
_SUMMARY_HEIGHT = 1000


class Screen:
    """A result as Rich draws it; the layout depends on the width at the moment of drawing.

    Parameters
    ----------
    analysis : Analysis
        The result so far.
    trends : Trends
        Where its coefficients are heading.
    keys : str
        A last line, e.g. which keys do what.
    of_whole : str
        What follows the time of the run: of how much, and what is left.
    recorded : (float, int), optional
        Time and samples that have come by now, where the result is older.
    curves : {'none', 'both', 'gyroscope', 'accelerometer'}
        Allan curves to draw where there is room.
    explain_keys : bool
        Explain keys and signs in the place of the details.
    is_final : bool
        All numbers are those of the whole run; none needs to say how old it is.
    """

    def __init__(
        self,
        analysis: Analysis,
        trends: Trends,
        keys: str = "",
        of_whole: str = "",
        recorded: tuple[float, int] | None = None,
        curves: Curves = "none",
        explain_keys: bool = False,
        is_final: bool = False,
    ) -> None:
        self._analysis = analysis
        self._trends = trends
        self._keys = keys
        self._of_whole = of_whole
        self._recorded = recorded or (analysis.duration_s, analysis.samples)
        self._curves = curves
        self._explain_keys = explain_keys
        self._is_final = is_final

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        wide = options.max_width >= _WIDE
        width, height = options.max_width, options.height or console.height
        known = verdict(self._analysis)
        top: list[Text | Table] = [self._header(), self._run(width)]
        said = [_verdict_text(line) for line in known.lines]
        if known.banner:
            said.insert(0, Text(known.banner, style=_style(GRADE["bad"])))
        most = max(3 if width < _NARROW else 2, height // _ROWS_A_LINE)
        three = [row for text in said for row in _folded(text, width, most)]
        table, laws = self._axes(wide), self._power_laws(wide)
        room = max(2, height - _LEAST_LINES - table.row_count - laws.row_count - len(three) - 2)
        charts = [] if options.ascii_only else self._charts(width, room)
        room = max(2, room - len(charts))
        if self._explain_keys:
            details = [Text(part) for line in _HELP for part in _columns(line, width)]
        else:
            details = _details(known.details, room, width, most)
        below: list[Text | Table] = [Text(), laws] if laws.row_count else []
        below += [*charts, *([Text(), *details] if details else [])]
        yield Group(*top, *three, self._as_of(), table, *below)
        if self._keys:
            yield _joined([Text(part) for part in self._keys.split(_BETWEEN)], width, "dim")

    def _charts(self, width: int, room: int) -> list[Text]:
        """Return an empty line and the Allan curves; nothing where there is no room for them."""
        sensors = {
            sensor: {k: axis for k, axis in self._analysis.axes.items() if axis.unit == unit}
            for unit, sensor in SENSOR_NAMES.items()
            if self._curves in ("both", sensor)
        }
        shown = [axes for axes in sensors.values() if axes]
        if not shown:
            return []
        height = min(_MOST_CHART_LINES, room - _DETAILS_BESIDE_CHART - 1)
        if len(shown) > 1 and width < _SIDE_BY_SIDE:
            shown = shown[: max(1, (height + 1) // (LEAST_LINES + 1))]
            height = (height + 1) // len(shown) - 1
            charts = [[Text(), *curve_lines(axes, width, height)] for axes in shown]
            return [line for chart in charts if len(chart) > 1 for line in chart]
        each = (width - 2 * (len(shown) - 1)) // len(shown)
        return _beside([curve_lines(axes, each, height) for axes in shown], each)

    def _header(self) -> Table:
        known = self._analysis
        names = (known.part, known.input.get("name", ""), known.input.get("wire", ""))
        line = Table.grid(expand=True)
        line.add_column(no_wrap=True, overflow="ellipsis", ratio=1)
        line.add_column(no_wrap=True, justify="right")
        device = Text("allanscope  ", style="bold")
        device.append("  ".join(one_line(name) for name in names if name), style="not bold")
        recorded = recorded_text(self._analysis, self._recorded[0])
        line.add_row(device, Text(f"recorded {recorded}{self._of_whole}", style="bold"))
        return line

    def _run(self, width: int) -> Text:
        """Return how the run stands; what is least important is left out where there is no room."""
        known = self._analysis
        lost = known.lost_samples or known.unknown_losses
        parts = [
            Text(rate_text(known.rate)),
            Text(losses_phrase(known), style="bold" if lost else ""),
            Text(f"{count(self._recorded[1])} samples"),
        ]
        if known.reconnects:
            parts.append(Text(counted(known.reconnects, "reconnection")))
        if known.temperature:
            parts.append(Text(f"{known.temperature['last']:.1f} °C"))
        clock = clock_text(known.rate)
        if clock:
            parts.append(Text(clock, style="dim"))
        return _joined(parts, width)

    def _as_of(self) -> Text:
        """Return how old the numbers are; of a final result, what its signs mean."""
        moments = _SIGNS if self._is_final else as_of_text(self._analysis.axes)
        return Text(moments, style="dim", no_wrap=True, overflow="ellipsis")

    def _axes(self, wide: bool) -> Table:
        table = _grid(len(MAIN_LETTERS) + (3 if wide else 0))
        for unit in SENSOR_NAMES:
            axes = {k: axis for k, axis in self._analysis.axes.items() if axis.unit == unit}
            if axes:
                table.add_row(*self._head(unit, wide))
            for name, axis in axes.items():
                table.add_row(*self._row(name, axis, wide))
                quiet = self._analysis.undisturbed
                if quiet is not None and name in quiet.axes:
                    table.add_row(*_undisturbed_row(axis.unit, quiet.axes[name], wide))
        return table

    def _power_laws(self, wide: bool) -> Table:
        """Return the power laws that were asked for; a table without rows where none were."""
        known = {name: axis for name, axis in self._analysis.axes.items() if axis.power_laws}
        shown = {letter for axis in known.values() for letter in axis.power_laws}
        letters = [letter for letter in POWER_LAW_NAMES if letter in shown]
        table = _grid(len(letters))
        for unit in SENSOR_NAMES:
            axes = {name: axis for name, axis in known.items() if axis.unit == unit}
            if axes:
                heads = (f"{letter}  {coefficient_unit(unit, letter)}" for letter in letters)
                table.add_row(*(Text(cell, style="dim") for cell in ("power laws", *heads)))
            for name, axis in axes.items():
                cells = (_cell(unit, k, axis.power_laws.get(k), wide) for k in letters)
                table.add_row(Text(name, style=_style(AXIS[name])), *cells)
        return table

    def _head(self, unit: str, wide: bool) -> list[Text]:
        cells = ["", *(f"{letter}  {coefficient_unit(unit, letter)}" for letter in MAIN_LETTERS)]
        if wide:
            deviation = symbols(DEVIATION[unit].unit)
            cells += [f"{MINIMUM}, {deviation}", DATASHEET, MODEL_ERRORS["rms_percent"]]
        return [Text(cell, style="dim") for cell in cells]

    def _row(self, name: str, axis: AxisAnalysis, wide: bool) -> list[Text]:
        cells = [Text(name, style=_style(AXIS[name]))]
        cells += [self._coefficient(name, axis, letter, wide) for letter in MAIN_LETTERS]
        if wide:
            cells += [Text(best_text(axis)), Text(density_verdict(axis)), Text(_residual(axis))]
        return cells

    def _coefficient(self, name: str, axis: AxisAnalysis, letter: str, wide: bool) -> Text:
        known = axis.coefficients.get(letter)
        cell = _cell(axis.unit, letter, known, wide)
        if known is None or not known.detected or self._is_final:
            return cell
        return cell.append(f" {_ARROWS[self._trends.direction(self._analysis, name, letter)]}")


def _grid(columns: int) -> Table:
    """Return an empty table of a name and so many columns."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=False)
    for _ in range(columns + 1):
        table.add_column(no_wrap=True, overflow="ellipsis")
    return table


def _undisturbed_row(unit: str, known: Mapping[str, Coefficient], wide: bool) -> list[Text]:
    """Return the coefficients of the longest undisturbed stretch, below those of the whole."""
    cells = (_cell(unit, letter, known.get(letter), wide) for letter in MAIN_LETTERS)
    return [Text(cell.plain, style="dim") for cell in (Text("undisturbed"), *cells)]


def _cell(unit: str, letter: str, known: Coefficient | None, wide: bool) -> Text:
    """Return a coefficient with its interval, or with its errors where there is less room."""
    if known is None or not known.detected:
        return Text(coefficient_text(unit, letter, known), style="dim")
    if wide:
        return Text(coefficient_text(unit, letter, known))
    reading = COEFFICIENTS[unit, letter][0]
    return Text(symbols(reading.compact(known.value, known.lower, known.upper)))


def _beside(charts: Sequence[Sequence[Text]], width: int) -> list[Text]:
    """Return the lines of charts that stand beside each other, after an empty one."""
    lines: list[Text] = []
    for row in zip(*(chart for chart in charts if chart), strict=True):
        line = Text(no_wrap=True)
        for part in row:
            part.pad_right(width - part.cell_len)
            line.append_text(part).append("  ")
        line.rstrip()
        lines.append(line)
    return [Text(), *lines] if lines else []


def _details(lines: Sequence[VerdictLine], room: int, width: int, most: int) -> list[Text]:
    """Return what is behind the verdict in at most `room` lines, `most` for a long detail."""
    rows: list[Text] = []
    for number_of, line in enumerate(lines):
        folded = _folded(_verdict_text(line), width, most)
        still = len(lines) - number_of
        if len(folded) > room - len(rows) - (still > 1):
            rows.append(Text(f"and {counted(still, 'more line')}: see the report"))
            break
        rows += folded
    return rows


def _verdict_text(line: VerdictLine) -> Text:
    text = Text(sanitize(line.head), style=_style(GRADE[line.grade]))
    text.append(f": {sanitize(line.text)}", style="not bold default")
    return text


def _folded(text: Text, width: int, most: int) -> list[Text]:
    """Return the rows of a text, folded between words, at most so many."""
    rows = list(text.wrap(_FOLDING, width))
    if len(rows) > most:
        rows = [*rows[: most - 1], Text(" ").join(rows[most - 1 :])]
        rows[-1].truncate(width, overflow="ellipsis")
    return rows


def _columns(line: str, width: int) -> list[str]:
    """Return a line, or the columns of one that is too wide."""
    return [line] if len(line) <= width else re.split(" {3,}", line)


def _joined(parts: Sequence[Text], width: int, style: str = "") -> Text:
    """Return as many parts as fit one row, the first always."""
    line = Text(style=style, no_wrap=True, overflow="ellipsis")
    for part in parts:
        between = _BETWEEN if line else ""
        if line and line.cell_len + len(between) + part.cell_len > width:
            break
        line.append(between).append_text(part)
    return line


def _residual(axis: AxisAnalysis) -> str:
    if axis.is_constant:
        return "constant"
    if axis.explanation is None:
        return "-"
    if not was_searched(axis.explanation):
        return "not searched"
    after = axis.explanation.after
    text = f"{number(after.rms_percent, 2)} (expected {number(after.expected_rms_percent, 2)})"
    return text if axis.explanation.explained else f"{text}, partly unexplained"


def _style(colour: Colour) -> str:
    return "bold rgb({},{},{})".format(*colour)


def status_line(analysis: Analysis) -> str:
    """Return how a run stands, in one line: rate, losses, temperature, N of every axis."""
    parts = [
        rate_text(analysis.rate),
        f"{count(analysis.samples)} samples",
        losses_phrase(analysis),
    ]
    if analysis.temperature:
        parts.append(f"{analysis.temperature['last']:.1f} °C")
    for unit in ("dps", "g"):
        reading = COEFFICIENTS[unit, "N"][0]
        known = [
            f"{name} {number(axis.coefficients['N'].value * reading.factor)}"
            for name, axis in analysis.axes.items()
            if axis.unit == unit and "N" in axis.coefficients
        ]
        if known:
            parts.append(f"N {' '.join(known)} {symbols(reading.unit)}")
    simulated = simulation_notice(analysis.origin)
    if simulated is not None:
        parts.append(simulated[0].lower())
    return ", ".join(parts)


def summary_lines(analysis: Analysis) -> list[str]:
    """Return the result as the lines that a command prints at its end, without any colour."""
    page = io.StringIO()
    width = _SUMMARY_WIDTH
    if sys.stdout.isatty():
        width = min(width, shutil.get_terminal_size((width, 24)).columns)
    console = Console(
        file=page,
        width=width,
        height=_SUMMARY_HEIGHT,
        color_system=None,
        force_terminal=False,
        legacy_windows=False,
    )
    console.print(Screen(analysis, Trends(), is_final=True))
    return [line.rstrip() for line in page.getvalue().rstrip().splitlines()]
