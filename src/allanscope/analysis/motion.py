"""Whether the board was moved: no noise, drift or tilt of a bench looks like that.

Means over a second tell. The level of a gyroscope at rest is its bias, which changes by tenths of a
dps while it warms up, and the direction of gravity is that of a bench. What turns by several dps,
or tilts by several degrees, was taken in the hand or mounted on something that moves; the noise of
that time is no sensor's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.history import Record
from allanscope.quantities import moment, number

__all__ = ["motion_remark"]

_ROW_S = 1.0
_TURN_DPS = 5.0
"""Ten times what the biases of the measured records in this repository move by in hours."""
_TILT_DEG = 5.0
"""A car that people enter tilts by 2 degrees."""
_LEAST_G = 0.5
"""Usual acceleration in g below which gravity is not in it, as in what a phone calls linear."""


def motion_remark(record: Record) -> str:
    """Return when and how the board was moved, and what to do; empty where it was at rest.

    Examples
    --------
    A board that turns at 90 dps for ten seconds of a minute:

    >>> from allanscope.history import History
    >>> history = History(axes=1)
    >>> history.update(np.repeat([0.0, 90.0, 0.0], [160, 80, 240])[:, np.newaxis])
    >>> motion_remark(history.record(8.0, ("gx",), (1.0,))).partition(":")[0]
    'The board was moved between 20 s and 30 s'
    """
    rows = record.coarsened(max(int(len(record.values) / record.rate_hz / _ROW_S), 1))
    if not len(rows.values):
        return ""
    turn, tilt = _turn_dps(rows), _tilt_deg(rows)
    moved = np.flatnonzero((turn > _TURN_DPS) | (tilt > _TILT_DEG))
    if not len(moved):
        return ""
    length = float(rows.start_s[-1]) + 1.0 / rows.rate_hz
    begin, end = float(rows.start_s[moved[0]]), float(rows.start_s[moved[-1]]) + 1.0 / rows.rate_hz
    how = [
        f"{words} {number(float(most), 2)} {unit}"
        for words, most, limit, unit in (
            ("turned at up to", turn.max(), _TURN_DPS, "dps"),
            ("tilted by up to", tilt.max(), _TILT_DEG, "°"),
        )
        if most > limit
    ]
    return (
        f"The board was moved between {moment(begin, length)} and {moment(end, length)}: it "
        f"{' and '.join(how)}. N, B and K are those of a board at rest: record it untouched, "
        "unless this motion is among the effects found."
    )


def _turn_dps(rows: Record) -> NDArray[np.float64]:
    """Return the largest turn of any axis about its usual level, shape (n,)."""
    own = [column for column, axis in enumerate(rows.axes) if axis[0] == "g"]
    values = rows.values[:, own]
    turn: NDArray[np.float64] = np.abs(values - np.median(values, axis=0)).max(axis=1, initial=0.0)
    return turn


def _tilt_deg(rows: Record) -> NDArray[np.float64]:
    """Return the angle of gravity to its usual direction, shape (n,); 0 where it is not told."""
    own = [column for column, axis in enumerate(rows.axes) if axis[0] == "a"]
    gravity = rows.values[:, own]
    usual = np.median(gravity, axis=0)
    lengths = np.linalg.norm(gravity, axis=1) * np.linalg.norm(usual)
    if len(own) < 3 or np.linalg.norm(usual) < _LEAST_G or not lengths.min() > 0.0:
        return np.zeros(len(gravity))
    cosine: NDArray[np.float64] = np.clip(gravity @ usual / lengths, -1.0, 1.0)
    return np.degrees(np.arccos(cosine))
