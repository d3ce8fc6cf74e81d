"""Effects of the blind benchmark: each drawn at random, sized by the least that can be found.

A matched detector that knew the noise would find an effect of size 1: 1-1.5 times that is near the
limit, 3-10 times well above it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from blind_noise import Array, Noise, information, lorentzian, spectral_scale
from scipy.signal import butter, lfilter

NAMEABLE = (
    "sinusoid", "narrowband", "gauss_markov", "random_telegraph", "step", "warm_up",
    "temperature", "cross_coupling", "outliers", "band_limit", "repeated_samples",
    "variance_change", "quantization", "clock_error",
)  # fmt: skip
OUTSIDE = ("chirp", "am_tone", "heavy_tails", "day_cycle")
MOVING = ("chirp", "am_tone")
"""Tones that a `drifting_line` may be called where they stay within a tenth of their frequency."""


@dataclass(frozen=True)
class Truth:
    """One effect as it was put in.

    Attributes
    ----------
    axis : str
        Empty for what all axes have.
    signal : ndarray, shape (n,), or None
        What was added to the axis.
    again : callable or None
        ``again(rng, values)``: noise of another run of the same axis with the effect in it, where
        the effect is no signal that would be the same in every run.
    """

    kind: str
    axis: str
    level: str
    parameters: dict[str, float | str]
    signal: Array | None = field(default=None, repr=False)
    again: Callable[[np.random.Generator, Array], Array] | None = field(default=None, repr=False)


def repeating(rng: np.random.Generator, t: Array, lengths: Array) -> tuple[Array, Array]:
    """Return when cycles of such lengths begin, anywhere in the first, and what they repeat."""
    begins = np.append(0.0, np.cumsum(lengths)) - rng.random() * lengths[0]
    return begins, swaying(2 * np.pi * np.interp(t, begins, np.arange(float(len(begins)))))


def swaying(turn: Array) -> Array:
    """Return a wave that rises faster than it falls."""
    return np.sin(turn + np.sin(turn) / 2)


def ringing(rng: np.random.Generator, n: int, pole: complex, sigma: float) -> Array:
    """Noise in a band around the angle of the pole."""
    e = rng.normal(size=n + 4000) + 1j * rng.normal(size=n + 4000)
    z = lfilter([np.sqrt(1 - abs(pole) ** 2)], [1, -pole], e)[4000:]
    return sigma * z.real


def forgetting(rng: np.random.Generator, n: int, phi: float, sigma: float) -> Array:
    """First-order Gauss-Markov noise."""
    e = rng.normal(0, sigma * np.sqrt(1 - phi**2), n)
    e[0] = rng.normal(0, sigma)
    return lfilter([1], [1, -phi], e)


def hopping(rng: np.random.Generator, n: int, chance: float, size: float) -> Array:
    """Hop between two values."""
    switches = rng.random(n) < chance
    return size * np.where((np.cumsum(switches) + rng.integers(2)) % 2, 1.0, -1.0)


def added(
    path: Callable[[np.random.Generator], Array],
) -> Callable[[np.random.Generator, Array], Array]:
    """Return how a random process enters another run: with another path."""
    return lambda rng, values: values + path(rng)


def draw_level(rng: np.random.Generator, level: str) -> float:
    """Size in units of the smallest that can be found."""
    return float(rng.uniform(1, 1.5) if level == "near" else np.exp(rng.uniform(*np.log([3, 10]))))


class Maker:
    """Puts one effect into one axis; one method a kind."""

    def __init__(self, rng: np.random.Generator, n: int, rate: float, temperature: Array) -> None:
        self.rng = rng
        self.n = n
        self.rate = rate
        self.t = np.arange(n) / rate
        self.duration = n / rate
        self.temperature = temperature

    def make(
        self, kind: str, axis: str, level: str, noise: Noise, others: dict[str, Array]
    ) -> Truth:
        """Draw the effect `kind` for `axis`."""
        times = draw_level(self.rng, level)
        parameters, signal, *again = getattr(self, kind)(times, noise, others)
        return Truth(kind, axis, level, parameters, signal, *again)

    def _scaled(self, shape: Array, noise: Noise, sigmas: float) -> float:
        return sigmas / np.sqrt(information(shape, noise, self.rate))

    def sinusoid(self, times, noise, _others):
        f = float(np.exp(self.rng.uniform(np.log(5 / self.duration), np.log(0.47 * self.rate))))
        shape = np.sin(2 * np.pi * (f * self.t + self.rng.random()))
        a = times * self._scaled(shape, noise, np.sqrt(2 * (np.log(self.n / 2e-3) + 3)))
        return {"frequency": f, "amplitude": a}, a * shape

    def narrowband(self, times, noise, _others):
        f = float(np.exp(self.rng.uniform(np.log(0.1), np.log(0.4 * self.rate))))
        width = f * float(np.exp(self.rng.uniform(np.log(0.03), np.log(0.2))))
        w0, zeta = 2 * np.pi * f, width / (2 * f)

        def density(x: Array) -> Array:
            w = 2 * np.pi * x
            below = (w0**2 - w**2) ** 2 + (2 * zeta * w0 * w) ** 2
            return 2 * zeta * w0**3 / below * self.rate

        sigma = times * np.sqrt(spectral_scale(density, noise, self.n, self.rate, 14.0) * 1.0)
        pole = np.exp((-zeta * w0 + 1j * w0 * np.sqrt(1 - zeta**2)) / self.rate)
        path = partial(ringing, n=self.n, pole=pole, sigma=sigma)
        parameters = {"frequency": f, "bandwidth": width, "sigma": sigma}
        return parameters, path(self.rng), added(path)

    def gauss_markov(self, times, noise, _others):
        tc = float(np.exp(self.rng.uniform(np.log(0.3), np.log(100))))
        density = partial(lorentzian, tc=tc, rate=self.rate)
        sigma = times * np.sqrt(spectral_scale(density, noise, self.n, self.rate, 12.0))
        path = partial(forgetting, n=self.n, phi=np.exp(-1 / (tc * self.rate)), sigma=sigma)
        return {"sigma": sigma, "correlation_time": tc}, path(self.rng), added(path)

    def random_telegraph(self, times, noise, _others):
        dwell = float(np.exp(self.rng.uniform(np.log(2), np.log(120))))
        tc = dwell / 2
        density = partial(lorentzian, tc=tc, rate=self.rate)
        a = times * np.sqrt(spectral_scale(density, noise, self.n, self.rate, 12.0))
        path = partial(hopping, n=self.n, chance=1 / (dwell * self.rate), size=a)
        return {"amplitude": a, "dwell": dwell}, path(self.rng), added(path)

    def step(self, times, noise, _others):
        at = float(self.rng.uniform(0.08, 0.92)) * self.duration
        shape = (self.t >= at).astype(float)
        size = times * self._scaled(shape, noise, 6.33) * self.rng.choice([-1, 1])
        return {"time": at, "size": float(size)}, size * shape

    def warm_up(self, times, noise, _others):
        tc = float(np.exp(self.rng.uniform(np.log(60), np.log(self.duration / 6))))
        shape = np.exp(-self.t / tc)
        a = times * self._scaled(shape, noise, 6.33) * self.rng.choice([-1, 1])
        return {"time_constant": tc, "amplitude": float(a)}, a * shape

    def temperature_effect(self, times, noise, _others):
        slope = times * self._scaled(self.temperature, noise, 5.5) * self.rng.choice([-1, 1])
        return {"slope": float(slope)}, slope * (self.temperature - self.temperature[0])

    def cross_coupling(self, times, noise, others):
        source = str(self.rng.choice(sorted(others)))
        x = others[source] - others[source].mean()
        slope = times * self._scaled(x, noise, 5.5) * self.rng.choice([-1, 1])
        return {"source": source, "slope": float(slope)}, slope * x

    def outliers(self, times, noise, _others):
        count = int(self.rng.integers(3, 60))
        at = self.rng.choice(self.n - 20, count, replace=False) + 10
        sigma = np.hypot(noise.n * np.sqrt(self.rate), noise.lsb / np.sqrt(12))
        signal = np.zeros(self.n)
        size = 7.8 * sigma * times * np.exp(self.rng.uniform(0, 0.5, count))
        signal[at] = size * self.rng.choice([-1, 1], count)
        return {"count": float(count)}, signal

    def band_limit(self, times, _noise, _others):
        """Low-pass the whole axis: a one-pole, or a Butterworth."""
        if self.rng.random() < 0.5:
            highest = 0.6 / times**0.5
            cutoff = self.rate * float(np.exp(self.rng.uniform(np.log(0.08), np.log(highest))))
            phi = np.exp(-2 * np.pi * cutoff / self.rate)
            b, a = [1 - phi], [1, -phi]
        else:
            cutoff = self.rate * float(np.exp(self.rng.uniform(np.log(0.08), np.log(0.4))))
            b, a = butter(int(self.rng.integers(1, 4)), 2 * cutoff / self.rate)
        return {"cutoff": cutoff}, None, lambda _rng, values: lfilter(b, a, values)

    def variance_change(self, times, noise, _others):
        """Raise the white level in one interval."""
        n, rate = self.n, self.rate
        length = float(np.exp(self.rng.uniform(np.log(20), np.log(0.3 * n / rate))))
        start = float(self.rng.uniform(0.03, 0.95 - length * rate / n)) * n / rate
        change = times * 5.5 * np.sqrt(2 / (length * rate))
        inside = slice(int(start * rate), int((start + length) * rate))

        def louder(rng, values):
            values = values.copy()
            count = inside.stop - inside.start
            values[inside] += rng.normal(0, noise.n * np.sqrt(rate * change), count)
            return values

        ratio = float(np.sqrt(1 + change))
        return (
            {"intervals": 1.0, "start": start, "length": length, "ratio": ratio}, None, louder,
        )  # fmt: skip

    def chirp(self, times, noise, _others):
        f0 = float(np.exp(self.rng.uniform(np.log(0.3), np.log(0.35 * self.rate))))
        f1 = f0 * self.rng.uniform(1.05, 1.25)
        phase = f0 * self.t + (f1 - f0) * self.t**2 / (2 * self.duration)
        sigma = noise.n * np.sqrt(self.rate)
        a = sigma * times * 0.15
        return {"frequency_low": f0, "frequency_high": f1}, a * np.sin(2 * np.pi * phase)

    def am_tone(self, times, noise, _others):
        f0 = float(np.exp(self.rng.uniform(np.log(0.3), np.log(0.45 * self.rate))))
        envelope = 1 + 0.9 * np.sin(2 * np.pi * self.rng.uniform(1.5, 6) * self.t / self.duration)
        shape = envelope * np.sin(2 * np.pi * f0 * self.t)
        a = times * self._scaled(shape, noise, 9.0)
        return {"frequency_low": f0, "frequency_high": f0}, a * shape

    def heavy_tails(self, times, noise, _others):
        sigma = noise.n * np.sqrt(self.rate)
        return {}, sigma * self.rng.uniform(0.7, 1.5) * self.rng.standard_t(4.5, self.n)

    def day_cycle(self, times, noise, _others):
        period = self.duration * self.rng.uniform(0.9, 2.5)
        shape = np.sin(2 * np.pi * (self.t / period + self.rng.random()))
        a = times * self._scaled(shape, noise, 12.0)
        return {}, a * shape
