"""Drawings in a recording: logged when they changed, wiped when they are gone."""

import numpy as np
import pytest

from allanscope.view.chart_content import Drawing
from support.readback import read_back

LINE = [np.array([[0.0, 0.0], [10.0, 10.0]], np.float32)]


@pytest.fixture
def written(tmp_path):
    """Return a function that logs drawings one after the other and gives the rows back."""
    import rerun as rr

    from allanscope.view.rerun_drawing import DrawingWriter

    def write(*drawings, forget_before=()):
        recording = rr.RecordingStream("test")
        recording.save(tmp_path / "ink.rrd")
        ink = DrawingWriter(recording)
        for i, drawing in enumerate(drawings):
            recording.set_time("elapsed", duration=float(i))
            if i in forget_before:
                ink.forget()
            ink.log("/a/curve", drawing)
        recording.flush()
        recording.disconnect()
        return read_back(tmp_path / "ink.rrd")

    return write


def _drawing(strips=(), dots=(), words=()):
    drawing = Drawing()
    drawing.line(list(strips), (1, 2, 3), width=3.0)
    drawing.dot(np.array(dots, np.float32).reshape(-1, 2), ["text"] * len(dots), (4, 5, 6))
    for at, text in words:
        drawing.word(at, text, (7, 8, 9))
    return drawing


def test_a_strip_keeps_its_place_colour_and_width(written):
    rows = written(_drawing(LINE))
    row = rows["/a/curve"][0]
    np.testing.assert_array_equal(row.strips(), LINE)
    assert row.values["LineStrips2D:colors"] == [(1 << 24) | (2 << 16) | (3 << 8) | 255]
    assert row.values["LineStrips2D:radii"] == [-1.5], "in points of the screen"
    assert "/a/curve/words" not in rows


def test_strips_of_any_lengths_come_out_as_they_went_in(written):
    strips = [np.arange(2 * n, dtype=np.float32).reshape(n, 2) for n in (2, 5, 3)]
    out = written(_drawing(strips))["/a/curve"][0].strips()
    assert [strip.tolist() for strip in out] == [strip.tolist() for strip in strips]


def test_what_did_not_change_is_not_logged_again(written):
    same = _drawing(LINE, [(1, 2)], [((3.0, 4.0), "N")])
    rows = written(same, same, same, forget_before=(2,))
    assert [row.elapsed_s for row in rows["/a/curve"]] == [0.0, 2.0]
    assert [row.elapsed_s for row in rows["/a/curve/words"]] == [0.0, 2.0]


def test_what_is_gone_is_wiped(written):
    rows = written(_drawing(LINE, [(1, 2)], [((3.0, 4.0), "N")]), _drawing(), _drawing())
    assert rows["/a/curve"][-1].strips() == []
    assert rows["/a/curve/points"][-1].dots().size == 0
    assert rows["/a/curve/words"][-1].dots().size == 0
    assert len(rows["/a/curve"]) == 2


def test_a_word_that_moves_a_little_is_not_logged_again(written):
    places = [(97.0, 49.0), (98.0, 50.0), (130.0, 49.0)]
    rows = written(*[_drawing(LINE, (), [(place, "N")]) for place in places])
    assert [row.elapsed_s for row in rows["/a/curve/words"]] == [0.0, 2.0]
    assert rows["/a/curve/words"][0].values["Points2D:labels"] == ["N"]


def test_a_dot_has_few_enough_components_for_the_viewer_to_show_its_text(written):
    (row,) = written(_drawing((), [(1, 2)]))["/a/curve/points"]
    shown = [name for name, values in row.values.items() if name.startswith("Points2D:")]
    assert len(shown) <= 4, "of more than four the viewer tells the number"
    assert row.values["Points2D:labels"] == ["text"]
