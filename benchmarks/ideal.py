r"""What the best detector could gain: by how much N, B and K fail to take up an effect.

An oracle knows the noise and the effect, form, place and size. Against him stands a description
without the effect whose N, B and K are those that fit best: a slow signal looks like a random walk,
and what a random walk would gain as well is no evidence of it. In DCT ordinates of variance S, with
mean squares p (of a signal :math:`S + s^2`, of a process its own variance, which is S itself), the
log-likelihood ratio is expected to be

.. math:: \tfrac12 \sum_k \left[ p_k / m_k - 1 + \ln (m_k / S_k) \right],

at its least over the densities m of N, B, K and the rounding.
"""

from __future__ import annotations

import numpy as np
from blind_noise import Array, Noise, ordinate_density
from scipy.fft import dct
from scipy.optimize import minimize

_STARTS = (1.0, 10.0, 100.0)
"""Times that the best B and K may exceed those of the noise, which a search begins from."""
_NONE, _MOST = 1e-30, 1e6
"""Least and largest square of a coefficient."""


def ordinates(n: int, rate: float) -> Array:
    """Return the frequencies of the DCT ordinates of n rows but the mean, in Hz."""
    return np.arange(1, n) * rate / (2 * n)


def nats_of_signal(signal: Array, noise: Noise, rate: float) -> float:
    """Return what a known signal gains over the best N, B and K in its place."""
    n = len(signal)
    square = dct(signal - signal.mean(), norm="ortho")[1:] ** 2
    return best_nats(ordinate_density(noise, ordinates(n, rate), rate), square, noise, rate)


def nats_of_process(extra: Array, noise: Noise, rate: float) -> float:
    """Return the same of a process of known variance at the ordinates, shape (n - 1,)."""
    f = ordinates(len(extra) + 1, rate)
    return best_nats(ordinate_density(noise, f, rate) + extra, np.zeros(len(f)), noise, rate)


def best_nats(variance: Array, square: Array, noise: Noise, rate: float) -> float:
    """Return the log-likelihood ratio that is expected, of ordinates of a variance and a mean.

    Parameters
    ----------
    variance, square : ndarray, shape (n - 1,)
        Of every ordinate, and of its mean.
    noise : Noise
        Where the search for the best N, B and K begins.
    rate : float
        In Hz.
    """
    s = 2 * np.sin(np.pi * ordinates(len(variance) + 1, rate) / rate)
    columns = np.column_stack([np.full(len(s), rate), 1 / s, 1 / rate / s**2])
    power, rounding = variance + square, noise.lsb**2 / 12

    def lost(point: Array) -> tuple[float, Array]:
        parts = columns * np.exp(point)
        model = parts.sum(axis=1) + rounding
        ratio = power / model
        nats = 0.5 * float(np.sum(ratio - 1 + np.log(model / variance)))
        return nats, 0.5 * ((1 - ratio) / model) @ parts

    least = np.inf
    for times in _STARTS:
        first = np.log([noise.n**2, times * noise.b**2, times**2 * noise.k**2])
        bounds = [tuple(np.log([_NONE, _MOST]))] * 3
        found = minimize(lost, first, jac=True, method="L-BFGS-B", bounds=bounds)
        least = min(least, float(found.fun))
    return max(least, 0.0)


def size_of(nats: float) -> float:
    """Return d', the deviations by which something stands out that gains so much."""
    return float(np.sqrt(2 * nats))
