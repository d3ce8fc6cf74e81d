"""Whether intervals are right as a whole: ranks of the truth within what a fit says of it.

    python benchmarks/rank_calibration.py [--draws 2000] [--searches 500] [--seed 1] [--quick]
                                          [--only NAME ...] [--json FILE]
    python benchmarks/rank_calibration.py --stored FILE ... [--figure FILE]

Simulation-based calibration. Truths are drawn from a prior, records from the truths; the rank is
the confidence that the fit places below the truth. Where every interval of every level is right,
ranks are uniform: their empirical distribution stays within the simultaneous 95 % band of
Saeilynoja, Buerkner and Vehtari (arXiv 2103.10522). One that leaves it above the diagonal at the
left says that truths lie too often below what was fitted; an S, that intervals are too narrow.

Coefficients are fitted to records of 20 min and of a night; ranks are those of the signed root of
the profile of the likelihood. Effects go through the whole search of four minutes, with sizes from
half the limit to four times it: ranks of the size of a signal are those given that it was detected
(`allanscope.explain.given_detection`), as are those of B, K, Q and R.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from blind_effects import forgetting
from blind_noise import base_noise, draw_noise, information, lorentzian, spectral_scale
from efficiency import RATE, Array, simulate
from figures import Figure, written
from scipy.stats import binom, norm

from allanscope.explain import explain
from allanscope.explain.effect import Effect, Parameter
from allanscope.explain.given_detection import conditional_rank
from allanscope.history import History, Record
from allanscope.noise import NoiseFit, fit_noise
from allanscope.noise.selection import Q_PENALTY

QUANTILE = 1.959963984540054
DETECTED, RAMP = 9.55, 2 * np.log(1e3)
"""Twice the nats at which a coefficient, and a ramp, count as detected."""
NORMAL = 0.03
"""Relative standard deviation below which the fit takes a profile for normal."""
LIMIT = 4.5
"""About the size in standard errors at which half of the effects are found."""

RATES = {"20 min": (104.0, 1200.0), "12 h": (13.0, 43200.0)}
SEARCHED = (52.0, 240.0)
Draw = Callable[[np.random.Generator], dict[str, float]]
"""From a generator to the ranks of what was detected."""


def coefficients(rate: float, duration: float) -> Draw:
    """Return what draws N, B and K, and finds their ranks in a fit."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        n = int(rate * duration)
        truth = {"N": 4e-3, "B": 1.2e-3 * spread(rng, 3.0), "K": 1e-4 * spread(rng, 3.0)}
        scale = np.sqrt(rate / RATE)  # that of `simulate`
        fit = fitted(simulate(n, rng, scaled(truth, scale)), rate)
        found = {name: rank_of_coefficient(fit, name, truth[name]) for name in "NBK"}
        return {name: rank for name, rank in found.items() if rank is not None}

    return draw


def scaled(truth: dict[str, float], scale: float) -> dict[str, float]:
    """Return the coefficients that `simulate` makes the same noise of at another rate."""
    return {"N": truth["N"] * scale, "B": truth["B"], "K": truth["K"] / scale}


def quantization(rng: np.random.Generator) -> dict[str, float]:
    """Draw Q, the size of white angle noise, beside N."""
    rate, duration = RATES["20 min"]
    n, q = int(rate * duration), 6e-5 * spread(rng, 3.0)
    angles = rng.standard_normal(n + 1)
    samples = 4e-3 * np.sqrt(rate) * rng.standard_normal(n) + q * rate * np.diff(angles)
    rank = rank_of_coefficient(fitted(samples, rate), "Q", q)
    return {} if rank is None else {"Q": rank}


def ramp(rng: np.random.Generator) -> dict[str, float]:
    """Draw R, beside N, B and K."""
    rate, duration = RATES["20 min"]
    n = int(rate * duration)
    truth = {"N": 4e-3, "B": 1.2e-3, "K": 1e-5}
    slope = 1e-5 * spread(rng, 4.0)
    found = fitted(simulate(n, rng, truth) + slope * np.arange(n) / rate, rate).coefficients["R"]
    if not found.detected:
        return {}
    error = (found.upper - found.lower) / (2 * QUANTILE)
    return {"R": conditional_rank(slope / error, found.value / error, np.sqrt(RAMP))}


def effect(kind: str) -> Draw:
    """Return what hides one effect in four minutes, and finds the ranks of its numbers."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        rate, duration = SEARCHED
        n = int(rate * duration)
        noise = draw_noise(rng, "gx")
        d = LIMIT * float(np.exp(rng.uniform(np.log(0.5), np.log(4.0))))
        shape, truth = shape_of(kind, rng, n, rate)
        if kind == "gauss_markov":
            tc = truth["correlation_time"]
            scale = spectral_scale(lambda f: lorentzian(f, tc, rate), noise, n, rate, d**2 / 2)
            size, name = np.sqrt(scale), "sigma"
        else:
            size = d / np.sqrt(information(shape, noise, rate))
            name = "amplitude" if kind == "sinusoid" else "size"
        truth[name] = float(size)
        rows = base_noise(rng, noise, n, rate) + size * shape + noise.offset
        found = nearest(kind, explain(record_of(rows, rate, noise.lsb)).axes["gx"].effects, truth)
        if found is None:
            return {}
        ranks = {k: rank_of_parameter(found.parameters[k], v) for k, v in truth.items()}
        if kind != "gauss_markov":
            ranks[name] = rank_of_size(found, name, truth[name])
        return {f"{kind} {k.replace('_', ' ')}": rank for k, rank in ranks.items()}

    return draw


def shape_of(
    kind: str, rng: np.random.Generator, n: int, rate: float
) -> tuple[Array, dict[str, float]]:
    """Return an effect of unit size, and where it is."""
    t = np.arange(n) / rate
    if kind == "step":
        time_s = rng.uniform(0.1, 0.9) * n / rate
        return (t >= time_s).astype(float), {"time": time_s}
    if kind == "excursion":
        time_s = rng.uniform(0.1, 0.7) * n / rate
        length = np.exp(rng.uniform(np.log(2.0), np.log(20.0)))
        inside = (t >= time_s) & (t < time_s + length)
        return inside.astype(float), {"time": time_s, "duration": float(length)}
    if kind == "sinusoid":
        frequency = rng.uniform(0.5, 24.0)
        wave = np.sin(2 * np.pi * (frequency * t + rng.uniform()))
        return wave, {"frequency": frequency}
    tc = float(np.exp(rng.uniform(np.log(0.3), np.log(5.0))))
    series = forgetting(rng, n, float(np.exp(-1 / (rate * tc))), 1.0)
    return series, {"correlation_time": tc}


def nearest(kind: str, found: tuple[Effect, ...], truth: dict[str, float]) -> Effect | None:
    """Return the effect of a kind that was meant; None where it was not found."""
    place, reach = {"sinusoid": ("frequency", 0.05)}.get(kind, ("time", 5.0))
    for one in found:
        if one.kind == kind and (
            kind == "gauss_markov" or abs(float(one.parameters[place].value) - truth[place]) < reach
        ):
            return one
    return None


def rank_of_coefficient(fit: NoiseFit, name: str, truth: float) -> float | None:
    """Return the confidence below the truth, given that it was detected; None where it was not."""
    found, inner = fit.coefficients[name], fit.fit
    index = inner.index(name)
    if index is None or not found.detected:
        return None
    spread_of = float(inner.all_free().relative_sd()[inner.model.numbers.index(inner.free[index])])
    if spread_of < NORMAL:
        return float(norm.cdf(np.log(truth / found.value) / spread_of))
    free = inner.free[index]

    def lost(value: float) -> float:
        model = inner.model.with_numbers([free], [value])
        held = inner.likelihood.maximise(model, held=inner.held | {free})
        return max(2 * (inner.loglik - held.loglik), 0.0)

    relative = min(float(inner.relative_sd()[index]), 1.0)
    root = np.sqrt(lost(truth) / (1 + 2 / 3 * relative**2))
    away = np.sign(truth - float(inner.values[index])) * root
    if name == "N":
        return float(norm.cdf(away))
    limit = 2 * Q_PENALTY if name == "Q" else DETECTED
    observed = np.sqrt(max(lost(0.0), limit))
    return conditional_rank(observed + away, observed, np.sqrt(limit))


def rank_of_parameter(found: Parameter, truth: float) -> float:
    """Return the confidence below the truth, each side of the interval taken for half a normal."""
    value, lower, upper = (float(x) for x in (found.value, found.lower or 0.0, found.upper or 0.0))
    if lower > 0 and abs(np.sqrt(lower * upper) / value - 1) < 1e-6:  # of a logarithm
        value, lower, upper, truth = (float(np.log(x)) for x in (value, lower, upper, truth))
    width = upper - value if truth > value else value - lower
    return float(norm.cdf(QUANTILE * (truth - value) / max(width, 1e-300)))


def rank_of_size(found: Effect, name: str, truth: float) -> float:
    """Return that of the size of a signal, given that it was detected."""
    one = found.parameters[name]
    error = abs(float(one.upper or 0.0) - float(one.lower or 0.0)) / (2 * QUANTILE)
    observed = abs(float(one.value)) / error
    limit = min(np.sqrt(2 * float(found.evidence["price_nats"])), observed)
    return conditional_rank(abs(truth) / error, observed, limit)


def fitted(samples: Array, rate: float) -> NoiseFit:
    """Do what a run does without a spectrum of its own: the history, the fit."""
    history = History(1)
    history.update(samples)
    return fit_noise(history.record(rate, ("gx",), (1.0,)), "gx")


def record_of(rows: Array, rate: float, lsb: float) -> Record:
    """Return one axis as it is searched."""
    n = len(rows)
    return Record(
        rate_hz=rate,
        stride=1,
        axes=("gx",),
        values=np.round(rows / lsb)[:, np.newaxis] * lsb,
        lsb=(lsb,),
        temperature_c=np.full(n, np.nan),
        start_s=np.arange(n) / rate,
        segments=np.array([[0, n]], np.int64),
    )


def spread(rng: np.random.Generator, factor: float) -> float:
    """Draw a factor, evenly in its logarithm."""
    return float(factor ** rng.uniform(-1, 1))


def band(count: int, points: Array, level: float = 0.95, runs: int = 4000) -> tuple[Array, Array]:
    """Return the simultaneous band of an empirical distribution of uniform ranks.

    Pointwise binomial limits at a level that is found by simulation, so that all hold at once.
    """
    rng = np.random.default_rng(20260101)
    least = np.empty(runs)
    for run in range(runs):
        counts = np.searchsorted(np.sort(rng.random(count)), points, side="right")
        tail = np.minimum(binom.cdf(counts, count, points), binom.sf(counts - 1, count, points))
        least[run] = 2 * tail.min()
    gamma = float(np.quantile(least, 1 - level))
    low = binom.ppf(gamma / 2, count, points) / count
    high = binom.ppf(1 - gamma / 2, count, points) / count
    return low, high


def outside(ranks: Array, points: Array) -> float:
    """Return how far the distribution of ranks goes towards its band; beyond 1, outside."""
    low, high = band(len(ranks), points)
    away = np.searchsorted(np.sort(ranks), points, side="right") / len(ranks) - points
    room = np.maximum(np.where(away > 0, high - points, points - low), 1e-9)
    return float(np.max(np.abs(away) / room))


def picture(ranks: dict[str, Array], points: Array, path: Path) -> None:
    """Draw the distributions of ranks less the uniform one, with their bands."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    columns = 4
    rows = -(-len(ranks) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(10, 2.1 * rows), sharex=True, layout="constrained", squeeze=False
    )
    for panel in axes.flat[len(ranks) :]:
        panel.set_axis_off()
    for panel, (name, values) in zip(axes.flat, ranks.items(), strict=False):
        low, high = band(len(values), points)
        share = np.searchsorted(np.sort(values), points, side="right") / len(values)
        panel.fill_between(points, low - points, high - points, color="0.85", lw=0)
        panel.axhline(0.0, color="0.6", lw=0.8)
        panel.plot(points, share - points, color="C0", lw=1.4)
        panel.set_title(f"{name.replace('_', ' ')} ({len(values)})", fontsize=9)
        panel.tick_params(labelsize=7)
    figure.supxlabel("rank of the truth", fontsize=9)
    figure.supylabel("distribution of ranks less the uniform one", fontsize=9)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=2000, help="fits of each length")
    parser.add_argument("--searches", type=int, default=500, help="records of each kind of effect")
    parser.add_argument("--only", nargs="+", help="names of studies")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--stored", type=Path, nargs="+", help="show what --json has written")
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    draws, searches = (60, 10) if options.quick else (options.draws, options.searches)
    studies: dict[str, tuple[int, Draw]] = {
        **{name: (draws, coefficients(*RATES[name])) for name in RATES},
        "Q": (draws, quantization),
        "R": (draws, ramp),
        **{
            kind: (searches, effect(kind))
            for kind in ("step", "excursion", "sinusoid", "gauss_markov")
        },
    }
    points = np.linspace(0.01, 0.99, 99)
    ranks: dict[str, list[float]] = {}
    started = time.process_time()
    for number, (name, (count, draw)) in enumerate(studies.items()):
        if options.stored or (options.only and name not in options.only):
            continue
        rng = np.random.default_rng([options.seed, number])
        for _ in range(count):
            for what, rank in draw(rng).items():
                title = f"{what}, {name}" if name in RATES else what
                ranks.setdefault(title, []).append(rank)
    for path in options.stored or []:
        ranks |= json.loads(path.read_text(encoding="utf-8"))["ranks"]
    arrays = {name: np.array(values) for name, values in ranks.items()}
    figures = [
        Figure(f"ranks of {name} ({len(values)} detected)", outside(values, points), "of the band",
               goal=1.0)
        for name, values in arrays.items()
    ]  # fmt: skip
    if options.figure:
        picture(arrays, points, options.figure)
    written(
        figures, options.json, ranks={name: values.tolist() for name, values in arrays.items()},
        cpu_seconds=time.process_time() - started,
    )  # fmt: skip


if __name__ == "__main__":
    main()
