"""Textbook noise of the blind benchmark, and the least size that can be found in it.

Shares nothing with ``allanscope.simulator``: the noise is synthesised in its own way, so that the
loop is not judged by the very formulas it fits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, irfft, next_fast_len, rfft
from scipy.optimize import minimize

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Textbook noise of one axis (IEEE 952, two-sided densities) and its step."""

    n: float
    b: float
    k: float
    lsb: float
    offset: float


def white_to_flicker(rng: np.random.Generator, n: int, b: float) -> Array:
    """Flicker noise: white noise through the fractional half integrator, start-up discarded."""
    m = n + n // 2
    j = np.arange(1, m)
    h = np.concatenate([[1.0], np.cumprod((j - 0.5) / j)])
    size = next_fast_len(2 * m, real=True)
    return irfft(rfft(h, size) * rfft(rng.normal(0, b, m), size), size)[m - n : m]


def base_noise(rng: np.random.Generator, noise: Noise, n: int, rate: float) -> Array:
    """White, flicker and random walk."""
    white = rng.normal(0, noise.n * np.sqrt(rate), n)
    walk = np.cumsum(rng.normal(0, noise.k / np.sqrt(rate), n))
    return white + white_to_flicker(rng, n, noise.b) + walk


def draw_noise(rng: np.random.Generator, axis: str, coarse: bool = False) -> Noise:
    """Typical coefficients of the parts, spread over a factor of about two."""

    def spread(value: float, factor: float) -> float:
        return float(value * factor ** rng.uniform(-1, 1))

    if axis.startswith("g"):
        lsb = float(rng.choice([4.375e-3, 8.75e-3, 17.5e-3]))
        return Noise(
            spread(4.5e-3, 1.6), spread(1.2e-3, 2), spread(1e-4, 2), lsb, rng.uniform(-3, 3)
        )
    offset = (1.0 if axis == "az" else 0.0) + rng.uniform(-0.04, 0.04)
    lsb = float(rng.choice([0.061e-3, 0.122e-3, 0.244e-3]))
    return Noise(spread(80e-6, 1.4), spread(25e-6, 2), spread(2e-6, 2), lsb, offset)


def ordinate_density(noise: Noise, f: Array, rate: float) -> Array:
    """Two-sided density per sample: variance of a DCT ordinate at frequency f."""
    s = 2 * np.sin(np.pi * f / rate)
    step = noise.lsb**2 / 12
    return rate * noise.n**2 + noise.b**2 / s + noise.k**2 / rate / s**2 + step


def information(signal: Array, noise: Noise, rate: float) -> float:
    """Inverse variance of the amplitude of a known signal in known noise (GLS)."""
    n = len(signal)
    x = dct(signal - signal.mean(), norm="ortho")[1:]
    f = np.arange(1, n) * rate / (2 * n)
    return float(np.sum(x**2 / ordinate_density(noise, f, rate)))


def spectral_scale(
    extra: Callable[[Array], Array], noise: Noise, n: int, rate: float, nats: float
) -> float:
    """Factor on a unit variance density at which the best N, B, K leave `nats`."""
    f = np.geomspace(rate / (2 * n), rate / 2, 400)
    count = np.gradient(f) * 2 * n / rate
    shape = extra(f)

    def left(scale: float) -> float:
        truth = ordinate_density(noise, f, rate) + scale * shape

        def divergence(log_parameters: Array) -> float:
            factor = np.exp(np.clip(log_parameters, -6, 6))
            model = Noise(
                noise.n * factor[0], noise.b * factor[1], noise.k * factor[2], noise.lsb, 0.0
            )
            r = truth / ordinate_density(model, f, rate)
            return float(np.sum(count * 0.5 * (r - 1 - np.log(r))))

        best = minimize(divergence, np.zeros(3), method="Nelder-Mead", options={"maxiter": 400})
        return float(best.fun)

    low, high = 1e-9, 1e3
    unit = float(np.median(ordinate_density(noise, f, rate)) / max(shape.max(), 1e-300))
    for _ in range(28):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if left(unit * middle) < nats else (low, middle)
    return unit * float(np.sqrt(low * high))


def lorentzian(f: Array, tc: float, rate: float) -> Array:
    """Variance of an ordinate of exponentially correlated noise with unit variance."""
    return 2 * tc / (1 + (2 * np.pi * f * tc) ** 2) * rate
