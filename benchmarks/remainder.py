"""How well the nameless remainder of the model describes what no name fits.

    python -m benchmarks remainder [--records N] [--json FILE] [--quick] [--no-measured]

Simulated records have N, B, K and a broad bump or dip of the density without a name; the noise is
fitted with nothing named. The first seven eighths of a record are fitted, and the last one is
whitened by what was found: its ordinates must be standard normal by Anderson and Darling's test at
5 % (nothing fitted, so its limit is 2.492). On a fresh record of the same length the held-out
log-likelihood gained over N, B and K alone is compared with that of an oracle that knows the
density. Measured recordings (`recordings/measured`) are searched whole; what is deterministic is
taken out, and the noise is fitted again beside the processes that were named.

Data are held out in two ways. Every eighth pair of ordinates, fitted to the others, asks whether
the density is right: a noise that grows louder in time has one all the same. (Pairs, because a tone
lies in the even ordinates or in the odd ones by its phase.) The last eighth of the record, fitted
to what came before, asks beside that whether the noise is stationary.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from figures import Figure
from independent_reading import samples_of
from numpy.typing import NDArray
from scipy.fft import dct, irfft, rfft, rfftfreq
from scipy.special import log_ndtr

from allanscope.explain import explain
from allanscope.explain.spectrum import Spectrum
from allanscope.history import Record
from allanscope.noise import NoiseFit, fit_noise
from allanscope.noise.evidence import Ordinates
from allanscope.noise.fit import Known
from allanscope.noise.grid import grid_of
from allanscope.noise.likelihood import Likelihood
from allanscope.noise.part import Part
from allanscope.noise.remainder import with_remainder
from allanscope.noise.selection import textbook

Array = NDArray[np.float64]

FOLDER = Path(__file__).parents[1] / "recordings" / "measured"
RATE, ROWS = 100.0, 120_000
TRAINED = 7 / 8
FOLDS = 8
LIMIT = 2.492
"""Of Anderson and Darling's statistic at 5 %, nothing being fitted."""


def anderson_darling(z: Array) -> float:
    """Return the statistic of values that should be standard normal.

    >>> bool(anderson_darling(np.random.default_rng(1).normal(size=10_000)) < LIMIT)
    True
    """
    n, ordered = len(z), np.sort(z)
    weight = (2 * np.arange(n) + 1) / n
    return float(-n - np.sum(weight * (log_ndtr(ordered) + log_ndtr(-ordered[::-1]))))


def drawn(rng: np.random.Generator) -> Callable[[Array], Array]:
    """Return a density (two-sided): N, B, K, times a bump or a dip that has no name."""
    n, b, k = 4e-3, 4e-3 * 10 ** rng.uniform(-1.5, 0), 4e-3 * 10 ** rng.uniform(-3, -1)
    centre, width = np.exp(rng.uniform(np.log(0.5), np.log(35.0))), rng.uniform(0.25, 1.2)
    height = rng.choice([-1, 1]) * rng.uniform(0.1, 0.8)
    steepness = rng.choice([2, 4, 8])

    def density(f: Array) -> Array:
        sine = 2 * np.sin(np.pi * f / RATE) * RATE
        textbook = n**2 + b**2 / sine + (k / sine) ** 2
        away = np.abs(np.log2(f / centre)) / width
        return np.asarray(textbook * np.exp(height * np.exp(-(away**steepness))))

    return density


def noise(rng: np.random.Generator, density: Callable[[Array], Array]) -> Array:
    """Draw a record, a piece of one that is eight times as long."""
    size = 8 * ROWS
    f = rfftfreq(size, 1 / RATE)
    f[0] = f[1]
    return np.asarray(irfft(rfft(rng.normal(size=size)) * np.sqrt(density(f) * RATE), size)[:ROWS])


def record_of(values: Array, rate: float, axis: str = "gx", lsb: float = 0.0) -> Record:
    """Return samples as a record of one axis, without lsb on no lattice."""
    n = len(values)
    return Record(
        rate_hz=rate, stride=1, axes=(axis,), values=values[:, np.newaxis], lsb=(lsb,),
        temperature_c=np.full(n, np.nan), start_s=np.arange(n) / rate,
        segments=np.array([[0, n]], np.int64),
    )  # fmt: skip


def ordinates(values: Array) -> Array:
    """Return the DCT-II ordinates without the mean."""
    return np.asarray(dct(values - values.mean(), norm="ortho")[1:])


def variances(fit: NoiseFit, n: int, rate: float) -> Array:
    """Return the variance of each ordinate of n rows under the model of a fit."""
    return Spectrum(grid_of(n, rate), fit.fit).ordinates


def loglik(d: Array, variance: Array) -> float:
    """Return the log-likelihood of ordinates."""
    return float(-0.5 * np.sum(np.log(variance) + d**2 / variance))


def fitted(values: Array, rate: float, known: Known) -> tuple[NoiseFit, float]:
    """Fit the noise; return the processor time as well."""
    record = record_of(values, rate)
    began = time.process_time()
    fit = fit_noise(record, "gx", known=known)
    return fit, time.process_time() - began


@dataclass(frozen=True, eq=False)
class Fold(Ordinates):
    """Ordinates of which every eighth pair is held out."""

    held: int = -1

    @property
    def is_held(self) -> NDArray[np.bool_]:
        """Which are held out."""
        return np.arange(self.grid.n - 1) // 2 % FOLDS == self.held

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Which are fitted."""
        return self.grid.kept(self.excluded) & ~self.is_held

    def binned(self) -> Fold:
        """Return the same with the powers computed anew."""
        kept = self.kept
        count = np.add.reduceat(kept.astype(np.float64), self.grid.edges)
        total = np.add.reduceat(self.raw[0] ** 2 * kept, self.grid.edges)
        return replace(self, power=total / np.maximum(count, 1.0), dof=count)


def scores(values: Array, rate: float, known: Known, folds: int = FOLDS) -> list[float]:
    """Return the statistic of held-out ordinates, each time fitted to the others."""
    whole, found = Fold.of(values, 1 / rate), []
    model = textbook(1 / rate, None).plus(*known.parts)
    for held in range(folds):
        part = replace(whole, held=held).binned()
        fit = Likelihood([part.without(known.doubtful)]).amplitudes(model)
        fit = with_remainder(fit, [part])
        z = part.raw[0] / np.sqrt(Spectrum(part.grid, fit).ordinates)
        found.append(anderson_darling(z[part.is_held]))
    return found


def simulated(records: int) -> Iterator[tuple[float, float, float, float, float]]:
    """Yield both statistics, nats gained, nats the oracle gains, and seconds, of each record."""
    for seed in range(records):
        rng = np.random.default_rng([seed, 18])
        density = drawn(rng)
        values, fresh = noise(rng, density), noise(rng, density)
        cut = int(TRAINED * ROWS)
        fit, _ = fitted(values[:cut], RATE, Known())
        d = ordinates(values[cut:])
        score = anderson_darling(d / np.sqrt(variances(fit, len(d) + 1, RATE)))
        fit, seconds = fitted(values, RATE, Known())
        bare, _ = fitted(values, RATE, Known(is_textbook=True))
        d = ordinates(fresh)[8:]  # the ends of the record count below
        f = (np.arange(len(d)) + 9) * RATE / (2 * ROWS)
        found, without, truth = (
            loglik(d, variance)
            for variance in (
                variances(fit, ROWS, RATE)[8:],
                variances(bare, ROWS, RATE)[8:],
                density(f) * RATE,
            )
        )
        (fold,) = scores(values, RATE, Known(), folds=1)
        yield score, fold, found - without, truth - without, seconds


def measured() -> Iterator[tuple[str, float, list[float], float]]:
    """Yield the name, both statistics and the seconds of the fit of each measured axis."""
    for path in sorted(FOLDER.glob("*.parquet")):
        samples = samples_of(path)
        for axis, x in samples.axes.items():
            finite = x[np.isfinite(x)]
            explanation = explain(record_of(finite, samples.rate_hz, axis))
            if axis not in explanation.cleaned:
                continue
            values = np.asarray(explanation.cleaned[axis])
            cut = int(TRAINED * len(values))
            accepted = explanation.held.accepted[axis]
            parts: list[Part] = [part for one in accepted for part in one.parts]
            parts += [one for c in accepted for one in c.profiles]
            lines = {(p.low, p.high) for c in accepted for p in c.profiles}
            doubtful = tuple(
                r for one in accepted if one.signal is None for r in one.excluded if r not in lines
            )
            known = Known(tuple(parts), None, (), doubtful)
            fit, seconds = fitted(values[:cut], samples.rate_hz, known)
            d = ordinates(values[cut:])
            z = d / np.sqrt(variances(fit, len(d) + 1, samples.rate_hz))
            folds = scores(values, samples.rate_hz, known)
            yield f"{path.stem} {axis}", anderson_darling(z), folds, seconds


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--records", type=int, default=120)
    parser.add_argument("--quick", action="store_true", help="30 records, nothing measured")
    parser.add_argument("--no-measured", action="store_true")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    rows = np.array(list(simulated(30 if options.quick else options.records)))
    score, fold, gained, oracle, seconds = rows.T
    behind = 100 * (oracle - gained).sum() / oracle.sum()
    each = 100 * (oracle - gained) / np.maximum(oracle, 1e-9)
    normal, typical = 100 * float(np.mean(score < LIMIT)), float(np.median(each[oracle > 100]))
    figures = [
        Figure("last eighth normal, simulated", normal, "%", 93.0, more=True),
        Figure("held-out ordinates normal, simulated", 100 * float(np.mean(fold < LIMIT)), "%"),
        Figure("nats behind the oracle per 100 gained, all", float(behind), "nats", 2.0),
        Figure("the same, median of records that gain 100", typical, "nats", 2.0),
        Figure("processor time of a fit, most", float(seconds.max()), "s", 2.0),
    ]
    print(f"{np.count_nonzero(oracle > 100)} of {len(rows)} records gain more than 100 nats")
    if not options.quick and not options.no_measured:
        found = list(measured())
        for name, statistic, folds, spent in found:
            passed = np.count_nonzero(np.array(folds) < LIMIT)
            mark = "" if statistic < LIMIT else "!"
            print(
                f"{name:26} last eighth A2 {statistic:8.2f} {mark:1} ordinates A2 "
                f"{np.median(folds):6.2f}, {passed} of {FOLDS} pass {spent:6.2f} s"
            )
        normal = 100 * float(np.mean([one[1] < LIMIT for one in found]))
        of_density = 100 * float(np.mean([np.array(one[2]) < LIMIT for one in found]))
        figures += [
            Figure("held-out ordinates normal, measured", of_density, "%", 93.0, more=True),
            Figure("last eighth normal, measured axes", normal, "%"),
            Figure(
                "processor time of a fit, most, measured", max(one[3] for one in found), "s", 2.0
            ),
        ]
    for figure in figures:
        print(f"{figure.what}: {figure.value:.4g} {figure.unit}")
    if options.json:
        whole = {"figures": [asdict(figure) for figure in figures]}
        options.json.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
