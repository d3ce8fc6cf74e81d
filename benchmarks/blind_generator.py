"""Records with undeclared effects and known truth, for the blind benchmark.

Shares nothing with ``allanscope.simulator``: the noise is synthesised in its own way, so that the
loop is not judged by the very formulas it fits. Sizes are drawn relative to the smallest size that
a matched detector which knew the noise would find (`MDS`): 1-1.5 times near the limit, 3-10 times
well above it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, irfft, next_fast_len, rfft
from scipy.optimize import minimize
from scipy.signal import butter, lfilter

from allanscope.history import Record

AXES = ("gx", "gy", "gz", "ax", "ay", "az")
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Textbook noise of one axis (IEEE 952, two-sided densities) and its step."""

    n: float
    b: float
    k: float
    lsb: float
    offset: float


@dataclass(frozen=True)
class Truth:
    """One effect as it was put in. `cannot_name` marks processes outside the vocabulary."""

    kind: str
    axis: str
    level: str
    parameters: dict[str, float | str]
    signal: Array | None = field(default=None, repr=False)
    variance: Callable[[Array], Array] | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Blind:
    """A record and the truth about it."""

    record: Record
    nominal_hz: float
    rate_fit: tuple[float, float]
    truths: tuple[Truth, ...]
    noise: dict[str, Noise]


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
        parameters, signal = getattr(self, kind)(times, noise, others)
        return Truth(kind, axis, level, parameters, signal)

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
        e = self.rng.normal(size=self.n + 4000) + 1j * self.rng.normal(size=self.n + 4000)
        z = lfilter([np.sqrt(1 - abs(pole) ** 2)], [1, -pole], e)[4000:]
        return {"frequency": f, "bandwidth": width, "sigma": sigma}, sigma * z.real

    def gauss_markov(self, times, noise, _others):
        tc = float(np.exp(self.rng.uniform(np.log(0.3), np.log(100))))
        density = partial(lorentzian, tc=tc, rate=self.rate)
        sigma = times * np.sqrt(spectral_scale(density, noise, self.n, self.rate, 12.0))
        phi = np.exp(-1 / (tc * self.rate))
        e = self.rng.normal(0, sigma * np.sqrt(1 - phi**2), self.n)
        e[0] = self.rng.normal(0, sigma)
        return {"sigma": sigma, "correlation_time": tc}, lfilter([1], [1, -phi], e)

    def random_telegraph(self, times, noise, _others):
        dwell = float(np.exp(self.rng.uniform(np.log(2), np.log(120))))
        tc = dwell / 2
        density = partial(lorentzian, tc=tc, rate=self.rate)
        a = times * np.sqrt(spectral_scale(density, noise, self.n, self.rate, 12.0))
        switches = self.rng.random(self.n) < 1 / (dwell * self.rate)
        state = np.where((np.cumsum(switches) + self.rng.integers(2)) % 2, 1.0, -1.0)
        return {"amplitude": a, "dwell": dwell}, a * state

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


NAMEABLE = (
    "sinusoid", "narrowband", "gauss_markov", "random_telegraph", "step", "warm_up",
    "temperature", "cross_coupling", "outliers", "band_limit", "repeated_samples",
    "variance_change", "quantization", "clock_error",
)  # fmt: skip
OUTSIDE = ("chirp", "am_tone", "heavy_tails", "day_cycle")


def draw_temperature(rng: np.random.Generator, n: int, rate: float) -> tuple[Array, Array]:
    """Return true and measured temperature: a room whose heater cycles, and a drift."""
    t = np.arange(n) / rate
    period = rng.uniform(900, 3000)
    true = 26 + rng.uniform(0.2, 0.6) * np.sin(2 * np.pi * (t / period + rng.random()))
    grid = np.arange(0, t[-1] + 120, 60.0)
    true = true + np.interp(t, grid, np.cumsum(rng.normal(0, 0.03, len(grid))))
    read = true + rng.normal(0, 0.02, n)
    return true, np.round(read * 256) / 256


def make_blind(
    seed: int,
    kinds: tuple[tuple[str, str], ...],
    hours: float = 2.0,
    rate: float = 104.0,
    axes: tuple[str, ...] = AXES,
) -> Blind:
    """Return a record that holds the `kinds`, each a pair (kind, "near" or "above")."""
    rng = np.random.default_rng([seed, 77])
    n = int(hours * 3600 * rate)
    noise = {axis: draw_noise(rng, axis) for axis in axes}
    values = {axis: base_noise(rng, noise[axis], n, rate) for axis in axes}
    true_c, read_c = draw_temperature(rng, n, rate)
    maker = Maker(rng, n, rate, true_c)
    order = list(rng.permutation(list(axes)))
    truths: list[Truth] = []
    nominal, measured = rate, (rate * (1 + rng.normal(0, 10e-6)), rate * 15e-6)
    rows = {}
    for kind, level in kinds:
        axis = str(order.pop())
        times = draw_level(rng, level)
        if kind == "band_limit":
            values[axis], parameters = band_limited(rng, values[axis], rate, times)
            truths.append(Truth(kind, axis, level, parameters))
        elif kind == "variance_change":
            values[axis], parameters = burst(rng, noise[axis], values[axis], rate, times)
            truths.append(Truth(kind, axis, level, parameters))
        elif kind == "quantization":
            sigma = noise[axis].n * np.sqrt(rate)
            ratio = rng.uniform(0.36, 0.46) if level == "near" else rng.uniform(0.2, 0.35)
            noise[axis] = replace(noise[axis], lsb=sigma / ratio)
            truths.append(Truth(kind, axis, level, {"step": sigma / ratio}))
        elif kind == "clock_error":
            sd = 15e-6
            relative = float(sd * 7 * times if level == "near" else rng.uniform(2e-3, 6e-2))
            relative *= float(rng.choice([-1, 1]))
            nominal = rate / (1 + relative)
            truths.append(Truth(kind, "", level, {"relative": relative}))
        elif kind == "repeated_samples":
            fraction = 2e-4 * times if level == "near" else float(np.exp(rng.uniform(-6, -2)))
            rows["repeat"] = rng.random(n) < fraction
            rows["repeat"][0] = False
            truths.append(Truth(kind, "", level, {"fraction": fraction}))
        else:
            name = "temperature_effect" if kind == "temperature" else kind
            others = {a: v for a, v in values.items() if a != axis}
            truth = maker.make(name, axis, level, noise[axis], others)
            truths.append(replace(truth, kind=kind))
            assert truth.signal is not None
            values[axis] = values[axis] + truth.signal
    table = np.column_stack([values[a] + noise[a].offset for a in axes])
    lsb = np.array([noise[a].lsb for a in axes])
    table = np.round(table / lsb) * lsb
    if "repeat" in rows:
        source = np.arange(n)
        source[rows["repeat"]] = 0
        table = table[np.maximum.accumulate(source)]
    record = Record(
        rate_hz=rate,
        stride=1,
        axes=axes,
        values=table,
        lsb=tuple(float(x) for x in lsb),
        temperature_c=read_c,
        start_s=np.arange(n) / rate,
        segments=np.array([[0, n]], np.int64),
    )
    return Blind(record, nominal, measured, tuple(truths), noise)


def band_limited(rng, values, rate, times):
    """Low-pass the whole axis: a one-pole, or a Butterworth of second order."""
    if rng.random() < 0.5:
        cutoff = rate * float(np.exp(rng.uniform(np.log(0.08), np.log(0.6 / times**0.5))))
        phi = np.exp(-2 * np.pi * cutoff / rate)
        return lfilter([1 - phi], [1, -phi], values), {"cutoff": cutoff}
    cutoff = rate * float(np.exp(rng.uniform(np.log(0.08), np.log(0.4))))
    b, a = butter(int(rng.integers(1, 4)), 2 * cutoff / rate)
    return lfilter(b, a, values), {"cutoff": cutoff}


def burst(rng, noise, values, rate, times):
    """Raise the white level in one interval."""
    n = len(values)
    length = float(np.exp(rng.uniform(np.log(20), np.log(0.3 * n / rate))))
    start = float(rng.uniform(0.03, 0.95 - length * rate / n)) * n / rate
    change = times * 5.5 * np.sqrt(2 / (length * rate))
    inside = slice(int(start * rate), int((start + length) * rate))
    values = values.copy()
    count = inside.stop - inside.start
    values[inside] += rng.normal(0, noise.n * np.sqrt(rate * change), count)
    return values, {
        "intervals": 1.0,
        "start": start,
        "length": length,
        "ratio": float(np.sqrt(1 + change)),
    }


def draw_kinds(rng: np.random.Generator, index: int) -> tuple[tuple[str, str], ...]:
    """None, one or two effects; every kind comes round equally often."""
    pool = NAMEABLE + OUTSIDE
    level = "near" if rng.random() < 0.5 else "above"
    first = (pool[index % len(pool)], level)
    if first[0] in OUTSIDE:
        return ((first[0], "above"),)
    if rng.random() < 0.3:
        second = (str(rng.choice(NAMEABLE)), "near" if rng.random() < 0.5 else "above")
        if second[0] != first[0]:
            return (first, second)
    return (first,)
