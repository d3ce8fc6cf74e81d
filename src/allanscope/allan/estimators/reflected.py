"""The window of the modified and Hadamard totals: detrended, mirrored, gone round once.

A window of 3m values loses its slope (taken between the means of its halves) and is mirrored at
both ends, which makes 9m values with a period of 6m. The second difference of means of m
neighbours is squared and averaged over all 6m positions (NIST SP 1065). Two
observations save the copy and half of the work:

* the running sum ``P`` of a mirrored series is odd about the mirror: ``-P(-q)`` before it and
  ``2 P(3m) - P(6m - q)`` after it, so a term is ``P(q) - 3 P(q-m) + 3 P(q-2m) - P(q-3m)``;
* a term and its mirror image are equal, so positions from one half window before the first mirror
  to one half window before the second stand for all.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.compiled import Pointer, kernel

__all__ = ["reflected_edf", "reflected_expectation", "reflected_mean_square"]


_squares = kernel(
    "reflected_squares",
    *(Pointer(np.float64, 1), int, int, int),
    Pointer(np.float64, 1, written=True),
    returns=float,
)


def reflected_mean_square(values: NDArray[np.float64], m: int, stride: int) -> tuple[float, int]:
    """Return the mean over windows and positions of the squared second difference of m-means.

    Parameters
    ----------
    values : ndarray of float64, shape (n,)
        Phases (MTOT) or rates (HTOT).
    m : int
        Averaging factor; a window has 3m values.
    stride : int
        Step between windows: 1 for all. Up to m/4 loses next to nothing.

    Returns
    -------
    mean : float
        NaN when there is no window.
    windows : int
        Number of windows.
    """
    windows = len(range(0, values.size - 3 * m + 1, stride))
    if not windows:
        return np.nan, 0
    room = np.empty(12 * m + 2 * (3 * m // 2) + 3)
    total = _squares(np.ascontiguousarray(values, np.float64), values.size, m, stride, room)
    return total / (windows * float(m) ** 2), windows


def reflected_edf(alpha_of_phase: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
    """Return the degrees of freedom of `reflected_mean_square`.

    Parameters
    ----------
    alpha_of_phase : array_like of int
        Power law of the rate whose *phase* fills the window, 4 to -2: alpha for MTOT; alpha + 2 for
        HTOT, whose windows hold rates.
    m, n : array_like of int
        Averaging factor and run length.

    Notes
    -----
    ``(n/m) / (b0 + b1 m/n)``. b0 is exact: of what many windows pass of the spectrum S, with the
    gain G, each sample is worth ``mean(G^2 S)^2 / mean((G^2 S)^2)`` degrees of freedom, by
    Parseval's theorem for the squared covariances of all pairs of positions. b1, the end of the
    run, is fitted to the exact ``tr(QC)^2 / tr(QCQC)`` of the estimator's quadratic form Q and the
    generalised covariance C at m = 16, good to 5 % from n = 3.5 m on. The published fits for HTOT
    have this form and agree to 15 %; those for MTOT, ``b n/m - c`` (table 8), agree at n/m = 16 but
    promise half as much again at the end of the run.

    Phase noise of HTOT (3 and 4) has the exact value times the number of windows, for n > 32 m.
    """
    alpha, m, n = np.broadcast_arrays(np.clip(alpha_of_phase, -2, 4), m, n)
    near = np.minimum(m, _EVALUATED)
    worth = np.vectorize(_edf_per_sample, otypes=[np.float64])
    # Beyond, FM has the same in each window; phase noise goes on as it did in the last octave.
    octave = np.where(alpha > 2, worth(alpha, _EVALUATED) / worth(alpha, _EVALUATED // 2), 0.5)
    per_sample = worth(alpha, near) * octave ** np.log2(m / near)
    end = _END[2 - np.minimum(alpha, 2)] * m / n
    edf: NDArray[np.float64] = np.where(
        alpha > 2,
        per_sample * np.maximum(n - 3 * m + 1, 1),
        (n / m) / (1.0 / (m * per_sample) + end),
    )
    return edf


def reflected_expectation(alpha_of_phase: ArrayLike, m: ArrayLike) -> NDArray[np.float64]:
    """Return `reflected_mean_square` / the same mean square without detrending and mirrors.

    Both are integrals of what a window passes over the spectrum of discrete power-law noise;
    `alpha_of_phase` as for `reflected_edf`, from 4 to -2. They are evaluated up to m = 32, where
    the ratio depends on m, by up to 6 % at m = 2, and tabulated above. For 2 to -2 those of large
    m are the published HTOT biases of white FM to random run FM, to three digits; that of flicker
    PM, alpha_of_phase = 3, goes on growing.
    """
    alpha, m = np.broadcast_arrays(np.clip(alpha_of_phase, -2, 4), m)
    ratios = [
        _expectation(a, k)
        if k <= _EVALUATED
        else float(np.interp(np.log2(k), _AT_OCTAVE, _EXPECTATION[4 - a]))
        for a, k in zip(alpha.ravel().tolist(), m.ravel().tolist(), strict=True)
    ]
    return np.array(ratios).reshape(alpha.shape)


@lru_cache(maxsize=512)
def _expectation(alpha_of_phase: int, m: int) -> float:
    phase, weight, reflected, plain = _passed(m)
    spectrum = weight * _density(alpha_of_phase, phase)
    return float(spectrum @ reflected / (spectrum @ plain))


@lru_cache(maxsize=512)
def _edf_per_sample(alpha_of_phase: int, m: int) -> float:
    phase, weight, reflected, _ = _passed(m)
    passed = reflected * _density(alpha_of_phase, phase)
    return float((weight @ passed) ** 2 / (weight @ passed**2) / weight.sum())


def _density(alpha_of_phase: int, phase: NDArray[np.float64]) -> NDArray[np.float64]:
    return (2.0 * np.sin(phase / 2.0)) ** (alpha_of_phase - 2.0)


@cache
def _nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return nodes and weights of Gauss and Legendre, by Newton's method from Tricomi's estimate.

    `numpy.polynomial.legendre.leggauss` finds eigenvalues of a full matrix: 0.2 s for 300 nodes,
    longer than all that uses them, and weights to 6e-11; these are known to 6e-13.
    """
    node = np.cos(np.pi * (np.arange(_NODES, 0, -1) - 0.25) / (_NODES + 0.5))
    for _ in range(5):
        before, value = np.ones(_NODES), node
        for k in range(2, _NODES + 1):
            before, value = value, ((2 * k - 1) * node * value - (k - 1) * before) / k
        slope = _NODES * (before - node * value) / ((1.0 - node) * (1.0 + node))
        node = node - value / slope
    return node, 2.0 / ((1.0 - node) * (1.0 + node) * slope**2)


@lru_cache(maxsize=64)
def _passed(m: int) -> tuple[NDArray[np.float64], ...]:
    """Return phases in rad per value, their weights, and what window and plain differences pass."""
    length, half = 3 * m, (3 * m) // 2
    detrended = np.eye(length)
    slope = detrended[length - half :].mean(axis=0) - detrended[:half].mean(axis=0)
    detrended -= np.outer(np.arange(length), slope / (length - half))
    mirrored = np.concatenate([detrended[::-1], detrended, detrended[::-1]])
    running = np.concatenate([np.zeros((1, length)), np.cumsum(mirrored, axis=0)])
    p0, p1, p2, p3 = (running[k * m : k * m + 6 * m] for k in range(4))
    difference = np.concatenate([np.ones(m), -2.0 * np.ones(m), np.ones(m)])
    node, weight = _nodes()
    phase = np.pi * (node + 1.0) / 2.0
    turns = np.exp(-1j * np.outer(np.arange(length), phase))
    reflected = np.mean(np.abs(((p3 - p0) - 3.0 * (p2 - p1)) @ turns) ** 2, axis=0)
    return phase, weight, reflected, np.abs(difference @ turns) ** 2


_EVALUATED = 32
_NODES = 300

_END = np.array([1.01, 1.75, 2.34, 3.14, 4.56])
"""b1 for alpha_of_phase from 2 to -2."""

_AT_OCTAVE = [5, 6, 7, 8, 9]
_EXPECTATION = [
    [1.3752, 1.3797, 1.3819, 1.3831, 1.3836],
    [1.2387, 1.2554, 1.2688, 1.2797, 1.2888],
    *([ratio] * len(_AT_OCTAVE) for ratio in (0.995, 0.852, 0.771, 0.717, 0.679)),
]
"""The ratio at m = 32 ... 512, where it has all but reached that of large m."""
