"""Effects that `injection.py` puts into measured noise, sized by the least that can be found there.

Of a line and of a step that is the limit which the result prints for the axis. Of any other signal
it is the size that a detector who knows the noise of the axis finds, and of a process what N, B and
K cannot take up (`Injector._process`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from blind_effects import Maker, forgetting, hopping, repeating, ringing
from blind_noise import Array, lorentzian
from scipy.fft import dct, idct
from scipy.optimize import minimize
from scipy.signal import lfilter

from allanscope.explain import AxisExplanation
from allanscope.history import Record

KINDS = (
    *("sinusoid", "drifting_line", "narrowband", "gauss_markov", "random_telegraph", "power_law"),
    *("step", "excursion", "warm_up", "outliers", "shock", "variance_change", "scale_drift"),
    *("relaxation", "temperature", "temperature_lag", "temperature_curve", "cross_coupling"),
    *("amplitude_coupling", "band_limit", "repeated_samples", "saturation", "dead_zone", "cycle"),
)
FORMS = {
    "temperature_lag": ("temperature", "lag"),
    "temperature_curve": ("temperature", "curvature"),
}
"""Forms of a kind, and the parameter that tells each."""
LONG_S = 200.0
"""What relaxes or follows a room takes so long at the least."""
COHERENCES = 15.0
"""Of a noise band in a record: fewer do not show that it is noise."""
DRIFT = 0.004
"""Width over frequency of a line that drifts."""
BEGINNINGS = ((0.0, -4.0, -4.0), (0.0, 0.0, -4.0), (0.0, -12.0, 0.0), (0.0, 6.0, 6.0))
"""Logarithms of N, B and K from which the likeliest are searched: from one alone it sticks."""
LONGEST_EXCURSION = 0.2
"""As a share of a record."""

Truth = dict[str, float | str]


@dataclass(frozen=True)
class Carrier:
    """An axis that effects are put into.

    Attributes
    ----------
    name : str
        Recording and axis.
    record : Record
        The axis and another one of the same sensor, from which a coupling may come, with a dither
        of two steps (triangular, peak to peak) on both and not yet rounded: rounded afterwards,
        their mean is linear in what is put in, and the power of the rounding the same everywhere.
    known : AxisExplanation
        What the loop finds without any injection.
    line, step : float
        Printed limits.
    variance : ndarray, shape (n - 1,)
        Of the ordinates, by the model.
    clean : ndarray, shape (n,)
        Samples without the deterministic effects.
    """

    name: str
    record: Record
    known: AxisExplanation
    line: float
    step: float
    variance: Array
    clean: Array

    @property
    def axis(self) -> str:
        """Its name."""
        return self.record.axes[0]


class Injector(Maker):
    """Puts one effect into a carrier; one method a kind."""

    def __init__(self, rng: np.random.Generator, carrier: Carrier) -> None:
        n, rate = len(carrier.record.values), carrier.record.rate_hz
        super().__init__(rng, n, rate, self.room(rng, n, rate))
        self.carrier = carrier

    def inject(self, kind: str, times: float) -> tuple[Truth, Array, Array | None] | None:
        """Return the truth, both axes with the effect, and the temperature if there is one.

        None where the carrier has no room for it.
        """
        whole = self.carrier.record.values
        own, other = whole.T
        if any(e.kind == FORMS.get(kind, (kind,))[0] for e in self.carrier.known.effects):
            return None
        method = "temperature_effect" if kind == "temperature" else kind
        found = getattr(self, method)(times, None, {self.carrier.record.axes[1]: other})
        if found is None:
            return None
        truth, signal, *again = found
        values = whole.copy()
        if signal is None:
            changed = again[0](self.rng, own)
            values = changed if changed.ndim > 1 else np.column_stack([changed, other])
        else:
            values[:, 0] = own + signal
        return truth, values, self.temperature if kind.startswith("temperature") else None

    def sinusoid(self, times, _noise, _others):
        f = float(np.exp(self.rng.uniform(np.log(5 / self.duration), np.log(0.47 * self.rate))))
        at, eighth = (int(x * 2 * self.n / self.rate) for x in (f, self.rate / 8))
        scale = np.sqrt(self.carrier.variance[at] / self.carrier.variance[eighth])
        a = times * self.carrier.line * float(scale)
        wave = np.sin(2 * np.pi * (f * self.t + self.rng.random()))
        return {"frequency": f, "amplitude": a}, a * wave

    def drifting_line(self, times, _noise, _others):
        lowest = max(0.5, 1 / (DRIFT * self.duration))  # below, it does not drift in this record
        f = float(np.exp(self.rng.uniform(np.log(lowest), np.log(0.4 * self.rate))))
        width = DRIFT * f
        pole = np.exp((-np.pi * width + 2j * np.pi * f) / self.rate)
        shape = ringing(self.rng, self.n, pole, 1.0)
        size = times * self._own(shape, 8.0)
        return {"frequency": f, "sigma": size}, size * shape

    def gauss_markov(self, times, _noise, _others):
        tc = float(np.exp(self.rng.uniform(np.log(0.3), np.log(self.duration / 15))))
        power = self._process(partial(lorentzian, tc=tc, rate=self.rate), 12.0 * times**2)
        if power is None:
            return None
        sigma = float(np.sqrt(power))
        path = forgetting(self.rng, self.n, np.exp(-1 / (tc * self.rate)), sigma)
        return {"sigma": sigma, "correlation_time": tc}, path

    def random_telegraph(self, times, _noise, _others):
        dwell = float(np.exp(self.rng.uniform(np.log(0.6), np.log(self.duration / 20))))
        density = partial(lorentzian, tc=dwell / 2, rate=self.rate)
        power = self._process(density, 12.0 * times**2)
        if power is None:
            return None
        a = float(np.sqrt(power))
        path = hopping(self.rng, self.n, 1 / (dwell * self.rate), a)
        return {"amplitude": a, "dwell": dwell}, path

    def narrowband(self, times, _noise, _others):
        f = float(np.exp(self.rng.uniform(np.log(60 / self.duration), np.log(0.4 * self.rate))))
        width = f * float(np.exp(self.rng.uniform(np.log(0.03), np.log(0.2))))
        w0, zeta = 2 * np.pi * f, width / (2 * f)

        def density(x: Array) -> Array:
            w = 2 * np.pi * x
            below = (w0**2 - w**2) ** 2 + (2 * zeta * w0 * w) ** 2
            return 2 * zeta * w0**3 / below * self.rate

        power = self._process(density, 14.0 * times**2)
        if power is None or width < COHERENCES / self.duration:
            return None
        sigma = float(np.sqrt(power))
        pole = np.exp((-zeta * w0 + 1j * w0 * np.sqrt(1 - zeta**2)) / self.rate)
        path = ringing(self.rng, self.n, pole, sigma)
        return {"frequency": f, "bandwidth": width, "sigma": sigma}, path

    def power_law(self, times, _noise, _others):
        exponent = float(self.rng.choice([0.5, 1.5]))
        size = self._process(lambda f: f**-exponent, 12.0 * times**2)
        if size is None:
            return None
        f = np.arange(1, self.n) * self.rate / (2 * self.n)
        ordinates = self.rng.normal(size=self.n - 1) * np.sqrt(size * f**-exponent)
        return {"exponent": exponent}, idct(np.concatenate([[0.0], ordinates]), norm="ortho")

    def step(self, times, _noise, _others):
        at = float(self.rng.uniform(0.1, 0.9)) * self.duration
        size = times * self.carrier.step * float(self.rng.choice([-1, 1]))
        return {"time": at, "size": size}, size * (self.t >= at)

    def relaxation(self, times, _noise, _others):
        if self.duration < LONG_S:
            return None
        at = float(self.rng.uniform(0.15, 0.6)) * self.duration
        tc = float(np.exp(self.rng.uniform(np.log(0.02), np.log(0.12)))) * self.duration
        shape = (self.t >= at) * np.exp(-np.maximum(self.t - at, 0.0) / tc)
        size = times * self._own(shape, 6.9) * float(self.rng.choice([-1, 1]))
        truth = {"time": at, "size": size, "time_constant": tc}
        return truth, size * (0.4 * (self.t >= at) + 0.6 * shape)

    def excursion(self, times, _noise, _others):
        ends = np.log([5.5, max(5.6, LONGEST_EXCURSION * self.duration)])
        length = float(np.exp(self.rng.uniform(*ends)))
        at = float(self.rng.uniform(0.1, 0.75)) * self.duration
        shape = ((self.t >= at) & (self.t < at + length)).astype(float)
        size = times * self._own(shape, 6.9)
        return {"time": at, "duration": length, "size": size}, size * shape

    def warm_up(self, times, _noise, _others):
        if self.duration < LONG_S:
            return None
        tc = float(np.exp(self.rng.uniform(np.log(0.05), np.log(0.2)))) * self.duration
        shape = np.exp(-self.t / tc)
        size = times * self._own(shape, 6.33) * float(self.rng.choice([-1, 1]))
        return {"time_constant": tc, "amplitude": size}, size * shape

    def cycle(self, times, _noise, _others):
        if self.duration < LONG_S:
            return None
        period = float(np.exp(self.rng.uniform(np.log(20.0), np.log(self.duration / 9))))
        count = int(2 * self.duration / period) + 4
        lengths = period * np.exp(0.12 * self.rng.standard_normal(count))
        begins, shape = repeating(self.rng, self.t, lengths)
        # Each instant costs some two nats.
        size = times * self._own(shape, float(np.sqrt(2 * (15 + 2 * self.duration / period))))
        inside = np.diff(begins[(begins > 0) & (begins < self.t[-1])])
        return {"period": float(inside.mean()), "sigma": size * float(np.std(shape))}, size * shape

    def shock(self, times, _noise, _others):
        at = float(self.rng.uniform(0.1, 0.85)) * self.duration
        after = np.maximum(self.t - at, 0.0)
        ring = 0.15 * self.rate
        shape = np.exp(-after / 0.4) * np.cos(2 * np.pi * ring * after) * (self.t >= at)
        size = 12.0 * self._sigma() * times
        return {"time": at, "peak": size}, size * shape

    def outliers(self, times, _noise, _others):
        count = int(self.rng.integers(2, 6))
        at = self.rng.choice(self.n - 20, count, replace=False) + 10
        sigma = float(np.std(self.carrier.clean - np.median(self.carrier.clean)))
        signal = np.zeros(self.n)
        signal[at] = 7.8 * sigma * times * self.rng.choice([-1, 1], count)
        return {"count": float(count)}, signal

    def variance_change(self, times, _noise, _others):
        length = float(np.exp(self.rng.uniform(np.log(0.1), np.log(0.3)))) * self.duration
        start = float(self.rng.uniform(0.05, 0.65)) * self.duration
        inside = (self.t >= start) & (self.t < start + length)
        change = times * 5.5 * np.sqrt(2 / np.count_nonzero(inside))
        signal = inside * self._like_the_noise() * np.sqrt(change)
        return {"start": start, "length": length, "ratio": float(np.sqrt(1 + change))}, signal

    def scale_drift(self, times, _noise, _others):
        slope = min(times * 5.5 * np.sqrt(6 / self.n), 1.8) * float(self.rng.choice([-1, 1]))
        u = np.arange(self.n) / self.n - 0.5
        return {"slope": slope}, slope * u * (self.carrier.clean - self.carrier.clean.mean())

    def temperature_effect(self, times, _noise, _others):
        if self.duration < LONG_S:
            return None
        slope = times * self._own(self.temperature, 5.5) * float(self.rng.choice([-1, 1]))
        return {"slope": slope}, slope * (self.temperature - self.temperature.mean())

    def temperature_lag(self, times, _noise, _others):
        return self._thermal(times, self._late(0.1 * self.duration))

    def temperature_curve(self, times, _noise, _others):
        room = self.temperature - self.temperature.mean()
        return self._thermal(times, room**2)

    def cross_coupling(self, times, _noise, others):
        source, x = next(iter(others.items()))
        slope = times * self._own(x, 5.5) * float(self.rng.choice([-1, 1]))
        return {"source": source, "slope": slope}, slope * (x - x.mean())

    def amplitude_coupling(self, times, _noise, others):
        """Let the source be shaken now and then, and the axis be louder while it is."""
        source, x = next(iter(others.items()))
        block = int(max(16, 0.5 * self.rate))
        if self.n // block < 64:
            return None
        envelope = np.repeat(np.exp(self.rng.normal(0, 0.8, self.n // block + 1)), block)[: self.n]
        motion = 3 * float(np.std(np.diff(x))) * envelope * self.rng.normal(size=self.n)
        spread = float(np.var(envelope**2) / np.mean(envelope**2) ** 2)
        share = times * 5.5 * 2 / np.sqrt(self.n * spread)
        power = np.sqrt(share) * envelope / np.sqrt(np.mean(envelope**2))
        louder = power * self._like_the_noise()
        return (
            {"source": source, "share": share / (1 + share)}, None,
            lambda _rng, own: np.column_stack([own + louder, x + motion]),
        )  # fmt: skip

    def band_limit(self, times, _noise, _others):
        cutoff = self.rate * float(np.exp(self.rng.uniform(np.log(0.08), np.log(0.6 / times**0.5))))
        keep = np.exp(-2 * np.pi * cutoff / self.rate)

        def passed(_rng: np.random.Generator, own: Array) -> Array:
            level = own.mean()
            return level + lfilter([1 - keep], [1, -keep], own - level)

        return {"cutoff": cutoff}, None, passed

    def repeated_samples(self, times, _noise, _others):
        """Repeat rows of the whole sensor, as a logger that is too fast does.

        At the limit there are so many that a count of equal rows tells them, by as many nats as
        5.5 deviations, from those that are equal by chance.
        """
        values = self.carrier.record.values
        codes = np.round(values / [lsb or 1e-12 for lsb in self.carrier.record.lsb])
        chance = np.mean([np.all(codes[k:] == codes[:-k], axis=1).mean() for k in range(1, 25)])
        usual = max(1.0, self.n * float(chance))
        least = next(
            k for k in range(1, self.n) if (usual + k) * np.log1p(k / usual) - k > 5.5**2 / 2
        )
        fraction = times * least / self.n
        repeats = self.rng.random(self.n) < fraction
        repeats[0] = False
        rows = np.maximum.accumulate(np.where(repeats, 0, np.arange(self.n)))
        return {"fraction": fraction}, None, lambda _rng, _own: values[rows]

    def saturation(self, times, _noise, _others):
        """Cut one end: at the limit what lies beyond it is five deviations of the last code.

        There are as many sizes as codes: the least is taken that is no smaller.
        """
        side = int(self.rng.choice([-1, 1]))
        lsb = self.carrier.record.lsb[0] or 1e-12
        codes, counts = np.unique(
            np.round(side * self.carrier.record.values[:, 0] / lsb), return_counts=True
        )
        beyond = self.n - np.cumsum(counts)
        seen = np.flatnonzero(beyond >= times * np.maximum(20.0, 5 * np.sqrt(counts)))
        if not len(seen) or beyond[seen[-1]] > self.n / 2:
            return None
        share, last = beyond[seen[-1]] / self.n, codes[seen[-1]] * lsb

        def cut(_rng: np.random.Generator, own: Array) -> Array:
            return side * np.minimum(side * own, last)

        return {"fraction": share}, None, cut

    def dead_zone(self, times, _noise, _others):
        """Replace what is near a value by it: at least three steps, and 40 samples."""
        own = self.carrier.record.values[:, 0]
        lsb = self.carrier.record.lsb[0]
        level = float(np.quantile(own, self.rng.uniform(0.3, 0.7)))
        level = round(level / lsb) * lsb if lsb else level
        apart = np.abs(own - level)
        width = max(3 * lsb, 2 * float(np.sort(apart)[40])) * times
        if width > self._sigma():
            return None
        return (
            {"level": level, "width": width}, None,
            lambda _rng, x: np.where(np.abs(x - level) < width / 2, level, x),
        )  # fmt: skip

    def _thermal(self, times: float, shape: Array) -> tuple[Truth, Array] | None:
        """Return a level that follows the room in some form, and could not follow it plainly."""
        if self.duration < LONG_S:
            return None
        weight = 1 / self.carrier.variance
        form, plain = (dct(x - x.mean(), norm="ortho")[1:] for x in (shape, self.temperature))
        rest = form - plain * np.sum(form * plain * weight) / np.sum(plain**2 * weight)
        size = times * 5.5 / float(np.sqrt(np.sum(rest**2 * weight)))
        return {"size": size}, size * (shape - shape.mean())

    def _late(self, lag: float) -> Array:
        keep = np.exp(-1 / (lag * self.rate))
        start = [keep * self.temperature[0]]
        return lfilter([1 - keep], [1, -keep], self.temperature, zi=start)[0]

    @staticmethod
    def room(rng: np.random.Generator, n: int, rate: float) -> Array:
        """Return the temperature of a room that a heater holds, as it is."""
        t = np.arange(n) / n
        waves = sum(
            rng.normal() / k * np.sin(2 * np.pi * (k * t + rng.random())) for k in range(1, 8)
        )
        return 25.0 + 1.5 * np.asarray(waves)

    def _sigma(self) -> float:
        return float(np.std(np.diff(self.carrier.clean))) / np.sqrt(2)

    def _like_the_noise(self) -> Array:
        """Return other noise of the spectrum of the axis."""
        ordinates = self.rng.normal(size=self.n - 1) * np.sqrt(self.carrier.variance)
        return idct(np.concatenate([[0.0], ordinates]), norm="ortho")

    def _own(self, shape: Array, sigmas: float) -> float:
        x = dct(shape - shape.mean(), norm="ortho")[1:]
        return sigmas / float(np.sqrt(np.sum(x**2 / self.carrier.variance)))

    def _process(self, density, nats: float) -> float | None:
        """Return the factor on a density that leaves so many nats to the likeliest N, B and K.

        None where no factor does: what is much louder than N may be nearly a K.
        """
        f = np.geomspace(self.rate / (2 * self.n), self.rate / 2, 400)
        count = np.gradient(f) * 2 * self.n / self.rate
        noise = np.interp(f, np.arange(1, self.n) * self.rate / (2 * self.n), self.carrier.variance)
        s = 2 * np.sin(np.pi * np.minimum(f, 0.499 * self.rate) / self.rate)
        walks = [noise[0] * (s[0] / s) ** power for power in (1, 2)]
        shape = density(f)
        shape = shape / float(np.max(shape / noise))

        def left(scale: float) -> float:
            truth = noise + scale * shape

            def divergence(log: Array) -> float:
                level, flicker, walk = np.exp(np.clip(log, -12, 24))
                r = truth / (level * noise + flicker * walks[0] + walk * walks[1])
                return float(np.sum(count * 0.5 * (r - 1 - np.log(r))))

            ends = (minimize(divergence, one, method="Nelder-Mead").fun for one in BEGINNINGS)
            return float(min(ends))

        most = max(np.geomspace(1e-3, 1e6, 19), key=left)
        if left(most) < nats:
            return None
        low, high = 1e-6, float(most)
        for _ in range(24):
            middle = np.sqrt(low * high)
            low, high = (middle, high) if left(middle) < nats else (low, middle)
        return float(np.sqrt(low * high) / np.max(density(f) / noise))
