"""How often the limits of a deviation hold the truth: coverage of the chi-square intervals.

Power-law noise of known kind is generated again and again, its noise types are found by the program
itself, and it is counted how often the 95 % limits contain the expectation. For unbiased estimators
that is the mean over all runs of the variance itself; for the totals and bias-removed THEO1 the
mean of the variance they estimate. THEO1 and the standard deviations are held against their own
mean.

    python benchmarks/interval_coverage.py
    python benchmarks/interval_coverage.py --write     docs/explanation/coverage.md, half an hour
    python benchmarks/interval_coverage.py --write --store FILE     goes on where it was stopped
    python benchmarks/interval_coverage.py --write --store FILE --stored    other cells as they were
    python benchmarks/interval_coverage.py --samples 8192 --runs 300 --stream
    python benchmarks/interval_coverage.py --alphas 0 --beside -2 --knee 16

prints, for each estimator and noise, how often the noise was named right and the coverage in % at
every trusted averaging factor: octaves, three quarters of the last ones, and the end of the trusted
range. With ``--stream`` the runs go
through an `AllanBank`, whose terms are thinned at long tau. tdev, ttotdev are multiples of mdev and
mtotdev and have their limits.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from figures import Figure, written
from numpy.typing import NDArray

from allanscope.allan import AllanBank, Deviation, deviation
from allanscope.allan.confidence import assemble
from allanscope.allan.estimators import REGISTRY, Sums
from allanscope.allan.noise_type import NAMES, Family, unit_variance

Floats = NDArray[np.float64]

PAGE = Path(__file__).parent.parent / "docs/explanation/coverage.md"
TARGET = {
    "totdev": "oadev",
    "theobr": "oadev",
    "theoh": "oadev",
    "mtotdev": "mdev",
    "ttotdev": "tdev",
    "htotdev": "ohdev",
}
"""Estimator whose expectation another one estimates with less scatter."""
FAMILY: dict[str, Family] = {"oadev": "avar", "mdev": "mvar", "ohdev": "hvar"}
MULTIPLES = ("tdev", "ttotdev")
LOWEST, MOST = 93.0, 97.0
LENGTHS = {1024: 5000, 256: 5000, 4096: 2000}
"""Samples and runs of the published page."""
KNEES = (4, 16, 64)
BESIDE = ((0, -2), (0, -1), (-1, -2), (1, 0), (2, 0), (2, -1), (0, -3), (0, -4))
KNEE_RUNS = 2000
"""Pairs of noises on the published page, of one level at n / tau."""


def power_law(alpha: int, samples: int, runs: int, rng: np.random.Generator) -> Floats:
    """Return Gaussian noise with S(f) ~ |2 sin(pi f)|^alpha, shape (runs, samples)."""
    # The first half is thrown away: it still remembers that there was nothing before it.
    k = np.arange(1, 2 * samples)
    response = np.append(1.0, np.cumprod((k - 1 - alpha / 2) / k))
    length = 4 * samples
    white = np.fft.rfft(rng.standard_normal((runs, 2 * samples)), length, axis=1)
    noise = np.fft.irfft(white * np.fft.rfft(response, length), length, axis=1)
    return noise[:, samples : 2 * samples]


def phases_of(noise: Floats) -> Floats:
    return np.concatenate([np.zeros((len(noise), 1)), noise.cumsum(axis=1)], axis=1)


def factors_of(kind: str, samples: int) -> list[int]:
    """Return octaves, three quarters of the last of them, and the end of what is trusted."""
    estimator = REGISTRY[kind]
    octaves = [2**k for k in range(samples.bit_length()) if 2**k <= samples]
    between = [3 * m // 4 for m in octaves if 8 * m > samples]
    end = int(estimator.trust_fraction * samples / estimator.tau_factor)
    some = sorted({*octaves, *between, end})
    return [
        m
        for m in some
        if estimator.admits(m, samples)
        and estimator.needed(m) <= samples
        and estimator.tau(m, samples) <= estimator.trust_fraction * samples
    ]


def truth(kind: str, tau: Floats, phases: Floats, alpha: int | None = None) -> Floats:
    """Return the mean variance at each tau; NaN where tau is no whole number of samples.

    A variance beyond a quarter of the run, where it has few terms or none, follows from that at a
    16th and from the noise, if there is only one.
    """
    target = REGISTRY[TARGET.get(kind, kind)]
    length = phases.shape[1] - 1
    result = np.full(tau.size, np.nan)
    for i, samples in enumerate(tau.tolist()):
        m, growth = round(samples / target.tau_factor), 1.0
        if alpha is not None and alpha >= -2 and 4 * m > length and target.name in FAMILY:
            near, far = unit_variance(FAMILY[target.name], [length // 16, m])[2 - alpha]
            m, growth = length // 16, far / near
        elif abs(m * target.tau_factor - samples) > 1e-9:
            continue
        result[i] = growth * np.mean([target.exact(phase, m)[0] for phase in phases])
    return result


def curves(kind: str, noise: Floats, phases: Floats, bank: AllanBank) -> Deviation:
    """Return what `deviation` gives of each run, at all factors, with every noise found at once."""
    estimator, n = REGISTRY[kind], noise.shape[1]
    m = factors_of(kind, n)
    values = np.array([estimator.curve(phase, m) for phase in phases])
    stride = np.array([estimator.exact_stride(k) for k in m])
    sums = Sums(np.array(m), values[..., 0], values[..., 1].astype(np.int64), stride, n)
    every = assemble(kind, sums, 1.0, 0.95, bank.noise_types(estimator.tau(m, n)))
    tau = [float(k) for k in m]
    alone = deviation(noise[0], 1.0, kind, tau)
    np.testing.assert_allclose(every.upper[0], alone.upper, rtol=1e-9)
    return every


def coverage(
    kind: str, parts: dict[int, Floats], bank: AllanBank, *, stream: bool
) -> tuple[NDArray[np.int64], Floats, float]:
    """Return trusted factors, the coverage in % at each, and how often the first noise was found.

    `parts` has the noises by their power laws; independent, so that their variances add up.
    """
    noise = np.sum(list(parts.values()), axis=0)
    phases = phases_of(noise)
    curve = bank.deviation(kind) if stream else curves(kind, noise, phases, bank)
    trusted = np.broadcast_to(curve.trusted, curve.deviation.shape)
    each = [truth(kind, curve.tau, phases_of(part), alpha) for alpha, part in parts.items()]
    expected = np.sqrt(np.sum(each, axis=0))
    known = np.isfinite(expected) & (trusted.mean(axis=0) > 0.5)
    held = (curve.lower <= expected) & (expected <= curve.upper)
    right = np.mean(curve.noise[:, known] == NAMES[next(iter(parts))]) if known.any() else np.nan
    share = np.sum(held & trusted, axis=0)[known] / np.sum(trusted, axis=0)[known]
    return curve.m[known], 100.0 * share, float(right)


Rows = dict[str, dict[str, dict[int, float]]]
Part = tuple[int, int, int, Rows]
"""Samples, runs, n / tau of a knee or 0, and the coverage."""


def measured(
    options: argparse.Namespace,
    samples: int,
    runs: int,
    beside: int | None = None,
    knee: int = 0,
    alphas: list[int] | None = None,
) -> Rows:
    """Return the coverage of every noise, estimator and averaging factor; print it as it is known.

    Parameters
    ----------
    options : argparse.Namespace
        Estimators, noises and seed.
    samples, runs : int
        Length and number of the records.
    beside : int or None
        Power law of a second noise in each.
    knee : int
        n / tau where the two have one level.
    alphas : list of int, optional
        First noises; those of `options` if not given.
    """
    rows: Rows = {}
    store = stored(options)
    for alpha in options.alphas if alphas is None else alphas:
        label = NAMES[alpha] if beside is None else f"{NAMES[alpha]}+{NAMES[beside]}"
        name = f"{samples} samples, {runs} runs, seed {options.seed}, {NAMES[alpha]}"
        if beside is not None:
            name += f" and {NAMES[beside]} at n/{knee}"
        if name in store:
            rows[label] = {
                kind: {int(m): held for m, held in row.items()}
                for kind, row in store[name].items()
                if kind in options.kinds
            }
            continue
        if options.stored:
            continue
        own = [] if beside is None else [beside + 9, knee]
        rng = np.random.default_rng([options.seed, alpha + 9, *own])
        parts = {alpha: power_law(alpha, samples, runs, rng)}
        if beside is not None:
            second = power_law(beside, samples, runs, rng)
            tau = np.array([float(samples // knee)])
            meet = "oadev" if min(alpha, beside) >= -2 else "ohdev"
            level = [truth(meet, tau, phases_of(one)) for one in (parts[alpha], second)]
            parts[beside] = second * np.sqrt(level[0] / level[1])
        bank = AllanBank(1.0, axes=runs, per_octave=1)
        bank.update(np.sum(list(parts.values()), axis=0).T)
        here = rows.setdefault(label, {})
        for kind in options.kinds:
            if min(alpha, beside if beside is not None else alpha) < REGISTRY[kind].lowest_alpha:
                continue
            m, held, right = coverage(kind, parts, bank, stream=options.stream)
            if m.size:
                here[kind] = dict(zip(m.tolist(), held.tolist(), strict=True))
                cells = " ".join(
                    f"{k}:{share:.1f}{'' if LOWEST <= share <= MOST else '!'}"
                    for k, share in here[kind].items()
                )
                print(f"{kind:8} {label:5} {right:5.2f}  {cells}", flush=True)
        if options.store:
            store[name] = {
                kind: {str(m): held for m, held in row.items()} for kind, row in here.items()
            }
            options.store.write_text(json.dumps(store, indent=1), encoding="utf-8")
    return rows


def stored(options: argparse.Namespace) -> dict[str, dict[str, dict[str, float]]]:
    """Return what an earlier run of the same code has kept."""
    if options.store is None or not options.store.exists():
        return {}
    kept: dict[str, dict[str, dict[str, float]]] = json.loads(options.store.read_text("utf-8"))
    return kept


def summary(rows: Rows) -> tuple[int, float, float, list[str]]:
    """Return how many cells there are, the lowest and the highest, and those outside by name."""
    every = [
        (noise, kind, m, held)
        for noise, kinds in rows.items()
        for kind, row in kinds.items()
        for m, held in row.items()
    ]
    shares = [held for *_, held in every]
    outside = [
        f"{kind} of {noise} at m = {m} ({held:.1f} %)"
        for noise, kind, m, held in every
        if not LOWEST <= held <= MOST
    ]
    return len(every), min(shares), max(shares), outside


def published(options: argparse.Namespace) -> list[Part]:
    """Return what the page shows: one noise in runs of every length, two in the first of them."""
    before = kept() if options.stored else {}
    parts = [
        (samples, runs, 0, measured(options, samples, 100 if options.quick else runs))
        for samples, runs in LENGTHS.items()
    ]
    first, runs = next(iter(LENGTHS)), 100 if options.quick else KNEE_RUNS
    for knee in KNEES:
        together: Rows = {}
        for alpha, beside in BESIDE:
            together |= measured(options, first, runs, beside, knee, [alpha])
        parts.append((first, runs, knee, together))
    return [
        (samples, runs, knee, overlaid(before.get((samples, knee), {}), rows))
        for samples, runs, knee, rows in parts
    ]


def kept() -> dict[tuple[int, int], Rows]:
    """Return the published cells, by samples and knee."""
    found: dict[tuple[int, int], Rows] = {}
    for line in PAGE.with_suffix(".csv").read_text(encoding="utf-8").splitlines()[1:]:
        samples, noise, knee, kind, m, _, held = line.split(",")
        rows = found.setdefault((int(samples), int(knee or 0)), {})
        rows.setdefault(noise, {}).setdefault(kind, {})[int(m)] = float(held)
    return found


def overlaid(before: Rows, rows: Rows) -> Rows:
    """Return the rows of all estimators: of each those measured anew, or else those before."""
    anew = {kind for kinds in rows.values() for kind in kinds}
    old = {
        noise: {kind: row for kind, row in kinds.items() if kind not in anew}
        for noise, kinds in before.items()
    }
    return {noise: old.get(noise, {}) | rows.get(noise, {}) for noise in old | rows}


def page(parts: list[Part], options: argparse.Namespace) -> str:
    """Return the published page: a line for each study, and the extremes."""
    again = "."
    if options.stored:
        cells = sum(_cells(rows) for rows in stored(options).values())
        every = sum(summary(rows)[0] for *_, rows in parts)
        again = AGAIN.format(cells=cells, others=every - cells).rstrip()
    text = HEAD.format(seed=options.seed, again=again) + LENGTHS_HEAD
    for samples, runs, knee, rows in parts:
        if not knee:
            text += LINE.format(samples=samples, runs=runs, **told(rows, runs))
    text += TRUTH + MEETING.format(runs=KNEE_RUNS) + KNEES_HEAD
    for _, runs, knee, rows in parts:
        if knee:
            text += KNEE.format(knee=knee, **told(rows, runs))
    two = [rows for *_, knee, rows in parts if knee]
    return text + EXTREMES.format(one=extremes([parts[0][3]]), two=extremes(two))


def _cells(kinds: dict[str, dict[str, float]]) -> int:
    return sum(len(row) for row in kinds.values())


def told(rows: Rows, runs: int) -> dict[str, object]:
    """Return the values of a line of the page."""
    cells, low, high, outside = summary(rows)
    error = 100.0 * float(np.sqrt(0.95 * 0.05 / runs))
    shares = [share for kinds in rows.values() for row in kinds.values() for share in row.values()]
    sure = sum(not LOWEST - 2 * error <= share <= MOST + 2 * error for share in shares)
    return {
        "cells": cells, "low": low, "high": high, "sure": sure, "outside": len(outside),
    }  # fmt: skip


def extremes(parts: list[Rows]) -> str:
    """Return the lowest and the highest coverage, each with its estimator and noise."""
    every = [
        (share, kind, noise)
        for rows in parts
        for noise, kinds in rows.items()
        for kind, row in kinds.items()
        for share in row.values()
    ]
    ends = min(every), max(every)
    return " to ".join(f"{share:.1f} (`{kind}`, {noise})" for share, kind, noise in ends)


def table(parts: list[Part]) -> str:
    """Return every cell as CSV: samples, noise, knee, estimator, factor, windows, coverage in %."""
    lines = [
        f"{samples},{noise},{knee or ''},{kind},{m},{samples / m:.4g},{held:.1f}"
        for samples, _, knee, rows in parts
        for noise, kinds in rows.items()
        for kind, row in kinds.items()
        for m, held in sorted(row.items())
    ]
    head = "samples,noise,knee_windows,estimator,m,windows,coverage_percent"
    return "\n".join([head, *lines, ""])


HEAD = """\
# How often the limits hold

How often, in %, the 95 % limits of a deviation contain the truth, for records of one noise, whose
type the program identifies, and where two noises meet. Written by
`python benchmarks/interval_coverage.py --write` (half an hour; seed {seed}: not one of those that
the limits were calibrated with).

Records are arrays, of which every term is used ([streams](estimators.md#every-tau-at-once)). Every
cell, by averaging factor m (1, octaves and some between, to the end of the trusted range), is in
[coverage.csv](coverage.csv){again}

"""
AGAIN = """\
: {cells} with the limits of this version, {others}, of MTOTDEV, HTOTDEV and
THEO1 in the longest runs, before noises that meet had degrees of freedom of their own.
"""
LENGTHS_HEAD = """\
| records, samples | cells | lowest to highest | outside 93 to 97 % | by over two standard errors |
|---|---|---|---|---|
"""
LINE = """\
| {runs}, {samples} | {cells} | {low:.1f} to {high:.1f} | {outside} | {sure} |
"""
KNEES_HEAD = LENGTHS_HEAD.replace("records, samples", "same level at a window of")
KNEE = """\
| 1/{knee} of the run | {cells} | {low:.1f} to {high:.1f} | {outside} | {sure} |
"""
TRUTH = """
The truth is the mean variance over all records: of AVAR for TOTDEV, TheoBR and TheoH, of MVAR for
MTOTDEV, of HVAR for HTOTDEV, of the estimator itself for all others. `tdev` has the limits of
`mdev`, `ttotdev` those of `mtotdev`. Left out are variances that do not converge, or are
[not trusted](estimators.md#limits).
"""
MEETING = """
## Where two noises meet

Two noises have the same level (of AVAR; of HVAR with FWFM, RRFM) at one window, in {runs} records
of 1024 samples.

"""
EXTREMES = """
The extremes, at 1024 samples: {one} of one noise, {two} of two.
"""


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--seed", type=int, default=5)
    kinds = [kind for kind in REGISTRY if kind not in MULTIPLES]
    parser.add_argument("--kinds", nargs="*", default=kinds)
    parser.add_argument("--alphas", nargs="*", type=int, default=list(range(2, -5, -1)))
    parser.add_argument("--beside", type=int, help="alpha of a second noise")
    parser.add_argument("--knee", type=int, default=16, help="where it meets the first: n / tau")
    parser.add_argument("--stream", action="store_true", help="through a bank")
    parser.add_argument("--write", action="store_true", help="all of the page of the docs")
    parser.add_argument("--quick", action="store_true", help="a hundred runs")
    parser.add_argument("--store", type=Path, help="keep what is measured; do not repeat what is")
    parser.add_argument("--stored", action="store_true", help="measure nothing beyond the store")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    runs = 100 if options.quick else options.runs
    began = time.process_time()
    if options.write:
        parts = published(options)
        PAGE.write_text(page(parts, options), encoding="utf-8")
        PAGE.with_suffix(".csv").write_text(table(parts), encoding="utf-8")
        rows = parts[0][3]
    else:
        rows = measured(options, options.samples, runs, options.beside, options.knee)
    cells, low, high, outside = summary(rows)
    print(f"{cells} cells, {low:.1f} to {high:.1f} %, outside: {'; '.join(outside) or 'none'}")
    print(f"{time.process_time() - began:.0f} s of processor time")
    if options.json:
        figures = [
            Figure("lowest coverage", low, "%", goal=LOWEST, more=True),
            Figure("highest coverage", high, "%", goal=MOST),
        ]
        written(figures, options.json)


if __name__ == "__main__":
    main()
