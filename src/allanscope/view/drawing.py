"""What is drawn: strips, dots and words in world units, gathered for one entity of the viewer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from allanscope.view.chart import Chart, Points, Strips, dashed
from allanscope.view.palette import GRID, TEXT, Colour

__all__ = ["Drawing", "draw_grid"]

_Rgba = tuple[int, int, int, int]


@dataclass(slots=True)
class Drawing:
    """Strips and dots, each with its colour and radius, and words that are always shown.

    Radii follow the viewer: positive in world units, negative in points of the screen.
    """

    strips: Strips = field(default_factory=list)
    strip_colours: list[_Rgba] = field(default_factory=list)
    strip_radii: list[float] = field(default_factory=list)
    dots: list[Points] = field(default_factory=list)
    dot_colours: list[_Rgba] = field(default_factory=list)
    dot_radii: list[float] = field(default_factory=list)
    dot_texts: list[str] = field(default_factory=list)
    words: list[tuple[tuple[float, float], str, Colour]] = field(default_factory=list)

    def line(self, strips: Strips, colour: Colour, width: float = 2.0, alpha: int = 255) -> None:
        """Add polylines `width` points of the screen wide."""
        self._add(strips, (*colour, alpha), -width / 2)

    def dashes(self, strips: Strips, colour: Colour, width: float = 1.4, alpha: int = 255) -> None:
        """Add polylines as dashes."""
        self._add(dashed(strips), (*colour, alpha), -width / 2)

    def hatch(self, strips: Strips, colour: Colour, pitch: float, alpha: int) -> None:
        """Add strips `pitch` world units wide, so that neighbours touch and fill an area."""
        self._add(strips, (*colour, alpha), pitch / 2)

    def dot(
        self,
        points: Points,
        texts: Sequence[str],
        colour: Colour,
        size: float = 4.0,
        alpha: int = 255,
    ) -> None:
        """Add dots `size` points of the screen across that say their text when pointed at."""
        self.dots += list(points)
        self.dot_colours += [(*colour, alpha)] * len(points)
        self.dot_radii += [-size / 2] * len(points)
        self.dot_texts += texts

    def word(self, at: tuple[float, float], text: str, colour: Colour) -> None:
        """Add a word, centred."""
        self.words.append((at, text, colour))

    def _add(self, strips: Strips, colour: _Rgba, radius: float) -> None:
        self.strips += strips
        self.strip_colours += [colour] * len(strips)
        self.strip_radii += [radius] * len(strips)


def draw_grid(chart: Chart) -> Drawing:
    """Return the grid of a chart with its labels; grey that reads on either theme."""
    drawing = Drawing()
    major, minor = chart.grid()
    drawing.line(minor, GRID, width=1.0, alpha=24)
    drawing.line(major, GRID, width=1.2, alpha=90)
    for at, text in chart.labels():
        drawing.word(at, text, TEXT)
    return drawing
