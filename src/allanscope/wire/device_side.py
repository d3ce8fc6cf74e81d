"""What the encoders of formats without numbers share: times, temperatures and milli-units."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import AXES, Block, StreamInfo
from allanscope.wire.lattice import truncate

__all__ = ["milli_units", "temperatures", "times"]


def times(block: Block, rows: NDArray[np.int64], nominal_hz: float) -> NDArray[np.float64]:
    """Return the device time of some rows of a block, in seconds.

    Interpolated between the ticks; beyond them, or without any, carried on at the nominal rate.
    """
    period = 1.0 / nominal_hz if nominal_hz else 0.0
    known = np.isfinite(block.ticks.device_s)
    if not known.any():
        return np.asarray((block.index + rows) * period, np.float64)
    offsets, seconds = block.ticks.offset[known], block.ticks.device_s[known]
    beyond = np.maximum(rows - offsets[-1], 0) + np.minimum(rows - offsets[0], 0)
    found = np.interp(rows, offsets, seconds) + beyond * period
    return np.asarray(np.maximum(found, 0.0), np.float64)


def temperatures(block: Block, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the temperature at some rows of a block, interpolated; NaN when it has none."""
    known = np.isfinite(block.ticks.temperature_c)
    if not known.any():
        return np.full(len(rows), np.nan)
    offsets, degrees = block.ticks.offset[known], block.ticks.temperature_c[known]
    return np.asarray(np.interp(rows, offsets, degrees), np.float64)


def milli_units(block: Block, info: StreamInfo) -> NDArray[np.int64]:
    """Return counts as stock firmware sends them: mdps and mg, cut, shape (n, 6), absent ones 0."""
    sent = np.zeros((len(block), len(AXES)), np.int64)
    columns = [AXES.index(axis) for axis in info.axes]
    sent[:, columns] = truncate(block.counts, np.round(np.asarray(info.scale) * 1e3, 6))
    return sent
