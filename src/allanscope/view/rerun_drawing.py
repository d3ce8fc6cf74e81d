"""Puts drawings into a Rerun recording: one entity, one row, one chunk for each.

Every entity that is logged becomes a chunk of its own in the file and in the viewer's memory, and
chunks, not values, are what costs: so all strips of a drawing share an entity. Its dots have one of
their own, because they alone answer when they are pointed at, and so have its words, because all
labels of an entity are either always shown or only when pointed at.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from allanscope.view.chart import HEIGHT, WIDTH, Strips
from allanscope.view.chart_content import Drawing
from allanscope.view.palette import Colour

__all__ = ["POINTS", "DrawingWriter"]

POINTS = "points"
"""Name of the entity below a drawing's own that holds its dots.

Of four components at most the viewer shows the values, the text among them, where it is pointed at;
of more it shows their number. So size and order are the layout's, and the viewer's own.
"""

_ORDER = {"grid": -20.0, "datasheet": 0.0, "noise_model": 10.0, "model": 15.0, "effects": 25.0}
_ORDER_OF_CURVES = 20.0
_ORDER_OF_IMAGES = -30.0

_Words = list[tuple[float, float, str, Colour]]
_NEVER: _Words = [(0.0, 0.0, "", (0, 0, 0))]
_STEP_OF_WORDS = 8.0
"""Words stand on a coarse raster, so that they need not be logged again for every small move."""


class DrawingWriter:
    """Logs drawings that changed, and wipes what a later drawing of an entity no longer has.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Where; its time must have been set.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._shapes: dict[str, int] = {}
        self._words: dict[str, _Words] = {}
        self._dotted: set[str] = set()

    def forget(self) -> None:
        """Log everything again from now on, changed or not, for viewers that join late."""
        self._shapes.clear()
        self._words = dict.fromkeys(self._words, _NEVER)

    def log(self, path: str, drawing: Drawing) -> None:
        """Log a drawing as the entity `path`, and its words as ``path/words``."""
        parts = (*drawing.strips, *drawing.dots, *([] if drawing.image is None else drawing.image))
        shapes = hash(tuple(part.tobytes() for part in parts))
        if self._shapes.get(path) != shapes:
            self._shapes[path] = shapes
            self._log_shapes(path, drawing)
        words = [(_step(x), _step(y), text, colour) for (x, y), text, colour in drawing.words]
        if self._words.get(path, []) != words:
            self._words[path] = words
            self._log_words(f"{path}/words", words)

    def _log_shapes(self, path: str, drawing: Drawing) -> None:
        order = _ORDER.get(path.rpartition("/")[2], _ORDER_OF_CURVES)
        self._recording.log(
            path,
            rr.LineStrips2D(
                _arrow(drawing.strips),
                colors=drawing.strip_colours,
                radii=drawing.strip_radii,
                draw_order=order,
            ),
        )
        if drawing.dots or path in self._dotted:
            self._dotted.add(path)
            self._recording.log(
                f"{path}/{POINTS}",
                rr.Points2D.from_fields(
                    positions=np.array(drawing.dots).reshape(-1, 2),
                    colors=drawing.dot_colours,
                    labels=drawing.dot_texts,
                    show_labels=False,
                ),
            )
        if drawing.image is not None:
            rows, columns = drawing.image.shape[:2]
            cell = (WIDTH / columns, HEIGHT / rows, 1.0)
            image = rr.Image(drawing.image, color_model="RGBA", draw_order=_ORDER_OF_IMAGES)
            self._recording.log(f"{path}/image", rr.Transform3D(scale=cell), image)

    def _log_words(self, path: str, words: _Words) -> None:
        self._recording.log(
            path,
            rr.Points2D(
                [(x, y) for x, y, _, _ in words],
                labels=[text for _, _, text, _ in words],
                colors=[colour for _, _, _, colour in words],
                radii=rr.Radius.ui_points(0.0),
                show_labels=True,
                draw_order=50.0,
            ),
        )


def _step(place: float) -> float:
    return _STEP_OF_WORDS * round(place / _STEP_OF_WORDS)


_STRIPS = rr.components.LineStrip2DBatch([]).as_arrow_array().type


def _arrow(strips: Strips) -> Any:
    """Return strips as the Arrow array that Rerun makes of them, some ten times sooner."""
    points = np.concatenate(strips) if strips else np.empty((0, 2), np.float32)
    offsets = np.cumsum([0, *map(len, strips)], dtype=np.int32)
    inner = rr.encodings.Vec2DBatch(points).as_arrow_array()
    return pa.ListArray.from_arrays(offsets, inner, type=_STRIPS)
