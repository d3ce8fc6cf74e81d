"""What is drawn: strips, dots and words in world units, gathered for one entity of the viewer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from allanscope.view.chart import Chart, Points, Strips, dashed
from allanscope.view.palette import GRID, TEXT, Colour

__all__ = ["Drawing", "draw_grid"]


@dataclass(slots=True)
class Drawing:
    """Strips and dots, each with its colour and radius, and words that are always shown.

    Radii follow the viewer: positive in world units, negative in points of the screen.
    """

    strips: Strips = field(default_factory=list)
    strip_colours: list[Colour] = field(default_factory=list)
    strip_radii: list[float] = field(default_factory=list)
    dots: list[Points] = field(default_factory=list)
    dot_colours: list[Colour] = field(default_factory=list)
    dot_radii: list[float] = field(default_factory=list)
    dot_texts: list[str] = field(default_factory=list)
    words: list[tuple[tuple[float, float], str, Colour]] = field(default_factory=list)

    def line(self, strips: Strips, colour: Colour, width: float = 2.0) -> None:
        """Add polylines `width` points of the screen wide."""
        self._add(strips, colour, -width / 2)

    def dashes(self, strips: Strips, colour: Colour, width: float = 1.4) -> None:
        """Add polylines as dashes."""
        self._add(dashed(strips), colour, -width / 2)

    def dot(
        self,
        points: Points,
        texts: Sequence[str],
        colour: Colour,
        size: float = 4.0,
    ) -> None:
        """Add dots `size` points of the screen across that say their text when pointed at."""
        self.dots += list(points)
        self.dot_colours += [colour] * len(points)
        self.dot_radii += [-size / 2] * len(points)
        self.dot_texts += texts

    def word(self, at: tuple[float, float], text: str, colour: Colour) -> None:
        """Add a word, centred."""
        self.words.append((at, text, colour))

    def _add(self, strips: Strips, colour: Colour, radius: float) -> None:
        self.strips += strips
        self.strip_colours += [colour] * len(strips)
        self.strip_radii += [radius] * len(strips)


def draw_grid(chart: Chart) -> Drawing:
    """Return the grid of a chart with its labels; grey that reads on either theme."""
    drawing = Drawing()
    major, minor = chart.grid()
    drawing.line([*minor, *major], GRID, width=0.5)
    for at, text in chart.labels():
        drawing.word(at, text, TEXT)
    return drawing
