"""Two hidden levels in white noise: forward, backward and most probable path."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import njit

__all__ = ["posterior"]

Array = NDArray[np.float64]


def posterior(
    data: Array, size: float, rate: float, variance: float
) -> tuple[Array, Array, float, float, float]:
    """Return what the data say about a signal that hops between +size and -size.

    Parameters
    ----------
    data : ndarray, shape (n,)
        Signal plus white noise of the given variance.
    rate : float
        Probability of a switch between two samples.

    Returns
    -------
    mean : ndarray, shape (n,)
        Posterior mean of the state (-1 to 1).
    path : ndarray, shape (n,)
        Most probable path of -1 and +1.
    log_evidence, log_joint : float
        Of the data, all paths summed; of the data with that path.
    switches : float
        Expected number of switches.
    """
    mean, path, log_z, log_joint, switches = _posterior(
        np.ascontiguousarray(data), float(size), float(rate), float(variance)
    )
    return mean, path, float(log_z), float(log_joint), float(switches)


@njit(cache=True, nogil=True)
def _posterior(
    data: Array, size: float, rate: float, variance: float
) -> tuple[Array, Array, float, float, float]:
    density = _log_densities(data, size, variance)
    forward, scale, log_z = _filtered(density, rate)
    mean, switches = _smoothed(density, forward, scale, rate)
    path, log_joint = _most_probable(density, rate)
    return mean, path, log_z, log_joint, switches


@njit(cache=True, nogil=True)
def _log_densities(data: Array, size: float, variance: float) -> Array:
    """Logarithm of how probable every sample is at -size and at +size, less their common factor."""
    density = np.empty((data.size, 2))
    for k in range(data.size):
        density[k, 0] = -((data[k] + size) ** 2) / (2 * variance)
        density[k, 1] = -((data[k] - size) ** 2) / (2 * variance)
    return density


@njit(cache=True, nogil=True)
def _filtered(density: Array, rate: float) -> tuple[Array, Array, float]:
    """Go forward: probability of each state given the samples up to it, and of all samples."""
    n = len(density)
    forward, scale = np.empty((n, 2)), np.empty(n)
    stay, leave = 1.0 - rate, rate
    log_z = 0.0
    for k in range(n):
        top = max(density[k, 0], density[k, 1])
        a0, a1 = np.exp(density[k, 0] - top), np.exp(density[k, 1] - top)
        if k == 0:
            a0, a1 = 0.5 * a0, 0.5 * a1
        else:
            p0, p1 = forward[k - 1, 0], forward[k - 1, 1]
            a0, a1 = (p0 * stay + p1 * leave) * a0, (p0 * leave + p1 * stay) * a1
        scale[k] = a0 + a1
        forward[k, 0], forward[k, 1] = a0 / scale[k], a1 / scale[k]
        log_z += np.log(scale[k]) + top
    return forward, scale, log_z


@njit(cache=True, nogil=True)
def _smoothed(density: Array, forward: Array, scale: Array, rate: float) -> tuple[Array, float]:
    """Go back: mean of each state given all samples, and the expected number of switches."""
    n = len(density)
    stay, leave = 1.0 - rate, rate
    mean = np.empty(n)
    mean[n - 1] = forward[n - 1, 1] - forward[n - 1, 0]
    b0, b1 = 1.0, 1.0
    switches = 0.0
    for k in range(n - 2, -1, -1):
        top = max(density[k + 1, 0], density[k + 1, 1])
        e0 = np.exp(density[k + 1, 0] - top) * b0 / scale[k + 1]
        e1 = np.exp(density[k + 1, 1] - top) * b1 / scale[k + 1]
        f0, f1 = forward[k, 0], forward[k, 1]
        switches += (f0 * e1 + f1 * e0) * leave
        b0, b1 = stay * e0 + leave * e1, leave * e0 + stay * e1
        mean[k] = (f1 * b1 - f0 * b0) / (f0 * b0 + f1 * b1)
    return mean, switches


@njit(cache=True, nogil=True)
def _most_probable(density: Array, rate: float) -> tuple[Array, float]:
    """Find the most probable path and its joint probability with the data (Viterbi)."""
    n = len(density)
    log_stay, log_leave = np.log(1.0 - rate), np.log(rate)
    came_from = np.zeros((n, 2), np.int8)
    best0, best1 = np.log(0.5) + density[0, 0], np.log(0.5) + density[0, 1]
    for k in range(1, n):
        stayed0, hopped0 = best0 + log_stay, best1 + log_leave
        stayed1, hopped1 = best1 + log_stay, best0 + log_leave
        came_from[k, 0] = 1 if hopped0 > stayed0 else 0
        came_from[k, 1] = 0 if hopped1 > stayed1 else 1
        best0 = max(stayed0, hopped0) + density[k, 0]
        best1 = max(stayed1, hopped1) + density[k, 1]
    state = 1 if best1 > best0 else 0
    log_joint = max(best0, best1)
    path = np.empty(n)
    for k in range(n - 1, -1, -1):
        path[k] = 2.0 * state - 1.0
        state = came_from[k, state]
    return path, log_joint
