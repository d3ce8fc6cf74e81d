"""The level of a periodogram beside its lines."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.median import median

__all__ = ["running_level"]

Array = NDArray[np.float64]

_SHORT, _LONG = 64, 1024
"""Ordinates in a block below the first `_LONG` of them, where the level is steep, and above."""


def running_level(power: Array, lowest: int) -> Array:
    """Local mean of a periodogram from medians over blocks, which a line does not move."""
    tail = power[lowest:]
    short, long = np.arange(0, min(len(tail), _LONG), _SHORT), np.arange(_LONG, len(tail), _LONG)
    edges = np.concatenate([short, long])
    if len(tail) - edges[-1] < _SHORT:
        edges = edges[:-1]
    edges = np.append(edges, len(tail))
    medians = np.array([median(tail[a:b]) for a, b in pairwise(edges)])
    centres = 0.5 * (edges[:-1] + edges[1:])
    medians = np.maximum(medians, 1e-300) / np.log(2)
    return np.asarray(np.exp(np.interp(np.arange(len(tail)), centres, np.log(medians))))
