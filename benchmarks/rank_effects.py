"""Records that hide one effect of known size, for `rank_calibration.py`; one method a kind.

The size of an effect is d', the square root of twice the log-likelihood ratio of one who knows the
noise and what to look for, over the best N, B and K without it (`ideal.py`). Sizes are even in
their logarithm, from well below to well above what can be found, before N, B and K have taken up
what they can.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from blind_effects import forgetting, hopping, repeating, ringing, swaying
from blind_noise import (
    Array,
    Noise,
    base_noise,
    draw_noise,
    information,
    lorentzian,
    ordinate_density,
    spectral_scale,
)
from ideal import best_nats, nats_of_process, nats_of_signal, ordinates, size_of
from injection_effects import Injector
from scipy.fft import idct
from scipy.signal import lfilter
from scipy.special import ndtr

from allanscope.history import Record

RATE, SECONDS = 13.0, 240.0
LSB = 4.375e-3
SIZES = (2.25, 18.0)
CRYSTAL = 15e-6
"""Relative standard error of a rate that is measured."""


@dataclass(frozen=True)
class Hidden:
    """A record and what is in it.

    Attributes
    ----------
    kind : str
        Of the effect.
    d : float
        Its size; NaN of what is read off the values.
    truth : dict
        Parameter to its true value.
    values : ndarray, shape (n, axes)
        Samples before they are rounded.
    places : dict
        Parameter to how far a finding may be from the truth and still be the same effect.
    """

    kind: str
    d: float
    truth: dict[str, float]
    values: Array
    rate: float = RATE
    lsb: float = LSB
    places: dict[str, float] = field(default_factory=dict)
    temperature: Array | None = None
    clock: tuple[float, tuple[float, float]] | None = None

    @property
    def record(self) -> Record:
        """The record as it is searched."""
        n, axes = self.values.shape
        return Record(
            rate_hz=self.rate,
            stride=1,
            axes=("gx", "gy")[:axes],
            values=np.round(self.values / self.lsb) * self.lsb,
            lsb=(self.lsb,) * axes,
            temperature_c=np.full(n, np.nan) if self.temperature is None else self.temperature,
            start_s=np.arange(n) / self.rate,
            segments=np.array([[0, n]], np.int64),
        )


class Hider:
    """Hides an effect; every call of a method is another draw."""

    def __init__(self, rng: np.random.Generator, rate: float = RATE, seconds: float = SECONDS):
        self.rng, self.rate, self.duration = rng, rate, seconds
        self.n = int(rate * seconds)
        self.t = np.arange(self.n) / rate
        self.noise = replace(draw_noise(rng, "gx"), lsb=LSB)
        self.d = self.between(*SIZES)
        self.sigma = float(np.hypot(self.noise.n * np.sqrt(rate), LSB / np.sqrt(12)))

    def between(self, low: float, high: float) -> float:
        """Draw a number evenly in its logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def sign(self) -> float:
        """Draw one."""
        return float(self.rng.choice([-1, 1]))

    def base(self, noise: Noise | None = None) -> Array:
        """Draw the noise of an axis."""
        noise = noise or self.noise
        return base_noise(self.rng, noise, self.n, self.rate) + noise.offset

    def scale(self, shape: Array) -> float:
        """Return the factor that makes a signal of size d' of a shape."""
        size = self.d / float(np.sqrt(information(shape, self.noise, self.rate)))
        self.d = size_of(nats_of_signal(size * shape, self.noise, self.rate))
        return size

    def process(self, density: Callable[[Array], Array]) -> float:
        """Return the factor that makes a process of size d' of a density."""
        factor = spectral_scale(density, self.noise, self.n, self.rate, self.d**2 / 2)
        extra = factor * density(ordinates(self.n, self.rate))
        self.d = size_of(nats_of_process(extra, self.noise, self.rate))
        return factor

    def hidden(self, kind: str, truth: dict[str, float], signal: Array, **more) -> Hidden:
        """Return a signal in the noise of one axis."""
        rows = self.base() + signal
        return Hidden(kind, self.d, truth, rows[:, np.newaxis], self.rate, **more)

    # --- signals --------------------------------------------------------------------------------

    def step(self) -> Hidden:
        at = self.rng.uniform(0.1, 0.9) * self.duration
        shape = (self.t >= at).astype(float)
        size = self.scale(shape) * self.sign()
        return self.hidden("step", {"time": at, "size": size}, size * shape, places={"time": 40.0})

    def relaxation(self) -> Hidden:
        """Let a jump creep back, all of the way or to six tenths of it."""
        self.d *= 2.0
        at, tc = self.rng.uniform(0.1, 0.6) * self.duration, self.between(6.0, 0.15 * self.duration)
        lasting = self.rng.uniform(0.0, 0.6)
        creep = np.exp(-np.maximum(self.t - at, 0.0) / tc)
        shape = np.where(self.t >= at, lasting + (1.0 - lasting) * creep, 0.0)
        size = self.scale(shape) * self.sign()
        truth = {"time": at, "size": size, "time_constant": tc, "lasting": lasting * size}
        return self.hidden("relaxation", truth, size * shape, places={"time": 40.0})

    def excursion(self) -> Hidden:
        at = self.rng.uniform(0.1, 0.75) * self.duration
        length = self.between(6.0, 0.1 * self.duration)
        shape = ((self.t >= at) & (self.t < at + length)).astype(float)
        size = self.scale(shape) * self.sign()
        truth = {"time": at, "duration": length, "size": size}
        return self.hidden("excursion", truth, size * shape, places={"time": 20.0})

    def sinusoid(self) -> Hidden:
        f = self.rng.uniform(10 / self.duration, 0.47 * self.rate)
        shape = np.sin(2 * np.pi * (f * self.t + self.rng.random()))
        size = self.scale(shape)
        return self.hidden(
            "sinusoid", {"frequency": f, "amplitude": size}, size * shape,
            places={"frequency": 4 / self.duration},
        )  # fmt: skip

    def drifting_line(self) -> Hidden:
        """Let the frequency of a tone swing, and its amplitude swell."""
        self.d *= 2.0
        f, reach = self.rng.uniform(1.0, 5.0), self.between(3.0, 8.0) / self.duration
        u = self.t / self.duration
        swing, swell, start = self.rng.uniform(0, 2 * np.pi, 3)
        phase = 2 * np.pi * f * self.t + start
        phase -= reach * self.duration * np.cos(2 * np.pi * u + swing)
        shape = (1 + 0.3 * np.sin(2 * np.pi * 1.5 * u + swell)) * np.sin(phase)
        size = self.scale(shape)
        ends = np.quantile(f + reach * np.sin(2 * np.pi * u + swing), [0.05, 0.95])
        truth = {
            "frequency": f, "bandwidth": float(ends[1] - ends[0]),
            "sigma": size * float(np.sqrt(np.mean(shape**2))),
        }  # fmt: skip
        places = {"frequency": 0.3}
        return self.hidden("drifting_line", truth, size * shape, places=places)

    def cycle(self) -> Hidden:
        """Repeat a waveform of the level for twenty minutes."""
        self.__init__(self.rng, self.rate, 1200.0)
        self.d *= 3.0
        period, scatter = self.rng.uniform(40.0, 100.0), self.rng.uniform(0.08, 0.2)
        lengths = period * np.exp(scatter * self.rng.standard_normal(80) - scatter**2 / 2)
        _, shape = repeating(self.rng, self.t, lengths)
        rms = float(np.std(swaying(np.linspace(0.0, 2 * np.pi, 1000, endpoint=False))))
        size = self.scale(shape)
        truth, places = {"period": period, "sigma": size * rms}, {"period": 0.15 * period}
        return self.hidden("cycle", truth, size * shape, places=places)

    def warm_up(self) -> Hidden:
        tc = self.between(12.0, 0.2 * self.duration)
        shape = np.exp(-self.t / tc)
        size = self.scale(shape) * self.sign()
        return self.hidden("warm_up", {"time_constant": tc, "amplitude": size}, size * shape)

    def shock(self) -> Hidden:
        """Knock an axis that is sampled fast."""
        self.__init__(self.rng, 104.0, 40.0)
        at, decay = self.rng.uniform(0.1, 0.85) * self.duration, self.between(0.2, 0.8)
        after = np.maximum(self.t - at, 0.0)
        swing = np.cos(2 * np.pi * (15.6 * after + self.rng.random()))
        shape = np.exp(-after / decay) * swing * (self.t >= at)
        self.d = self.between(2.5, 80.0)
        size = self.scale(shape)
        # Its end is where it is as loud as the noise, which is a matter of definition.
        truth = {"time": at, "peak": size * float(np.abs(shape).max())}
        return self.hidden("shock", truth, size * self.sign() * shape, places={"time": 3.0})

    def outliers(self) -> Hidden:
        count = int(self.rng.integers(2, 6))
        at = self.rng.choice(self.n - 60, count, replace=False) + 30
        signal = np.zeros(self.n)
        signal[at] = self.d * self.sigma * self.rng.choice([-1, 1], count)
        return self.hidden("outliers", {"count": float(count)}, signal)

    def temperature(self) -> Hidden:
        return self._thermal(lambda x: x, "slope")

    def temperature_lag(self) -> Hidden:
        lag = self.between(12.0, 30.0)
        return self._thermal(lambda x: _late(x, lag * self.rate), "slope", lag=lag)

    def temperature_curve(self) -> Hidden:
        return self._thermal(lambda x: x**2, "curvature")

    def _thermal(self, felt: Callable[[Array], Array], name: str, **truth: float) -> Hidden:
        room = Injector.room(self.rng, self.n, self.rate)
        shape = felt(room - room.mean())
        shape = shape - shape.mean()
        size = self.scale(shape) * self.sign()
        read = np.round((room + self.rng.normal(0, 0.02, self.n)) * 256) / 256
        return self.hidden("temperature", {name: size, **truth}, size * shape, temperature=read)

    def cross_coupling(self) -> Hidden:
        """Let a source that tilts leak into the axis."""
        other = replace(draw_noise(self.rng, "gy"), lsb=LSB)
        tilt = forgetting(self.rng, self.n, np.exp(-1 / (5 * self.rate)), 3 * self.sigma)
        source = self.base(other) + tilt
        slope = self.scale(source - source.mean()) * self.sign()
        rows = self.base() + slope * (source - source.mean())
        both = np.column_stack([rows, source])
        return Hidden("cross_coupling", self.d, {"slope": slope}, both, self.rate)

    # --- noise ----------------------------------------------------------------------------------

    def gauss_markov(self) -> Hidden:
        tc = self.between(0.3, 8.0)
        sigma = float(np.sqrt(self.process(partial(lorentzian, tc=tc, rate=self.rate))))
        path = forgetting(self.rng, self.n, float(np.exp(-1 / (self.rate * tc))), sigma)
        return self.hidden("gauss_markov", {"sigma": sigma, "correlation_time": tc}, path)

    def random_telegraph(self) -> Hidden:
        self.d *= 2.0
        dwell = self.between(1.0, 12.0)
        density = partial(lorentzian, tc=dwell / 2, rate=self.rate)
        size = float(np.sqrt(self.process(density)))
        chance = -0.5 * float(np.expm1(-2 / (dwell * self.rate)))
        path = hopping(self.rng, self.n, chance, size)
        return self.hidden("random_telegraph", {"amplitude": size, "dwell": dwell}, path)

    def narrowband(self) -> Hidden:
        f = self.between(0.4, 0.35 * self.rate)
        width = f * self.between(0.03, 0.2)
        w0, zeta = 2 * np.pi * f, width / (2 * f)

        def density(x: Array) -> Array:
            w = 2 * np.pi * x
            below = (w0**2 - w**2) ** 2 + (2 * zeta * w0 * w) ** 2
            return 2 * zeta * w0**3 / below * self.rate

        sigma = float(np.sqrt(self.process(density)))
        pole = np.exp((-zeta * w0 + 1j * w0 * np.sqrt(1 - zeta**2)) / self.rate)
        path = ringing(self.rng, self.n, pole, sigma)
        truth = {"frequency": f, "bandwidth": width, "sigma": sigma}
        return self.hidden("narrowband", truth, path, places={"frequency": max(2 * width, 0.1)})

    def power_law(self) -> Hidden:
        """Draw a slope, and a density at 1 Hz beside that of the white noise.

        In few rows N, B and K imitate any size of it: it takes a longer record.
        """
        self.__init__(self.rng, self.rate, 5 * SECONDS)
        exponent = float(
            self.rng.choice([self.rng.uniform(0.3, 0.75), self.rng.uniform(1.25, 1.7)])
        )
        f = ordinates(self.n, self.rate)
        power = self.between(0.03, 30.0) * self.noise.n**2
        density = self.rate * (self.rate / np.pi * np.sin(np.pi * f / self.rate)) ** -exponent
        self.d = size_of(nats_of_process(power * density, self.noise, self.rate))
        path = self.rng.normal(size=self.n - 1) * np.sqrt(power * density)
        path = idct(np.concatenate([[0.0], path]), norm="ortho")
        truth = {"exponent": exponent, "density": float(np.sqrt(power))}
        return self.hidden("power_law", truth, path)

    def band_limit(self) -> Hidden:
        """Let one pole pass the lower part of the band."""
        cutoff = self.rate * self.between(0.05, 1.2)
        keep = float(np.exp(-2 * np.pi * cutoff / self.rate))
        rows = lfilter([1 - keep], [1, -keep], self.base() - self.noise.offset)[200:]
        f = ordinates(len(rows), self.rate)
        angle = 2 * np.pi * f / self.rate
        gain = (1 - keep) ** 2 / (1 - 2 * keep * np.cos(angle) + keep**2)
        rounding = LSB**2 / 12  # it comes after the filter
        passed = gain * (ordinate_density(self.noise, f, self.rate) - rounding) + rounding
        self.d = size_of(best_nats(passed, np.zeros(len(f)), self.noise, self.rate))
        return Hidden("band_limit", self.d, {"cutoff": cutoff}, rows[:, np.newaxis], self.rate)

    def high_pass(self) -> Hidden:
        """Take away the level that an exponential average follows."""
        corner = self.between(10.0, 80.0) / (2 * self.duration)
        lag = self.rate / (2 * np.pi * corner)
        rows = self.base() - self.noise.offset
        rows = rows - _late(rows, lag)
        f = ordinates(self.n, self.rate)
        turn, keep = 2 * np.cos(2 * np.pi * f / self.rate), float(np.exp(-1 / lag))
        gain = keep**2 * (2 - turn) / (1 - keep * turn + keep**2)
        passed = gain * ordinate_density(self.noise, f, self.rate)
        self.d = size_of(best_nats(passed, np.zeros(len(f)), self.noise, self.rate))
        return Hidden("high_pass", self.d, {"corner": corner}, rows[:, np.newaxis], self.rate)

    def variance_change(self) -> Hidden:
        length = self.between(20.0, 0.3 * self.duration)
        start = self.rng.uniform(0.05, 0.95 - length / self.duration) * self.duration
        inside = (self.t >= start) & (self.t < start + length)
        ratio = _loudness(self.d**2 / np.count_nonzero(inside))
        rows = self.base()
        extra = np.sqrt(ratio - 1) * self.sigma * self.rng.standard_normal(self.n)
        ends = {"start": start, "stop": start + length}
        truth = {"intervals": 1.0, **ends, "ratio": float(np.sqrt(ratio))}
        rows = (rows + inside * extra)[:, np.newaxis]
        return Hidden("variance_change", self.d, truth, rows, self.rate)

    def scale_drift(self) -> Hidden:
        # Over the record log s^2 goes from -c to c, nearly: n c^2 / 6 is d'^2.
        relative = float(np.expm1(self.sign() * min(self.d * np.sqrt(6 / self.n), 1.2)))
        s = 1 + relative * np.arange(self.n) / self.n
        log = np.log(s**2) - np.log(np.mean(s**2))
        self.d = float(np.sqrt(-np.sum(log)))
        rows = (self.base() - self.noise.offset) * s
        return Hidden("scale_drift", self.d, {"relative": relative}, rows[:, np.newaxis], self.rate)

    def amplitude_coupling(self) -> Hidden:
        """Let the source be shaken now and then, and samples be as loud as it moves."""
        block = 64
        pieces = self.n // block + 1
        envelope = np.repeat(np.exp(self.rng.normal(0, 0.8, pieces)), block)[: self.n]
        other = replace(draw_noise(self.rng, "gy"), lsb=LSB)
        motion = 8 * self.sigma * envelope * self.rng.normal(size=self.n)
        source = self.base(other) + motion
        spread = float(np.var(envelope**2) / np.mean(envelope**2) ** 2)
        share = min(self.d / np.sqrt(0.5 * self.n * spread), 0.95)
        # Of the white noise, so much follows the square of the motion.
        power = motion**2 / np.mean(motion**2)
        change = 1 + share * (power - 1)
        own = np.sqrt(change) * self.sigma * self.rng.normal(size=self.n)
        self.d = float(np.sqrt(-np.sum(np.log(change))))
        slope = float(np.sqrt(share * self.sigma**2 / np.mean(motion**2)))
        both = np.column_stack([own, source])
        return Hidden(
            "amplitude_coupling", self.d, {"share": share, "slope": slope}, both, self.rate
        )

    # --- what is read off the values --------------------------------------------------------------

    def repeated_samples(self) -> Hidden:
        fraction = self.between(0.01, 0.3)
        repeats = self.rng.random(self.n) < fraction
        repeats[0] = False
        rows = self.base()[np.maximum.accumulate(np.where(repeats, 0, np.arange(self.n)))]
        truth = {"fraction": fraction}
        return Hidden("repeated_samples", np.nan, truth, rows[:, np.newaxis], self.rate, LSB / 4)

    def saturation(self) -> Hidden:
        level = LSB * round(self.rng.uniform(1.3, 2.6) * self.sigma / LSB)
        rows = self.noise.n * np.sqrt(self.rate) * self.rng.standard_normal(self.n)
        share = float(ndtr(-(level - LSB / 2) / (self.noise.n * np.sqrt(self.rate))))
        truth = {"level": level, "fraction": share}
        rows = np.minimum(rows, level)[:, np.newaxis]
        return Hidden("saturation", np.nan, truth, rows, self.rate)

    def dead_zone(self) -> Hidden:
        """Replace what is within three to eight codes around one by it, before it is rounded."""
        sigma = self.noise.n * np.sqrt(self.rate)
        level = LSB * round(self.rng.uniform(-0.7, 0.7) * sigma / LSB)
        width = self.rng.uniform(3.0, 8.0) * LSB
        rows = sigma * self.rng.standard_normal(self.n)
        rows = np.where(np.abs(rows - level) < width / 2, level, rows)
        share = float(np.diff(ndtr((level + np.array([-0.5, 0.5]) * width) / sigma))[0])
        truth = {"level": level, "width": width, "fraction": share}
        return Hidden("dead_zone", np.nan, truth, rows[:, np.newaxis], self.rate)

    def quantization(self) -> Hidden:
        sigma = self.noise.n * np.sqrt(self.rate)
        step = LSB * max(round(sigma / self.between(0.2, 0.7) / LSB), 1)
        return Hidden(
            "quantization", np.nan, {"step": step}, self.base()[:, np.newaxis], self.rate, step
        )

    def clock_error(self) -> Hidden:
        relative = self.sign() * self.between(8 * CRYSTAL, 2e-2)
        measured = self.rate * (1 + self.rng.normal(0, CRYSTAL))
        clock = (self.rate / (1 + relative), (measured, self.rate * CRYSTAL))
        found = self.hidden("clock_error", {"relative": relative}, np.zeros(self.n), clock=clock)
        return replace(found, d=abs(relative) / CRYSTAL)


STUDIES = tuple(
    name for name, one in vars(Hider).items()
    if not name.startswith("_") and getattr(one, "__annotations__", {}).get("return") == "Hidden"
    and name != "hidden"
)  # fmt: skip
"""Every kind with a parameter that has an interval, two forms of `temperature` among them."""


def _late(x: Array, lag: float) -> Array:
    keep = float(np.exp(-1 / lag))
    return lfilter([1 - keep], [1, -keep], x, zi=[keep * x[0]])[0]


def _loudness(nats: float) -> float:
    """Return the ratio r of variances at which r - 1 - ln r is so much."""
    low, high = 1.0, 100.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if middle - 1 - np.log(middle) < nats else (low, middle)
    return low
