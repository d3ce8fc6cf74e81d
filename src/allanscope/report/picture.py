"""A picture: how it is drawn, once for the page and once for a file.

Colours and order are the same in every picture. On the page, text stays text, so that it can be
searched, and takes the page's own ink, so that one picture serves the light and the dark page. A
file has black ink on white.

On the page a chart shows its numbers: the values where the mouse points are written into the
chart, without any script; and a link below it holds the numbers as CSV.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler
from numpy.typing import ArrayLike

from allanscope import colours
from allanscope.colours import BLUE, GREEN, INDIGO, ORANGE, PURPLE, RED, hexadecimal
from allanscope.report.plain_axes import draw_plain_axes

__all__ = [
    "BEFORE",
    "COMPONENT",
    "CYCLE",
    "DATASHEET",
    "FOUND",
    "MEASURED",
    "MODEL",
    "Picture",
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
