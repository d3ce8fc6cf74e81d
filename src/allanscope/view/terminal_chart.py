"""Allan curves in a terminal: dots of braille, two by four to a character.

::

    σ(τ), mdps   gx gy gz
      10 ┤⠑⢄
         │  ⠑⠢⢄
       1 ┤     ⠑⠒⠤⠤
         └┬────┬────┬─
         0.1   1    10 s
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from rich.style import Style
from rich.text import Text

from allanscope.analysis import AxisAnalysis
from allanscope.quantities import DEVIATION, symbols
from allanscope.view.chart import Log
from allanscope.view.chart_builder import DEFAULT_ESTIMATOR
from allanscope.view.palette import AXIS

__all__ = ["LEAST_LINES", "curve_lines"]

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
        title.append(f" {name}", style=_style(name))
    labels = {rows - 1 - round(at * (rows - 1)): text for at, text in sigma.ticks() if text}
    lines = [title]
    for row in range(rows):
        label = f"{labels.get(row, ''):>{_MARGIN - 2}} {'┤' if row in labels else '│'}"
        line = Text().append(label, "dim")
        for cell, name in zip(bits[row], owner[row], strict=True):
            line.append(chr(_BLANK + cell) if cell else " ", style=_style(name) if name else None)
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


def _style(axis: str) -> Style:
    return Style.parse("bold rgb({},{},{})".format(*AXIS[axis]))
