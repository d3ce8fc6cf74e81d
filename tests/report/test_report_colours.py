"""Colours that everybody can read and tell apart, of the report and of the viewer.

Contrast is that of WCAG 2.2 (relative luminance; 4.5 for text, 3 for graphics). Colours are seen as
in Machado, Oliveira and Fernandes (2009), severity 1.0, and compared by their distance in CIELAB.
"""

import re
from importlib.resources import files
from itertools import combinations

import numpy as np
import pytest

from allanscope import colours
from allanscope.report.picture import BEFORE, COMPONENT, CYCLE, DATASHEET, FOUND, MEASURED, MODEL
from allanscope.view import palette
from allanscope.view.palette import AXIS, ESTIMATOR

SEEN = {
    "normal": np.eye(3),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
TELLABLE = 20.0
"""Least distance in CIELAB; 2.3 is what can just be noticed side by side."""


def linear(colour):
    """Return linear RGB of ``#rrggbb`` or of three bytes."""
    if isinstance(colour, str):
        colour = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    value = np.asarray(colour[:3], float) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def contrast(first, second):
    light = sorted(float(linear(c) @ [0.2126, 0.7152, 0.0722]) for c in (first, second))
    return (light[1] + 0.05) / (light[0] + 0.05)


def lab(rgb):
    """Return CIELAB (D65) of linear RGB."""
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = np.array(to_xyz) @ np.clip(rgb, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def themes():
    css = (files("allanscope.report") / "templates/page.css").read_text("utf-8")
    found = re.findall(r":root \{([^}]*--ink[^}]*)\}", css)
    return [dict(re.findall(r"--(\w+): (#\w{6})", one)) for one in found]


@pytest.mark.parametrize("theme", themes(), ids=["light", "dark", "print"])
def test_every_text_of_the_page_has_enough_contrast(theme):
    for name in ("ink", "soft", "good", "bad", "note"):
        for ground in ("paper", "wash"):
            assert contrast(theme[name], theme[ground]) >= 4.5, (name, ground)


def test_the_contrast_is_that_of_wcag():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("theme", themes(), ids=["light", "dark", "print"])
def test_every_curve_of_the_page_has_enough_contrast(theme):
    """WCAG 2.2, 1.4.11: graphics need a contrast of 3."""
    for colour in (MEASURED, MODEL, BEFORE, COMPONENT, DATASHEET, FOUND, *CYCLE):
        for ground in ("paper", "wash"):
            assert contrast(colour, theme[ground]) >= 3.0, (colour, ground)


@pytest.mark.parametrize("seen", SEEN)
@pytest.mark.parametrize(
    "together",
    [
        (MEASURED, MODEL, BEFORE, COMPONENT, DATASHEET, FOUND),
        colours.CYCLE,
        (*list(AXIS.values())[:3], palette.MODEL, palette.EFFECT, palette.REFERENCE),
        (*list(AXIS.values())[3:], palette.MODEL, palette.EFFECT, palette.REFERENCE),
        tuple(dict.fromkeys(ESTIMATOR.values())),
    ],
    ids=["report", "cycle", "viewer gyro", "viewer accel", "estimators"],
)
def test_colours_that_stand_together_can_be_told_apart(together, seen):
    points = [lab(SEEN[seen] @ linear(colour)) for colour in together]
    near = min(float(np.linalg.norm(a - b)) for a, b in combinations(points, 2))
    assert near >= TELLABLE


def test_red_and_green_of_one_lightness_would_not_pass():
    points = [lab(SEEN["deuteranopia"] @ linear(one)) for one in ("#bb5500", "#6f7a00")]
    assert np.linalg.norm(points[0] - points[1]) < TELLABLE
