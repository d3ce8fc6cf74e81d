"""Colours: those of Okabe and Ito (2008), which colour-blind readers can tell apart.

One meaning has one colour in every chart: x, y and z of either sensor; the model; what was found
beyond the model; the datasheet. Estimators other than the default one take a colour by family and
carry their name at the end of the curve, because seventeen colours can be told apart by nobody.
All of them are readable on the dark and on the light theme.
"""

from __future__ import annotations

__all__ = [
    "AXIS",
    "EFFECT",
    "ESTIMATOR",
    "GRADE",
    "GRID",
    "LINK",
    "MODEL",
    "REFERENCE",
    "TEXT",
    "Colour",
]

Colour = tuple[int, int, int]

_ORANGE = (230, 159, 0)
_SKY_BLUE = (86, 180, 233)
_GREEN = (0, 158, 115)
_YELLOW = (240, 228, 66)
_BLUE = (0, 114, 178)
_VERMILLION = (213, 94, 0)
_PURPLE = (204, 121, 167)

AXIS: dict[str, Colour] = {
    "gx": _VERMILLION,
    "gy": _GREEN,
    "gz": _SKY_BLUE,
    "ax": _VERMILLION,
    "ay": _GREEN,
    "az": _SKY_BLUE,
}
"""Measured data, by axis."""

MODEL = _PURPLE
"""The fitted model, its total and its parts."""

EFFECT = _ORANGE
"""What was found beyond the textbook model."""

REFERENCE = (150, 150, 150)
"""What is there to compare with: the datasheet, the textbook model."""

GRADE: dict[str, Colour] = {"good": _GREEN, "bad": _VERMILLION, "note": _ORANGE}
"""How good a thing is."""

GRID = (128, 128, 128)
TEXT = (150, 150, 150)

LINK: dict[str, Colour] = {"streaming": _GREEN, "gap": _VERMILLION, "restarted": _ORANGE}
"""What the link is doing."""

_FAMILIES: dict[Colour, tuple[str, ...]] = {
    (190, 190, 190): ("stdev", "ostdev", "adev", "totdev", "pdev"),
    _BLUE: ("mdev", "mtotdev", "tdev", "ttotdev"),
    _YELLOW: ("hdev", "ohdev", "htotdev"),
    _ORANGE: ("theo1", "theobr", "theoh"),
}

ESTIMATOR: dict[str, Colour] = {
    kind: colour for colour, kinds in _FAMILIES.items() for kind in kinds
}
"""Estimators by family: classical, modified, Hadamard, Theo. ``oadev`` has its axis' colour."""
