"""A picture: how it is drawn, once for the page and once for a file, and many of them at once.

Colours and order are the same in every picture. On the page, text stays text, so that it can be
searched, and takes the page's own ink, so that one picture serves the light and the dark page. A
file has black ink on white.

On the page a chart shows its numbers: the values where the mouse points are written into the
chart, without any script; and a link below it holds the numbers as CSV.

Two things make drawing fast. matplotlib makes an object of each tick, with two marks, a grid line
and two labels, and lays all of them out in each drawing: two thirds of the time of a chart of
lines. Without zooming and moving, its locators and formatters say where the ticks are and what
stands there, and a few paths do (`draw_plain_axes`). And drawing is plain Python, which computes on
one core, while the pictures do not depend on each other: a copy of the process (fork) has
everything that there is to draw and gives back text (`draw_forked`).
"""

from __future__ import annotations

import base64
import io
import os
import pickle
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.rcsetup import cycler
from matplotlib.transforms import ScaledTranslation, Transform
from numpy.typing import ArrayLike, NDArray

from allanscope import colours
from allanscope.colours import BLUE, GREEN, INDIGO, ORANGE, PURPLE, RED, hexadecimal

__all__ = [
    "BEFORE",
    "COMPONENT",
    "CYCLE",
    "DATASHEET",
    "FOUND",
    "MEASURED",
    "MODEL",
    "Picture",
    "draw_forked",
    "draw_plain_axes",
    "ink",
]

MEASURED, MODEL, COMPONENT, BEFORE, FOUND, DATASHEET = map(
    hexadecimal, (BLUE, RED, GREEN, PURPLE, ORANGE, INDIGO)
)
"""What each colour means in every picture of the report."""

CYCLE = tuple(map(hexadecimal, colours.CYCLE))

_PAGE_INK = "#808080"
"""Stands for the page's own ink until the picture is put there."""
_FILE_INK = "#24292f"
_DOTS_PER_INCH = 150
_POINTS_PER_INCH = 72
_MARGINS = {"left": 0.72, "bottom": 0.48, "right": 0.12, "top": 0.1}
"""In inches, so that every picture has its frame in the same place, and none has to be laid out."""
_READOUT_DIGITS = 6
_LINE_POINTS = 11.0
"""From line to line of what is read with the mouse."""

_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "allanscope",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.prop_cycle": cycler(color=CYCLE),
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "path.simplify": True,
}
_INKED = (
    "axes.edgecolor",
    "axes.labelcolor",
    "grid.color",
    "text.color",
    "xtick.color",
    "ytick.color",
)
_PAPER = ("figure.facecolor", "axes.facecolor", "savefig.facecolor")
# No date in a file: the same result gives the same bytes.
_NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))

_GRID_ORDER = 1.5
"""Above filled areas, below lines."""
_NAME_BELOW = 0.26
"""Distance in inches of the name of a horizontal axis from the frame."""
_DIGIT_INCHES, _BESIDE_DIGITS, _MOST_BESIDE = 0.08, 0.1, 0.62
"""Width of a digit; distance of the name of a vertical axis from its labels, and from the frame."""

_MOST_FORKED = 255
"""Numbers that are one byte."""


@dataclass(frozen=True, slots=True)
class Picture:
    """Something to be drawn.

    Attributes
    ----------
    draw : callable
        Draws into an empty figure.
    width, height : float
        In inches.
    columns : callable, optional
        Returns the numbers behind it, by the names of their columns.
    readout : callable, optional
        Returns the text shown at places on the horizontal axis of its first chart.
    fixed : bool
        Whether the usual margins do; else matplotlib finds them, which takes as long as drawing.
    """

    draw: Callable[[Figure], None]
    width: float = 7.0
    height: float = 4.2
    columns: Callable[[], Mapping[str, ArrayLike]] | None = None
    readout: Callable[[], Sequence[tuple[float, str]]] | None = None
    fixed: bool = True

    def svg(self) -> str:
        """Return it as an element for the page."""
        data, figure = self._rendered("svg", _PAGE_INK, "none")
        text = data.decode("utf-8")
        text = text[text.index("<svg") :].replace(_PAGE_INK, "currentColor")
        text = re.sub(r'id="(series-\w+)"', r'class="\1"', text)
        if self.readout is None:
            return text
        return text.replace("</svg>", f"{_readout(figure, self.readout())}</svg>")

    def link(self, name: str) -> str:
        """Return a link to its numbers as CSV, inside the page; empty where it has none."""
        if self.columns is None:
            return ""
        columns = {k: np.asarray(v) for k, v in self.columns().items()}
        rows = zip(*(map(_cell, column.tolist()) for column in columns.values()), strict=True)
        text = "\n".join([",".join(columns), *map(",".join, rows), ""])
        data = base64.b64encode(text.encode()).decode()
        return (
            f'<p class="csv"><a download="{name}.csv" href="data:text/csv;base64,{data}">'
            "numbers as CSV</a></p>"
        )

    def save(self, stem: Path) -> tuple[Path, Path]:
        """Write it as ``stem.svg`` and ``stem.png``, and return their paths."""
        files = stem.with_name(f"{stem.name}.svg"), stem.with_name(f"{stem.name}.png")
        for file in files:
            file.write_bytes(self._rendered(file.suffix[1:], _FILE_INK, "white")[0])
        return files

    def _rendered(self, form: str, colour: str, paper: str) -> tuple[bytes, Figure]:
        inks: Any = dict.fromkeys(_INKED, colour) | dict.fromkeys(_PAPER, paper)
        inks["axes.grid"] = not self.fixed  # else drawn with the ticks
        with mpl.rc_context({**_STYLE, **inks}):
            size = self.width, self.height
            figure = Figure(figsize=size, layout=None if self.fixed else "constrained")
            if self.fixed:
                figure.subplots_adjust(
                    left=_MARGINS["left"] / self.width,
                    right=1.0 - _MARGINS["right"] / self.width,
                    bottom=_MARGINS["bottom"] / self.height,
                    top=1.0 - _MARGINS["top"] / self.height,
                    hspace=0.08,
                )
            self.draw(figure)
            if self.fixed:
                draw_plain_axes(figure)
            buffer = io.BytesIO()
            metadata: Any = _NO_METADATA if form == "svg" else {"Software": None}
            figure.savefig(buffer, format=form, dpi=_DOTS_PER_INCH, metadata=metadata)
        return buffer.getvalue(), figure


def ink() -> str:
    """Return the colour of axes and text while something is drawn."""
    return str(mpl.rcParams["text.color"])


def _readout(figure: Figure, readout: Sequence[tuple[float, str]]) -> str:
    """Return bands over the first chart, each with what is written while the mouse is on it."""
    ax = figure.axes[0]
    inside = [(x, text) for x, text in readout if x > 0]
    if not inside or ax.get_xscale() != "log":
        return ""
    width, height = (_POINTS_PER_INCH * inches for inches in figure.get_size_inches())
    frame = ax.get_position()
    left, right = width * frame.x0, width * frame.x1
    top, bottom = height * (1.0 - frame.y1), height * (1.0 - frame.y0)
    low, high = np.log(ax.get_xlim())
    inside.sort(key=lambda one: one[0])
    at = left + (right - left) * (np.log([x for x, _ in inside]) - low) / (high - low)
    edges = np.concatenate([[left], (at[1:] + at[:-1]) / 2, [right]])
    return "".join(
        f'<g class="at"><rect x="{first:.1f}" y="{top:.1f}" width="{last - first:.1f}" '
        f'height="{bottom - top:.1f}" fill="none" pointer-events="all"/>'
        f'<path d="M{x:.1f} {top:.1f}V{bottom:.1f}" stroke="currentColor" stroke-width=".6"/>'
        f"{_lines(text, left + 6.0, bottom - 6.0)}</g>"
        for x, first, last, (_, text) in zip(at, edges, edges[1:], inside, strict=False)
        if left <= x <= right and last > first
    )


def _lines(text: str, x: float, bottom: float) -> str:
    """Return the lines of a text, the last one at the bottom."""
    lines = text.split("\n")
    top = bottom - _LINE_POINTS * (len(lines) - 1)
    rows = (
        f'<tspan x="{x:.1f}" y="{top + _LINE_POINTS * k:.1f}">{escape(line)}</tspan>'
        for k, line in enumerate(lines)
    )
    return f'<text font-size="9">{"".join(rows)}</text>'


def _cell(value: object) -> str:
    return f"{value:.{_READOUT_DIGITS}g}" if isinstance(value, float) else str(value)


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


def draw_forked(tasks: Mapping[str, Callable[[], str]]) -> dict[str, str]:
    """Return what each task returns, half of them done by a copy of this process.

    For a process with a single thread: of others a copy may wait for ever. Where there is no fork,
    and for what the copy leaves undone, the tasks are done here.

    Parameters
    ----------
    tasks : mapping of str to callable
        Each returns a text.

    Examples
    --------
    >>> draw_forked({"gx": lambda: "<svg>1</svg>", "gy": lambda: "<svg>2</svg>"})
    {'gx': '<svg>1</svg>', 'gy': '<svg>2</svg>'}
    """
    names = list(tasks)
    if not hasattr(os, "fork") or not 1 < len(names) <= _MOST_FORKED:
        return {name: task() for name, task in tasks.items()}
    numbers, filling = os.pipe()
    os.write(filling, bytes(range(len(names))))
    os.close(filling)
    answer, answering = os.pipe()
    copy = os.fork()
    if copy == 0:
        try:
            with os.fdopen(answering, "wb") as pipe:
                pickle.dump({names[k]: tasks[names[k]]() for k in _taken(numbers)}, pipe)
        finally:
            os._exit(0)  # without what the end of a process does: the pipes are not ours
    os.close(answering)
    try:
        with os.fdopen(answer, "rb") as pipe:
            done = {names[k]: tasks[names[k]]() for k in _taken(numbers)}
            text = pipe.read()
    finally:
        os.waitpid(copy, 0)
        os.close(numbers)
    if text.endswith(pickle.STOP):
        done |= pickle.loads(text)
    return {name: done[name] if name in done else task() for name, task in tasks.items()}


def _taken(numbers: int) -> Iterator[int]:
    """Yield numbers from a pipe until nobody has put any more there."""
    while taken := os.read(numbers, 1):
        yield taken[0]
