"""A picture: how it is drawn, once for the page and once for a file.

Colours and order are the same in every picture. On the page, text stays text, so that it can be
searched, and takes the page's own ink, so that one picture serves the light and the dark page. A
file has black ink on white.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

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

MEASURED, MODEL, BEFORE, COMPONENT, DATASHEET, FOUND = (
    "#0072B2",
    "#D55E00",
    "#CC79A7",
    "#009E73",
    "#56B4E9",
    "#E69F00",
)
"""Okabe and Ito's palette, which the colour-blind can tell apart."""

CYCLE = (MEASURED, MODEL, COMPONENT, BEFORE, FOUND, DATASHEET, "#7f7f7f")

_PAGE_INK = "#808080"
"""Stands for the page's own ink until the picture is put there."""
_FILE_INK = "#24292f"
_DOTS_PER_INCH = 150

_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "allanscope",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.grid": True,
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
    """

    draw: Callable[[Figure], None]
    width: float = 7.0
    height: float = 4.2

    def svg(self) -> str:
        """Return it as an element for the page."""
        text = self._rendered("svg", _PAGE_INK, "none").decode("utf-8")
        return text[text.index("<svg") :].replace(_PAGE_INK, "currentColor")

    def save(self, stem: Path) -> tuple[Path, Path]:
        """Write it as ``stem.svg`` and ``stem.png``, and return their paths."""
        files = stem.with_name(f"{stem.name}.svg"), stem.with_name(f"{stem.name}.png")
        for file in files:
            file.write_bytes(self._rendered(file.suffix[1:], _FILE_INK, "white"))
        return files

    def _rendered(self, form: str, colour: str, paper: str) -> bytes:
        colours: Any = dict.fromkeys(_INKED, colour) | dict.fromkeys(_PAPER, paper)
        with mpl.rc_context({**_STYLE, **colours}):
            figure = Figure(figsize=(self.width, self.height), layout="constrained")
            self.draw(figure)
            buffer = io.BytesIO()
            metadata: Any = _NO_METADATA if form == "svg" else {"Software": None}
            figure.savefig(buffer, format=form, dpi=_DOTS_PER_INCH, metadata=metadata)
        return buffer.getvalue()


def ink() -> str:
    """Return the colour of axes and text while something is drawn."""
    return str(mpl.rcParams["text.color"])
