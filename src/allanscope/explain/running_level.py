"""The level of a periodogram beside its lines."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.median import median

__all__ = ["may_hold_a_line", "running_level"]

Array = NDArray[np.float64]

_SHORT, _LONG = 64, 1024
"""Ordinates in a block below the first `_LONG` of them, where the level is steep, and above."""
_ROUNDING = 1e-9
"""Of a level that is interpolated in its logarithm, at the most."""


def running_level(tail: Array) -> Array:
    """Local mean of a periodogram from medians over blocks, which a line does not move."""
    centres, levels = _blocks(tail)
    return np.asarray(np.exp(np.interp(np.arange(len(tail)), centres, np.log(levels))))


def may_hold_a_line(tail: Array, ratio: float) -> bool:
    """Return whether a periodogram may reach so many times its running level anywhere.

    Between the centres of two blocks that is at least the lower of both.

    Examples
    --------
    >>> flat = np.ones(1000)
    >>> may_hold_a_line(flat, 2.0), may_hold_a_line(flat + 5.0 * (np.arange(1000) == 400), 2.0)
    (False, True)
    """
    centres, levels = _blocks(tail)
    peaks = np.maximum.reduceat(tail, np.concatenate([[0], np.ceil(centres).astype(np.int64)]))
    lower = np.minimum(np.append(levels[:1], levels), np.append(levels, levels[-1:]))
    return bool(np.any(peaks > (1 - _ROUNDING) * ratio * lower))


def _blocks(tail: Array) -> tuple[Array, Array]:
    """Return the centres of blocks of ordinates, and the mean that follows from their median."""
    short, long = np.arange(0, min(len(tail), _LONG), _SHORT), np.arange(_LONG, len(tail), _LONG)
    edges = np.concatenate([short, long])
    if len(tail) - edges[-1] < _SHORT:
        edges = edges[:-1]
    edges = np.append(edges, len(tail))
    medians = np.array([median(tail[a:b]) for a, b in pairwise(edges)])
    centres = 0.5 * (edges[:-1] + edges[1:])
    return centres, np.maximum(medians, 1e-300) / np.log(2)
