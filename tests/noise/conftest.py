"""Records of known noise, made by generators that share nothing with the room they test."""

import numpy as np
import pytest
from scipy.fft import irfft, rfft


def _make_noise(n, dt, rng, *, N=0.0, B=0.0, K=0.0):
    """Return white noise, flicker and a random walk, n samples dt apart.

    Flicker is the sum of its increments, whose autocovariance -4 B^2 / pi / (4 k^2 - 1) is embedded
    in a circle: exact.
    """
    samples = rng.standard_normal(n) * N / np.sqrt(dt)
    if B:
        k = np.arange(n + 1)
        row = -4 / np.pi / (4.0 * k**2 - 1)
        eigenvalues = np.maximum(rfft(np.concatenate([row, row[-2:0:-1]])).real, 0.0)
        z = rng.standard_normal((2, n + 1))
        z[0, [0, -1]] *= np.sqrt(2)
        increments = irfft((z[0] + 1j * z[1]) * np.sqrt(eigenvalues * n), 2 * n)
        samples += B * np.cumsum(increments[:n])
    if K:
        samples += np.cumsum(rng.standard_normal(n)) * K * np.sqrt(dt)
    return samples


def _overlapping_variance(samples, m, order=2):
    """Allan (order 2) or Hadamard (order 3) variance with full overlap, by definition."""
    phase = np.concatenate([[0.0], np.cumsum(samples)])
    weights = {2: (1, -2, 1), 3: (-1, 3, -3, 1)}[order]
    last = len(phase) - order * m
    terms = sum(w * phase[j * m : j * m + last] for j, w in enumerate(weights))
    return np.mean(terms**2) / m**2 / {2: 2, 3: 6}[order]


@pytest.fixture
def rng(request):
    """Return a generator for this test alone, the same at every run."""
    return np.random.default_rng([7, *request.node.name.encode()])


@pytest.fixture(scope="session")
def make_noise():
    """Return the generator of N, B and K."""
    return _make_noise


@pytest.fixture(scope="session")
def overlapping_variance():
    """Return the estimator of Allan and Hadamard variances."""
    return _overlapping_variance
