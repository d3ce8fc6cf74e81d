"""Ticks, grid and labels of a chart, drawn as a few lines and texts.

matplotlib makes an object of each tick, with two marks, a grid line and two labels, and lays all of
them out in each drawing: two thirds of the time of a chart of lines. Without zooming and moving,
its locators and formatters say where the ticks are and what stands there, and a few paths do.
"""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation, Transform
from numpy.typing import NDArray

__all__ = ["draw_plain_axes"]

_POINTS_PER_INCH = 72.0
_GRID_ORDER = 1.5
"""Above filled areas, below lines."""
_NAME_BELOW = 0.26
"""Distance in inches of the name of a horizontal axis from the frame."""
_DIGIT_INCHES, _BESIDE_DIGITS, _MOST_BESIDE = 0.08, 0.1, 0.62
"""Width of a digit; distance of the name of a vertical axis from its labels, and from the frame."""


def draw_plain_axes(figure: Figure) -> None:
    """Replace the axes of a figure by lines and texts that look the same.

    Parameters
    ----------
    figure : Figure
        Complete: scales and limits must not change afterwards.
    """
    for ax in figure.axes:
        if ax.get_visible() and ax.axison and not hasattr(ax, "_colorbar"):
            ax.apply_aspect()
            _draw_axis(ax, ax.xaxis, figure)
            _draw_axis(ax, ax.yaxis, figure)


def _draw_axis(ax: Axes, axis: Axis, figure: Figure) -> None:
    style: Any = mpl.rcParams
    is_x = axis is ax.xaxis
    name = "xtick" if is_x else "ytick"
    across = float((figure.get_size_inches() * ax.get_position().size)[int(is_x)])
    along = ax.get_xaxis_transform() if is_x else ax.get_yaxis_transform()
    low, high = sorted(axis.get_view_interval())
    is_labelled = axis.get_tick_params("major").get("labelbottom" if is_x else "labelleft", True)
    longest = 0
    for size, every, formatter in (
        ("major", axis.get_majorticklocs(), axis.get_major_formatter()),
        ("minor", axis.get_minorticklocs(), axis.get_minor_formatter()),
    ):
        ticks = every[(every >= low) & (every <= high)]
        if not ticks.size:
            continue
        length = style[f"{name}.{size}.size"] / _POINTS_PER_INCH
        _strokes(ax, is_x, ticks, -length / across, 0.0).set(
            color=style[f"{name}.color"], linewidth=style[f"{name}.{size}.width"], clip_on=False
        )
        if size == "major":
            _strokes(ax, is_x, ticks, 0.0, 1.0).set(
                color=style["grid.color"],
                alpha=style["grid.alpha"],
                linewidth=style["grid.linewidth"],
            )
        if is_labelled:
            pad = style[f"{name}.{size}.pad"] / _POINTS_PER_INCH
            where = along + _outward(figure, is_x, length + pad)
            texts = formatter.format_ticks(ticks.tolist())
            for tick, text in zip(ticks.tolist(), texts, strict=True):
                _label(ax, is_x, tick, text, where)
            longest = max(longest, *map(len, texts))
    _name(ax, axis, figure, longest)
    axis.set_visible(False)


def _strokes(ax: Axes, is_x: bool, ticks: NDArray[np.float64], first: float, last: float) -> Line2D:
    """Draw a line at each tick, across the axis from one share of the chart to another."""
    places = np.repeat(ticks, 3), np.tile([first, last, np.nan], len(ticks))
    line = Line2D(*(places if is_x else places[::-1]))
    line.set_transform(ax.get_xaxis_transform() if is_x else ax.get_yaxis_transform())
    line.set_zorder(_GRID_ORDER)
    ax.add_artist(line)
    return line


def _outward(figure: Figure, is_x: bool, inches: float) -> Transform:
    """Return a move by so many inches out of the frame, to the side where the axis is."""
    move = (0.0, -inches) if is_x else (-inches, 0.0)
    return ScaledTranslation(*move, figure.dpi_scale_trans)


def _label(ax: Axes, is_x: bool, tick: float, text: str, where: Transform) -> None:
    if text and is_x:
        ax.text(tick, 0.0, text, transform=where, ha="center", va="top")
    elif text:
        ax.text(0.0, tick, text, transform=where, ha="right", va="center_baseline")


def _name(ax: Axes, axis: Axis, figure: Figure, longest: int) -> None:
    """Write the name of the axis, and what its labels are to be multiplied by or added to."""
    text = " ".join(filter(None, (axis.get_label_text(), axis.get_major_formatter().get_offset())))
    if axis is ax.xaxis:
        where = ax.transAxes + _outward(figure, True, _NAME_BELOW)
        ax.text(0.5, 0.0, text, transform=where, ha="center", va="top")
        return
    beside = min(_DIGIT_INCHES * longest + _BESIDE_DIGITS, _MOST_BESIDE)
    where = ax.transAxes + _outward(figure, False, beside)
    ax.text(0.0, 0.5, text, transform=where, ha="right", va="center", rotation=90)
