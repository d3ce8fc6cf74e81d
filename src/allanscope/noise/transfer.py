"""From the density of samples to variances, and to the density of their means.

With the two-sided spectrum S(w) of the samples (w in rad per sample)::

    AVAR(m) = (1/pi) int_0^pi S(w) 4 sin^4(m w/2) / (m^2 sin^2(w/2)) / 2 dw
    HVAR(m) = (1/pi) int_0^pi S(w) (16/3) sin^6(m w/2) / (m^2 sin^2(w/2)) / 2 dw
    MVAR(m) = (1/pi) int_0^pi S(w) 4 sin^6(m w/2) / (m^4 sin^4(w/2)) / 2 dw

exact for any averaging factor m, because S holds the aliases.

Averaging `stride` samples into a row folds the spectrum. At phase phi (rad per row) that of the
rows is a weighted mean of that of the samples at the s phases that alias onto it::

    S_row(phi) = (1/s) sum_j W_j S(w_j),   w_j = (phi + 2 pi j) / s,
    W_j = sin^2(phi/2) / (s^2 sin^2(w_j/2)),   sum_j W_j = 1

so white noise of variance v becomes white noise of variance v / s exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Kind", "estimator_variance", "fold", "response"]

Array = NDArray[np.float64]
Kind = Literal["avar", "mvar", "hvar"]

_POWER = {"avar": 4, "mvar": 6, "hvar": 6}
_SCALE = {"avar": 2.0, "mvar": 2.0, "hvar": 8.0 / 3.0}
"""Power of the sine, and scale, of each response."""
_MEAN = {4: 3.0 / 8.0, 6: 5.0 / 16.0}
"""Mean of sin^4 and sin^6 over a period."""
_RESOLVED = 24
"""Periods of the response that are integrated one by one; beyond, its mean is used."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Of Gauss and Legendre, exact to the fifteenth degree."""
_SINGLE = 8
"""Aliases on each side that are taken one by one; those beyond are taken in groups."""
_GROWTH = 1.5
"""Factor by which groups of aliases grow."""


def response(kind: Kind, w: Array, m: float, *, mean: bool = False) -> Array:
    """Return the factor in ``variance = (1/pi) int S(w) factor dw``.

    Parameters
    ----------
    mean : bool
        Replace the oscillating factor by its mean over a period.
    """
    power = _POWER[kind]
    half = np.sin(w / 2)
    top = _MEAN[power] if mean else np.sin(m * w / 2) ** power
    bottom = (m * half) ** 2 * ((m * half) ** 2 if kind == "mvar" else 1.0)
    return np.asarray(_SCALE[kind] * top / bottom)


def estimator_variance(
    spectrum: Callable[[Array], Array],
    kind: Kind,
    m: ArrayLike,
    *,
    corners: tuple[float, ...] = (),
    kinks: tuple[float, ...] = (),
) -> Array:
    """Integrate a spectrum over what an estimator passes.

    Parameters
    ----------
    spectrum : callable
        Two-sided spectrum of the samples at phases in rad per sample.
    kind : {'avar', 'mvar', 'hvar'}
        Estimator.
    m : array_like
        Averaging factors.
    corners : tuple of float
        Phases near which the spectrum changes faster than by a power of the phase.
    kinks : tuple of float
        Phases between which it is a power of the phase, each time another one.

    Returns
    -------
    ndarray, shape of `m`
        Variances, to about 1e-5.

    Examples
    --------
    >>> estimator_variance(lambda w: np.ones_like(w), "avar", [1, 10]).round(5)
    array([1. , 0.1])
    """
    factors = np.atleast_1d(np.asarray(m, np.float64))
    known = np.concatenate([np.asarray(kinks), *_around(corners)])
    low = 1e-3 * min(corners, default=np.inf)
    values = np.array([_integral(spectrum, kind, float(m), known, low) for m in factors])
    return values.reshape(np.shape(m))


def _integral(
    spectrum: Callable[[Array], Array], kind: Kind, m: float, known: Array, low: float
) -> float:
    period = 2 * np.pi / m
    last = min(np.pi, _RESOLVED * period)
    linear = np.arange(period / 4, last * (1 - 1e-12), period / 4)
    low = min(low, period * 1e-9)
    edges = np.concatenate([np.geomspace(low, period / 4, 48), linear, [last]])
    total = _sum(spectrum, kind, m, _refined(edges, known), mean=False)
    if last < np.pi:
        edges = np.geomspace(last, np.pi, 12)
        total += _sum(spectrum, kind, m, _refined(edges, known), mean=True)
    return total / np.pi


def _around(corners: tuple[float, ...]) -> list[Array]:
    """Return phases that crowd around each corner."""
    away = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 17)])
    return [corner * (1 + sign * away) for corner in corners for sign in (-1, 1)]


def _refined(edges: Array, known: Array) -> Array:
    """Add the phases that lie between the edges."""
    return np.unique(np.concatenate([edges, known[(known > edges[0]) & (known < edges[-1])]]))


def _sum(
    spectrum: Callable[[Array], Array], kind: Kind, m: float, edges: Array, *, mean: bool
) -> float:
    """Gauss-Legendre on every interval."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    half = 0.5 * np.diff(edges)
    w = middle[:, np.newaxis] + half[:, np.newaxis] * _NODES
    values = spectrum(w.ravel()).reshape(w.shape) * response(kind, w, m, mean=mean)
    return float(np.sum(half * (values @ _WEIGHTS)))


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
