"""Seven colours for everything that is drawn, in the report, the viewer, the terminal and plots.

Each has a contrast of at least 3 (WCAG 2.2, graphics) with a white and with a black page, and with
the grey that the viewer sets behind a label on either theme. Their hues are near those of Okabe and
Ito (2008); lightness was chosen so that any two of them keep a distance of 20 in CIELAB to readers
with normal sight, deuteranopia, protanopia and tritanopia (Machado, Oliveira and Fernandes 2009).
``tests/report/test_report_colours.py`` computes both.
"""

from __future__ import annotations

__all__ = [
    "BLUE",
    "CYCLE",
    "GREEN",
    "GREY",
    "INDIGO",
    "ORANGE",
    "PURPLE",
    "RED",
    "Colour",
    "hexadecimal",
]

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

BLUE: Colour = (40, 135, 251)
INDIGO: Colour = (89, 101, 177)
GREEN: Colour = (6, 145, 75)
ORANGE: Colour = (203, 114, 1)
RED: Colour = (202, 45, 43)
PURPLE: Colour = (171, 119, 169)
GREY: Colour = (107, 107, 107)

CYCLE = (BLUE, RED, GREEN, PURPLE, ORANGE, INDIGO, GREY)
"""The order in which curves of one chart take them."""


def hexadecimal(colour: Colour) -> str:
    """Return a colour as CSS and matplotlib write it.

    Examples
    --------
    >>> hexadecimal((255, 0, 16))
    '#ff0010'
    """
    return "#{:02x}{:02x}{:02x}".format(*colour)
