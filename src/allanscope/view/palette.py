"""What each colour means in the viewer and the terminal.

One meaning has one colour in every chart: x, y and z of either sensor; the model; what was found
beyond the model; the datasheet. Estimators other than the default one take a colour by family and
carry their name at the end of the curve, because seventeen colours cannot be told apart.
None is translucent: the viewer draws every strip opaque, and what was meant to be faint comes out
nearly black. What is to be faint is `muted`, a mixture with the grey that lies between both themes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.colours import BLUE, GREEN, GREY, INDIGO, ORANGE, PURPLE, RED, Colour

__all__ = [
    "AXIS",
    "EFFECT",
    "ESTIMATOR",
    "GRADE",
    "GRID",
    "LINK",
    "MODEL",
    "NAMED",
    "REFERENCE",
    "TEXT",
    "Colour",
    "muted",
    "ratio_colours",
]

RATIO_COLOURS = ((0, 60, 140), (86, 180, 233), (235, 235, 235), (230, 159, 0), (140, 30, 0))
RATIO_STEPS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Ratios at which a map has these colours: blue is less than usual, red more."""


def ratio_colours(ratio: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return red, green, blue and opacity of each ratio; what is not known is not seen."""
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.log(ratio)
    steps = np.log(RATIO_STEPS)
    known = np.isfinite(place)
    place = np.where(known, place, 0.0)
    parts = [np.interp(place, steps, column) for column in zip(*RATIO_COLOURS, strict=True)]
    return np.stack([*parts, np.where(known, 255.0, 0.0)], axis=-1).astype(np.uint8)


def muted(colour: Colour) -> Colour:
    """Return a colour that stands back: half of it, and grey for the rest.

    Examples
    --------
    >>> muted((228, 128, 28))
    (178, 128, 78)
    """
    red, green, blue = (round(0.5 * c + 64) for c in colour)
    return red, green, blue


AXIS: dict[str, Colour] = {
    "gx": RED,
    "gy": GREEN,
    "gz": BLUE,
    "ax": RED,
    "ay": GREEN,
    "az": BLUE,
}
"""Measured data, by axis."""

NAMED = {RED: "red", GREEN: "green", BLUE: "blue"}
"""What people call the colours of the axes."""

MODEL = PURPLE
"""The fitted model, its total and its parts."""

EFFECT = ORANGE
"""Effects, beyond the noise model."""

REFERENCE = GREY
"""What curves are compared with: datasheet, noise model alone, earlier session or mask."""

GRADE: dict[str, Colour] = {"good": GREEN, "bad": RED, "note": ORANGE}
"""How good a thing is."""

GRID = (128, 128, 128)
TEXT = (122, 122, 122)
"""As far from the black of the dark theme as from the white of the light one."""

LINK: dict[str, Colour] = {"streaming": GREEN, "gap": RED, "restarted": ORANGE}
"""What the link is doing."""

_VIOLET: Colour = (136, 56, 248)

_FAMILIES: dict[Colour, tuple[str, ...]] = {
    GREY: ("stdev", "ostdev", "adev", "totdev", "pdev"),
    INDIGO: ("mdev", "mtotdev", "tdev", "ttotdev"),
    _VIOLET: ("hdev", "ohdev", "htotdev"),
    ORANGE: ("theo1", "theobr", "theoh"),
}

ESTIMATOR: dict[str, Colour] = {
    kind: colour for colour, kinds in _FAMILIES.items() for kind in kinds
}
"""Estimators by family: classical, modified, Hadamard, Theo. ``oadev`` has its axis' colour."""
