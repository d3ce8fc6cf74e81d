"""The level of a periodogram beside its lines."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["running_level"]

Array = NDArray[np.float64]


def running_level(power: Array, lowest: int, block: int = 512) -> Array:
    """Local mean of a periodogram from medians over blocks, which a line does not move."""
    tail = power[lowest:]
    edges = np.unique(
        np.concatenate(
            [np.arange(0, min(len(tail), 16 * 64), 64), np.arange(16 * 64, len(tail), 2 * block)]
        )
    )
    edges = (
        np.append(edges[:-1], len(tail))
        if len(tail) - edges[-1] < 64
        else np.append(edges, len(tail))
    )
    medians = np.array([np.median(tail[a:b]) for a, b in pairwise(edges)])
    centres = 0.5 * (edges[:-1] + edges[1:])
    medians = np.maximum(medians, 1e-300) / np.log(2)
    return np.asarray(np.exp(np.interp(np.arange(len(tail)), centres, np.log(medians))))
