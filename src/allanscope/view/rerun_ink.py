"""Puts drawings into a Rerun recording: one entity, one row, one chunk for each.

Every entity that is logged becomes a chunk of its own in the file and in the viewer's memory, and
chunks, not values, are what costs: so the strips and the dots of a drawing share an entity. Words
need another one, because all labels of an entity are either always shown or only when pointed at.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from allanscope.view.chart import Strips
from allanscope.view.drawing import Drawing

__all__ = ["Ink"]

_ORDER = {"grid": -20.0, "datasheet": 0.0, "textbook": 10.0, "model": 15.0, "found": 25.0}
_ORDER_OF_CURVES = 20.0


class Ink:
    """Logs drawings, and wipes what a later drawing of the same entity no longer has.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Where; its time must have been set.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._with_words: set[str] = set()

    def log(self, path: str, drawing: Drawing) -> None:
        """Log a drawing as the entity `path`, its words as ``path/words``."""
        order = _ORDER.get(path.rpartition("/")[2], _ORDER_OF_CURVES)
        shapes: list[Any] = []
        if drawing.strips or not drawing.words:
            shapes.append(
                rr.LineStrips2D(
                    _arrow(drawing.strips),
                    colors=drawing.strip_colours,
                    radii=drawing.strip_radii,
                    draw_order=order,
                )
            )
        if drawing.dots:
            shapes.append(
                rr.Points2D(
                    np.array(drawing.dots),
                    colors=drawing.dot_colours,
                    radii=drawing.dot_radii,
                    labels=drawing.dot_texts,
                    show_labels=False,
                    draw_order=order + 1.0,
                )
            )
        if shapes:
            self._recording.log(path, *shapes)
        if drawing.words or path in self._with_words:
            self._words(f"{path}/words", drawing)
            self._with_words.add(path)

    def _words(self, path: str, drawing: Drawing) -> None:
        self._recording.log(
            path,
            rr.Points2D(
                [at for at, _, _ in drawing.words],
                labels=[text for _, text, _ in drawing.words],
                colors=[colour for _, _, colour in drawing.words],
                radii=rr.Radius.ui_points(0.0),
                show_labels=True,
                draw_order=50.0,
            ),
        )


_STRIPS = rr.components.LineStrip2DBatch([]).as_arrow_array().type


def _arrow(strips: Strips) -> Any:
    """Return strips as the Arrow array that Rerun makes of them, some ten times sooner."""
    points = np.concatenate(strips) if strips else np.empty((0, 2), np.float32)
    offsets = np.cumsum([0, *map(len, strips)], dtype=np.int32)
    inner = rr.encodings.Vec2DBatch(points).as_arrow_array()
    return pa.ListArray.from_arrays(offsets, inner, type=_STRIPS)
