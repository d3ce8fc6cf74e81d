"""Effects injected into measured noise: how many are found, and how much of what is found is true.

    python -m benchmarks injection [--trials 10] [--seed 1] [--only NAME] [--quick] [--json FILE]

The carriers are axes of `recordings/measured` without gaps on which the loop finds at most a few
effects, which are known then, and whose noise spans a few steps. Into each goes one effect of every
kind at 1, 2, 3, 5 and 10 times its limit of detection: of a line and of a step the limit that the
result prints for that axis, of the others the least size that an ideal detector finds in noise of
the N, B and K of the axis (`blind_effects.py`). Found is what has the right name at the right
place; of what is named beside it and was not there before, everything is false. Of kinds that one
spectrum cannot tell apart either counts.

In the null controls the noise of a carrier, whitened by its model, has the signs of its ordinates
drawn anew, or its blocks of a second permuted: the spectrum stays, and every line, step and
coupling goes. What is named there that was not named in the carrier is false.

Intervals are those of Wilson at 95 %.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from blind_effects import Maker, forgetting, hopping, ringing
from blind_noise import Array, Noise, lorentzian, spectral_scale
from figures import Figure, written
from independent_reading import samples_of
from scipy.fft import dct, idct

import allanscope
from allanscope.explain import AxisExplanation, Effect, explain
from allanscope.history import Record

FOLDER = Path(__file__).parents[1] / "recordings" / "measured"
TIMES = (1.0, 2.0, 3.0, 5.0, 10.0)
KINDS = (
    *("sinusoid", "drifting_line", "narrowband", "gauss_markov", "random_telegraph"),
    *("step", "excursion", "warm_up", "outliers", "shock", "variance_change"),
    *("cross_coupling", "band_limit", "repeated_samples"),
)
ALSO = {
    "drifting_line": {"narrowband"},
    "narrowband": {"drifting_line"},
    "random_telegraph": {"gauss_markov"},
    "gauss_markov": {"random_telegraph"},
    "outliers": {"shock"},
}
"""Names of the same spectrum, or of neighbouring outliers."""
MOST_ROWS, MOST_KNOWN = 30_000, 4
STEPS = 1.5
"""Least scatter of the differences in steps: what is put in has not passed the converter."""
LIMITS = re.compile(r"a line above ([\d.e+-]+) .*? step above ([\d.e+-]+) ")
QUICK = ("ism330dhcx-fan-off",)


@dataclass(frozen=True)
class Carrier:
    """An axis that effects are put into.

    Attributes
    ----------
    name : str
        Recording and axis.
    record : Record
        The axis, and the one that a coupling may come from.
    noise : Noise
        Its N, B, K and step, as the loop says.
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
    noise: Noise
    known: AxisExplanation
    line: float
    step: float
    variance: Array
    clean: Array

    @property
    def axis(self) -> str:
        """Its name."""
        return self.record.axes[0]

    def with_samples(self, values: Array) -> Record:
        """Return the record with other samples, on the same lattice."""
        lsb = self.noise.lsb
        values = np.round(values / lsb) * lsb if lsb else values
        return replace(self.record, values=np.column_stack([values, self.record.values[:, 1]]))


@dataclass
class Tally:
    """What was injected and found, by kind and times the limit."""

    asked: Counter[tuple[str, float]] = field(default_factory=Counter)
    right: Counter[tuple[str, float]] = field(default_factory=Counter)
    false: Counter[float] = field(default_factory=Counter)
    named: Counter[float] = field(default_factory=Counter)
    wrong: defaultdict[tuple[str, float], list[str]] = field(
        default_factory=lambda: defaultdict(list)
    )
    controls: int = 0
    control_false: list[str] = field(default_factory=list)


def carriers(paths: list[Path], axes: tuple[str, ...] = ()) -> Iterator[Carrier]:
    """Yield the axes on which little is found; of some axes only where they are named."""
    for path in paths:
        stated = samples_of(path).stated_hz
        analysis = allanscope.analyse(path, rate=stated)
        record = analysis.record
        if record is None or record.stride > 1 or len(record.segments) > 1:
            continue
        for axis in axes or record.axes:
            one = _carrier(record, axis, path.stem)
            if one is not None:
                yield one


def _carrier(record: Record, axis: str, stem: str) -> Carrier | None:
    column = record.axes.index(axis)
    other = (column + 1) % len(record.axes)
    n = min(len(record.values), MOST_ROWS)
    samples = record.values[:n, column]
    if np.std(np.diff(samples)) < STEPS * np.median(np.diff(np.unique(samples))):
        return None
    both = replace(
        record,
        axes=(axis, record.axes[other]),
        values=record.values[:n][:, [column, other]],
        lsb=(record.lsb[column], record.lsb[other]),
        temperature_c=record.temperature_c[:n],
        start_s=record.start_s[:n],
        segments=np.array([[0, n]], np.int64),
        filled=None,
    )
    whole = explain(both)
    found = whole.axes[axis]
    limits = [m for r in found.remarks if (m := LIMITS.search(r))]
    if found.hindrance or not limits or len(found.own_effects) > MOST_KNOWN:
        return None
    letters = {k: found.coefficients_after[k].value for k in "NBK"}
    model, rate = whole.models_after[axis], both.rate_hz
    clean = whole.cleaned[axis]
    n = len(clean)  # the search takes a length whose transform is quick
    both = replace(
        both,
        values=both.values[:n],
        temperature_c=both.temperature_c[:n],
        start_s=both.start_s[:n],
        segments=np.array([[0, n]], np.int64),
    )
    f = np.arange(1, len(clean)) * rate / (2 * len(clean))
    return Carrier(
        f"{stem} {axis}",
        both,
        Noise(letters["N"], letters["B"], letters["K"], both.lsb[0], 0.0),
        found,
        float(limits[0][1]),
        float(limits[0][2]),
        model.density(f) * rate / 2,
        clean,
    )


class Injector(Maker):
    """Puts one effect into a carrier; the kinds that the blind benchmark lacks, and the limits."""

    def __init__(self, rng: np.random.Generator, carrier: Carrier) -> None:
        n, rate = len(carrier.record.values), carrier.record.rate_hz
        super().__init__(rng, n, rate, np.zeros(n))
        self.carrier = carrier

    def inject(self, kind: str, times: float) -> tuple[dict[str, float | str], Array] | None:
        """Return what was put in and the samples with it; None where the carrier has no room."""
        before = self.carrier.record.values[:, 0]
        if kind == "repeated_samples":
            fraction = 2e-3 * times
            repeats = self.rng.random(self.n) < fraction
            repeats[0] = False
            rows = np.maximum.accumulate(np.where(repeats, 0, np.arange(self.n)))
            return {"fraction": fraction}, before[rows]
        if any(e.kind == kind for e in self.carrier.known.effects):
            return None
        if kind == "warm_up" and self.duration < 400:  # the noise holds as much in a minute
            return None
        others = {self.carrier.record.axes[1]: self.carrier.record.values[:, 1]}
        parameters, signal, *again = getattr(self, kind)(times, self.carrier.noise, others)
        return parameters, again[0](self.rng, before) if signal is None else before + signal

    def sinusoid(self, times, noise, _others):
        f = float(np.exp(self.rng.uniform(np.log(5 / self.duration), np.log(0.47 * self.rate))))
        at, eighth = (int(x * 2 * self.n / self.rate) for x in (f, self.rate / 8))
        scale = np.sqrt(self.carrier.variance[at] / self.carrier.variance[eighth])
        a = times * self.carrier.line * float(scale)
        wave = np.sin(2 * np.pi * (f * self.t + self.rng.random()))
        return {"frequency": f, "amplitude": a}, a * wave

    def drifting_line(self, times, noise, _others):
        f = float(np.exp(self.rng.uniform(np.log(0.5), np.log(0.4 * self.rate))))
        width = 0.004 * f
        pole = np.exp((-np.pi * width + 2j * np.pi * f) / self.rate)
        shape = ringing(self.rng, self.n, pole, 1.0)
        x = dct(shape - shape.mean(), norm="ortho")[1:]
        size = times * 8.0 / np.sqrt(float(np.sum(x**2 / self.carrier.variance)))
        return {"frequency": f, "sigma": size}, size * shape

    def gauss_markov(self, times, noise, _others):
        tc = float(np.exp(self.rng.uniform(np.log(0.3), np.log(self.duration / 15))))
        density = partial(lorentzian, tc=tc, rate=self.rate)
        sigma = times * np.sqrt(spectral_scale(density, noise, self.n, self.rate, 12.0))
        path = forgetting(self.rng, self.n, np.exp(-1 / (tc * self.rate)), sigma)
        return {"sigma": sigma, "correlation_time": tc}, path

    def random_telegraph(self, times, noise, _others):
        dwell = float(np.exp(self.rng.uniform(np.log(0.6), np.log(self.duration / 20))))
        density = partial(lorentzian, tc=dwell / 2, rate=self.rate)
        a = times * np.sqrt(spectral_scale(density, noise, self.n, self.rate, 12.0))
        return {"amplitude": a, "dwell": dwell}, hopping(
            self.rng, self.n, 1 / (dwell * self.rate), a
        )

    def narrowband(self, times, noise, _others):
        f = float(np.exp(self.rng.uniform(np.log(60 / self.duration), np.log(0.4 * self.rate))))
        width = f * float(np.exp(self.rng.uniform(np.log(0.03), np.log(0.2))))
        w0, zeta = 2 * np.pi * f, width / (2 * f)

        def density(x: Array) -> Array:
            w = 2 * np.pi * x
            below = (w0**2 - w**2) ** 2 + (2 * zeta * w0 * w) ** 2
            return 2 * zeta * w0**3 / below * self.rate

        sigma = times * np.sqrt(spectral_scale(density, noise, self.n, self.rate, 14.0))
        pole = np.exp((-zeta * w0 + 1j * w0 * np.sqrt(1 - zeta**2)) / self.rate)
        path = ringing(self.rng, self.n, pole, sigma)
        return {"frequency": f, "bandwidth": width, "sigma": sigma}, path

    def step(self, times, noise, _others):
        at = float(self.rng.uniform(0.08, 0.92)) * self.duration
        size = times * self.carrier.step * float(self.rng.choice([-1, 1]))
        return {"time": at, "size": size}, size * (self.t >= at)

    def excursion(self, times, noise, _others):
        length = self.rng.uniform(*np.log([5.5, max(6.5, 0.2 * self.duration)]))
        length = float(np.exp(length))
        at = float(self.rng.uniform(0.05, 0.75)) * self.duration
        shape = ((self.t >= at) & (self.t < at + length)).astype(float)
        size = times * self._own(shape, 6.9)
        return {"time": at, "duration": length, "size": size}, size * shape

    def shock(self, times, noise, _others):
        at = float(self.rng.uniform(0.1, 0.85)) * self.duration
        after = np.maximum(self.t - at, 0.0)
        ring = 0.15 * self.rate
        shape = np.exp(-after / 0.4) * np.cos(2 * np.pi * ring * after) * (self.t >= at)
        sigma = float(np.std(np.diff(self.carrier.clean))) / np.sqrt(2)
        size = 12.0 * sigma * times
        return {"time": at, "peak": size}, size * shape

    def outliers(self, times, noise, _others):
        count = int(self.rng.integers(2, 6))
        at = self.rng.choice(self.n - 20, count, replace=False) + 10
        sigma = float(np.std(self.carrier.clean - np.median(self.carrier.clean)))
        signal = np.zeros(self.n)
        signal[at] = 7.8 * sigma * times * self.rng.choice([-1, 1], count)
        return {"count": float(count)}, signal

    def variance_change(self, times, noise, _others):
        length = float(np.exp(self.rng.uniform(np.log(0.1), np.log(0.3)))) * self.duration
        start = float(self.rng.uniform(0.05, 0.65)) * self.duration
        inside = (self.t >= start) & (self.t < start + length)
        change = times * 5.5 * np.sqrt(2 / np.count_nonzero(inside))
        sigma = float(np.std(np.diff(self.carrier.clean))) / np.sqrt(2)
        ratio = float(np.sqrt(1 + change))
        signal = inside * self.rng.normal(0, sigma * np.sqrt(change), self.n)
        return {"start": start, "length": length, "ratio": ratio}, signal

    def cross_coupling(self, times, noise, others):
        source, x = next(iter(others.items()))
        x = x - x.mean()
        slope = times * self._own(x, 5.5) * float(self.rng.choice([-1, 1]))
        return {"source": source, "slope": slope}, slope * x

    def _own(self, shape: Array, sigmas: float) -> float:
        x = dct(shape - shape.mean(), norm="ortho")[1:]
        return sigmas / float(np.sqrt(np.sum(x**2 / self.carrier.variance)))


def is_right(kind: str, truth: dict[str, float | str], effect: Effect, carrier: Carrier) -> bool:
    """Tell whether an effect is what was injected, at its place."""
    kinds = {effect.kind, *effect.equivalent}
    if not kinds & {kind, *ALSO.get(kind, ())}:
        return False
    for name, room in (("frequency", 0.05), ("time", 0.0)):
        if name in truth and name in effect.parameters:
            value, at = effect.parameters[name].value, truth[name]
            unit = 2.0 / carrier.record.start_s[-1] if name == "frequency" else 5.0
            if abs(float(value) - float(at)) > max(room * float(at), unit):
                return False
    return "source" not in truth or effect.parameters["source"].value == truth["source"]


def was_there(effect: Effect, known: AxisExplanation) -> bool:
    """Tell whether an effect was found before the injection as well."""
    for one in known.effects:
        if one.kind != effect.kind:
            continue
        where = one.located_by
        if not where or where not in effect.parameters:
            return True
        a, b = one.parameters[where].value, effect.parameters[where].value
        if isinstance(a, str) or isinstance(b, str):
            return a == b
        if abs(a - b) <= max(0.05 * abs(a), 2.0 if where == "time" else 0.0):
            return True
    return False


def named(found: AxisExplanation) -> list[Effect]:
    """Return the effects that have a name."""
    return [e for e in found.own_effects if e.kind != "unexplained"]


def trial(carrier: Carrier, kind: str, times: float, seed: list[int], tally: Tally) -> None:
    """Inject one effect and enter what the loop says."""
    put = Injector(np.random.default_rng(seed), carrier).inject(kind, times)
    if put is None:
        return
    truth, values = put
    found = explain(carrier.with_samples(values)).axes[carrier.axis]
    effects = named(found)
    right = [e for e in effects if is_right(kind, truth, e, carrier)]
    new = [e for e in effects if e not in right and not was_there(e, carrier.known)]
    tally.asked[kind, times] += 1
    tally.right[kind, times] += bool(right)
    tally.named[times] += bool(right) + len(new)
    tally.false[times] += len(new)
    if new or not right:
        said = ", ".join(e.kind for e in found.own_effects if not was_there(e, carrier.known))
        tally.wrong[kind, times].append(f"{carrier.name}: {said or 'nothing'}")


def control(carrier: Carrier, blocks: bool, seed: list[int], tally: Tally) -> None:
    """Scramble the noise of a carrier and enter what is named in it."""
    rng = np.random.default_rng(seed)
    root = np.sqrt(carrier.variance)
    white = dct(carrier.clean - carrier.clean.mean(), norm="ortho")[1:] / root
    if blocks:
        series = idct(np.concatenate([[0.0], white]), norm="ortho")
        size = max(16, int(carrier.record.rate_hz))
        pieces = np.array_split(series, max(2, len(series) // size))
        series = np.concatenate([pieces[i] for i in rng.permutation(len(pieces))])
        white = dct(series - series.mean(), norm="ortho")[1:]
    else:
        white = white * rng.choice([-1.0, 1.0], len(white))
    values = idct(np.concatenate([[0.0], white * root]), norm="ortho") + carrier.clean.mean()
    found = explain(carrier.with_samples(values)).axes[carrier.axis]
    tally.controls += 1
    for effect in named(found):
        if not was_there(effect, carrier.known):
            how = "blocks" if blocks else "signs"
            tally.control_false.append(f"{carrier.name} ({how}): {effect.kind}")


def interval(right: int, asked: int) -> tuple[float, float]:
    """Return Wilson's interval in per cent.

    >>> [round(x, 1) for x in interval(90, 100)]
    [82.6, 94.5]
    """
    if not asked:
        return 0.0, 100.0
    z, p = 1.96, right / asked
    middle = (p + z**2 / (2 * asked)) / (1 + z**2 / asked)
    half = z * np.sqrt(p * (1 - p) / asked + z**2 / (4 * asked**2)) / (1 + z**2 / asked)
    return 100 * (middle - half), 100 * (middle + half)


def measure(found: list[Carrier], trials: int, seed: int, times: tuple[float, ...]) -> Tally:
    """Run so many rounds over all kinds; the carriers take turns."""
    tally = Tally()
    for index in range(trials):
        for k, kind in enumerate(KINDS):
            for j, size in enumerate(times):
                carrier = found[(index * len(KINDS) + k + j) % len(found)]
                trial(carrier, kind, size, [seed, index, k, j], tally)
        for blocks in (False, True):
            for c, carrier in enumerate(found[index % 2 :: 2]):
                control(carrier, blocks, [seed, index, 99 + c, blocks], tally)
        if index + 1 < trials:
            print(f"after {index + 1} of {trials} rounds\n{table(tally, times)}", flush=True)
    return tally


def table(tally: Tally, times: tuple[float, ...]) -> str:
    """Return completeness by kind and size, and reliability."""
    lines = ["| kind | " + " | ".join(f"{t:g} x" for t in times) + " |"]
    lines.append("|---|" + "---|" * len(times))
    for kind in KINDS:
        cells = [
            f"{tally.right[kind, t]} of {tally.asked[kind, t]}" if tally.asked[kind, t] else "-"
            for t in times
        ]
        lines.append(f"| `{kind}` | " + " | ".join(cells) + " |")
    for what, good, of in (
        ("found, %", *_sums(tally, times)),
        ("true of what is named, %",
         {t: tally.named[t] - tally.false[t] for t in times}, tally.named),
    ):  # fmt: skip
        cells = []
        for t in times:
            low, high = interval(good[t], of[t])
            value = 100 * good[t] / max(of[t], 1)
            cells.append(f"{value:.0f} [{low:.0f}, {high:.0f}]")
        lines.append(f"| **{what}** | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _sums(tally: Tally, times: tuple[float, ...]) -> tuple[dict[float, int], dict[float, int]]:
    right = {t: sum(tally.right[k, t] for k in KINDS) for t in times}
    return right, {t: sum(tally.asked[k, t] for k in KINDS) for t in times}


def figures_of(tally: Tally, times: tuple[float, ...]) -> list[Figure]:
    """Return what the benchmarks' common table shows."""
    right, asked = _sums(tally, times)
    whole = sum(tally.named.values())
    true = 100 * (1 - sum(tally.false.values()) / max(whole, 1))
    figures = [Figure("true of all that is named", true, "%", 98.0, more=True)]
    for t in times:
        goal = 90.0 if t == 3.0 else None
        share = 100 * right[t] / max(asked[t], 1)
        figures.append(Figure(f"found at {t:g} x the limit", share, "%", goal, more=True))
    figures.append(Figure("named in null controls", len(tally.control_false), "effects"))
    figures.append(Figure("null controls", tally.controls, "axes"))
    return figures


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", metavar="NAME", help="recordings whose name contains this")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    paths = [p for p in sorted(FOLDER.glob("*.parquet")) if (options.only or "") in p.stem]
    if options.quick:
        paths = [p for p in paths if p.stem in QUICK]
    found = list(carriers(paths))
    if not found:
        parser.error("no axis on which little is found")
    times = (3.0, 10.0) if options.quick else TIMES
    print(f"{len(found)} carriers: {', '.join(one.name for one in found)}", flush=True)
    tally = measure(found, 1 if options.quick else options.trials, options.seed, times)
    print(table(tally, times))
    for (kind, size), said in sorted(tally.wrong.items()):
        print(f"{kind} at {size:g} x: {'; '.join(said)}")
    print(f"null controls: {tally.controls}; {'; '.join(tally.control_false) or 'nothing named'}")
    figures = figures_of(tally, times)
    written(figures, options.json)


if __name__ == "__main__":
    main()
