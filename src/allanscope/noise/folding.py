"""What averaging `stride` samples into a row does to a spectrum.

The spectrum of the rows at phase phi (rad per row) is a weighted mean of the spectrum of the
samples at the s phases that alias onto it::

    S_row(phi) = (1/s) sum_j W_j S(w_j),   w_j = (phi + 2 pi j) / s,
    W_j = sin^2(phi/2) / (s^2 sin^2(w_j/2)),   sum_j W_j = 1

so white noise of variance v becomes white noise of variance v / s exactly.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["fold"]

Array = NDArray[np.float64]

_SINGLE = 8
"""Aliases on each side that are taken one by one; those beyond are taken in groups."""
_GROWTH = 1.5


def fold(spectrum: Callable[[Array], Array], phase: Array, stride: int) -> Array:
    """Return the spectrum of means over `stride` samples.

    Parameters
    ----------
    spectrum : callable
        Two-sided spectrum of the samples (variance per sample; white noise: its variance) at
        phases in rad per sample, 0 < w <= pi. Smooth where aliases are grouped.
    phase : ndarray, shape (k,)
        Phases in rad per row, 0 < phi <= pi.
    stride : int
        Samples in a row.

    Returns
    -------
    ndarray, shape (k,)
        Spectrum of the rows.

    Examples
    --------
    >>> fold(lambda w: np.full_like(w, 3.0), np.array([0.1, 3.0]), 100)
    array([0.03, 0.03])
    """
    if stride == 1:
        return spectrum(phase)
    phases, weights = aliases(phase, stride)
    return np.asarray(np.sum(weights * spectrum(phases), axis=0) / stride)


def aliases(phase: Array, stride: int) -> tuple[Array, Array]:
    """Return the phases in rad per sample that alias onto `phase`, and their weights.

    Returns
    -------
    phases, weights : ndarray, shape (a, k)
        The weights of each column sum to 1. Beyond the first few, neighbours share one phase.
    """
    if stride <= 4 * _SINGLE:
        turn = np.arange(stride)[:, np.newaxis]
        wrapped = (phase + 2 * np.pi * turn) / stride
        phases = np.minimum(wrapped, 2 * np.pi - wrapped)
        return phases, (np.sin(phase / 2) / (stride * np.sin(phases / 2))) ** 2
    single = np.arange(_SINGLE)[:, np.newaxis]
    near = np.concatenate([phase + 2 * np.pi * single, 2 * np.pi * (single + 1) - phase]) / stride
    near_weights = (np.sin(phase / 2) / (stride * np.sin(near / 2))) ** 2
    far, share = _groups(phase, stride)
    far_weights = share * (1 - near_weights.sum(axis=0)) / share.sum(axis=0)
    return np.concatenate([near, far]), np.concatenate([near_weights, far_weights])


def _groups(phase: Array, stride: int) -> tuple[Array, Array]:
    """Return the groups of far aliases: a middle phase of each, and what it weighs relatively.

    Within a group the sum of 1/sin^2 is taken as its integral, the difference of two cotangents.
    """
    count = 1 + int(np.ceil(np.log(stride / (2 * _SINGLE)) / np.log(_GROWTH)))
    turns = np.geomspace(_SINGLE, stride / 2, count + 1)[:, np.newaxis]
    phases, weights = [], []
    for side in (phase - np.pi, np.pi - phase):
        edges = (2 * np.pi * turns + side) / stride
        edges[-1] = np.pi
        phases.append(np.sqrt(edges[:-1] * edges[1:]))
        weights.append(-np.diff(1 / np.tan(edges / 2), axis=0))
    return np.concatenate(phases), np.concatenate(weights)
