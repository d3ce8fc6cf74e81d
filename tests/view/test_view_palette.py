"""Colours that can be seen on the dark and on the light theme of the viewer."""

import pytest

from allanscope.view import palette
from allanscope.view.palette import AXIS, ESTIMATOR, TEXT, muted

DARK, LIGHT = (13, 16, 17), (255, 255, 255)
CHIP_DARK, CHIP_LIGHT = (28, 32, 33), (238, 238, 238)
"""What the viewer sets behind a word."""

DRAWN = {
    **{f"axis {name}": colour for name, colour in AXIS.items()},
    **{f"muted {name}": muted(colour) for name, colour in AXIS.items()},
    **ESTIMATOR,
    **{name: getattr(palette, name) for name in ("MODEL", "EFFECT", "REFERENCE", "GRID")},
}


def contrast(one, other):
    """Return the ratio of luminances as WCAG 2 defines it: 1 for none, 21 for black on white."""
    low, high = sorted(
        0.05 + sum(w * _linear(c / 255) for w, c in zip((0.2126, 0.7152, 0.0722), rgb, strict=True))
        for rgb in (one, other)
    )
    return high / low


def _linear(c):
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4


def test_the_contrast_is_that_of_the_standard():
    assert contrast((0, 0, 0), (255, 255, 255)) == pytest.approx(21.0)


@pytest.mark.parametrize("name", list(DRAWN))
def test_what_is_drawn_stands_out_from_either_theme(name):
    """WCAG 2.2, 1.4.11: graphics need a contrast of 3."""
    assert contrast(DRAWN[name], DARK) >= 3.0
    assert contrast(DRAWN[name], LIGHT) >= 3.0


@pytest.mark.parametrize("colour", [TEXT, palette.MODEL, palette.EFFECT, palette.REFERENCE])
def test_labels_can_be_read_on_either_theme(colour):
    assert contrast(colour, CHIP_DARK) > 3.0
    assert contrast(colour, CHIP_LIGHT) > 3.0


def test_nothing_is_drawn_translucent(analysis):
    """The viewer draws strips opaque: on the light theme a translucent grey comes out black."""
    from allanscope.view.chart_builder import ChartBuilder

    drawings = {}
    ChartBuilder(drawings.__setitem__).paint(analysis)
    colours = [c for d in drawings.values() for c in (*d.strip_colours, *d.dot_colours)]
    assert colours
    assert {len(colour) for colour in colours} == {3}
