"""What thinning costs in accuracy: the bank beside the same estimators with every term.

    python benchmarks/thinning.py [--quick] [--json FILE]

Three tables, in per cent of the deviation. The first is the rms difference between the cascade's
terms (every 2^L-th above m = 64) and full overlap, at the longest m it is given for, a sixteenth of
the run. The second is mean and rms difference between curves from the archive and from every
sample, for rows of 16 samples and windows of the totals at every sixteenth of m. The third is what
the windows add that a bank leaves out of 7800 rows: rms difference from all windows, and by how
much the standard deviation grows.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from allanscope.allan import AllanBank
from allanscope.allan.curves import _WINDOWS_PER_TAU
from allanscope.allan.estimators import REGISTRY, theobr
from allanscope.allan.estimators.htotdev import htot_variance
from allanscope.allan.estimators.mtotdev import mtot_variance
from allanscope.allan.estimators.theo1 import theo1_variance, thinned_theo1_variance
from allanscope.allan.phase import to_phase

STRIDE = 16
Row = dict[str, Any]


def noises(rng: np.random.Generator, n: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield rates of five power laws."""
    white = rng.standard_normal(n)
    spectrum = np.fft.rfft(rng.standard_normal(2 * n))
    spectrum[0] = 0.0
    root = np.sqrt(np.arange(spectrum.size).clip(1))
    yield "white PM", np.diff(white, prepend=0.0)
    yield "flicker PM", np.fft.irfft(spectrum * root)[:n]
    yield "white FM", white
    yield "flicker FM", np.fft.irfft(spectrum / root)[:n]
    yield "random walk", white.cumsum()


def cascade(records: int, n: int) -> list[Row]:
    """Compare the bank with the definitions at m = n / 16."""
    m = n // 16
    differences: dict[tuple[str, str], list[float]] = {}
    for seed in range(records):
        for noise, rates in noises(np.random.default_rng(seed), n):
            bank = AllanBank(1.0, axes=1, per_octave=1)
            bank.update(rates)
            phase = to_phase(rates, 1.0)
            for kind in ("oadev", "ohdev", "mdev", "totdev"):
                curve = bank.deviation(kind)
                full = np.sqrt(REGISTRY[kind].exact(phase, m)[0])
                error = float(curve.deviation[0, curve.m == m][0] / full - 1)
                differences.setdefault((kind, noise), []).append(error)
    return [
        {"kind": kind, "noise": noise, "rms_percent": 100 * float(np.sqrt(np.mean(np.square(e))))}
        for (kind, noise), e in differences.items()
    ]


def archive(records: int, n: int) -> list[Row]:
    """Compare curves from rows of `STRIDE` samples with those from all of them."""
    differences: dict[tuple[str, str, int], list[float]] = {}
    for seed in range(records):
        for noise, rates in noises(np.random.default_rng(100 + seed), n):
            phase = to_phase(rates, 1.0)
            picked = phase[::STRIDE]
            averaged = phase[:n].reshape(-1, STRIDE).mean(axis=1)
            for k in (32, 64, 128):
                m, step = k * STRIDE, k // 16
                wide = step * STRIDE // 4
                pairs = {
                    "mtotdev": (
                        mtot_variance(averaged, k, step)[0] / STRIDE**2,
                        mtot_variance(phase, m, wide)[0],
                    ),
                    "htotdev": (
                        htot_variance(picked, k, step)[0] / STRIDE**2,
                        htot_variance(phase, m, wide)[0],
                    ),
                    "theo1": (
                        thinned_theo1_variance(picked, k, STRIDE)[0],
                        theo1_variance(phase, m, wide)[0],
                    ),
                    "theo1 as picked (TheoBR)": (
                        theo1_variance(picked, k)[0] / STRIDE**2,
                        theo1_variance(phase, m, wide)[0],
                    ),
                }
                for kind, (thinned, full) in pairs.items():
                    key = (kind, noise, k)
                    differences.setdefault(key, []).append(np.sqrt(thinned / full) - 1)
    return [
        {
            "kind": kind,
            "noise": noise,
            "rows_per_m": k,
            "mean_percent": 100 * float(np.mean(e)),
            "rms_percent": 100 * float(np.sqrt(np.mean(np.square(e)))),
        }
        for (kind, noise, k), e in sorted(differences.items())
    ]


def windows(records: int, n: int) -> list[Row]:
    """Compare values from the windows that a bank takes with those from all of them."""
    plain = {"mtotdev": mtot_variance, "htotdev": htot_variance, "theo1": theo1_variance}
    values: dict[tuple[str, str, int], list[tuple[float, float]]] = {}
    for seed in range(records):
        for noise, rates in noises(np.random.default_rng(200 + seed), n):
            phase = to_phase(rates, 1.0)
            for kind, variance in plain.items():
                for k in (n // 32, n // 8, n // 4) + (n // 2,) * (kind == "theo1"):
                    m = k // 2 * 2
                    thinned = variance(phase, m, m // _WINDOWS_PER_TAU[kind])[0]
                    full = variance(phase, m, max(m // 256, 1))[0]
                    values.setdefault((kind, noise, m), []).append((thinned, full))
            with patch.multiple(theobr, _MOST_RATIOS=n, _WINDOWS_PER_TAU=128):
                full = theobr.theobr_ratio(phase)
            ratios = values.setdefault(("ratio of TheoBR", noise, 0), [])
            ratios.append((theobr.theobr_ratio(phase), full))
    rows = []
    for (kind, noise, m), pairs in values.items():
        thinned, full = np.sqrt(np.transpose(pairs))
        apart, mean = thinned - full, full.mean()
        grows = np.sqrt(1 + apart.var() / full.var()) - 1
        parts = np.sqrt(np.mean(apart**2)), full.std()
        names = ("rms_percent", "sd_percent")
        percent = {name: 100 * float(part / mean) for name, part in zip(names, parts, strict=True)}
        rows.append(
            {"kind": kind, "noise": noise, "m": m, **percent, "grows_percent": 100 * float(grows)}
        )
    return rows


def table(rows: list[Row]) -> str:
    """Return the rows as text."""
    lines = ["".join(f"{head:>26}" for head in rows[0])]
    for row in rows:
        cells = [f"{cell:.3f}" if isinstance(cell, float) else f"{cell}" for cell in row.values()]
        lines.append("".join(f"{cell:>26}" for cell in cells))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="few records, a few seconds")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to a file too")
    arguments = parser.parse_args()
    records = 4 if arguments.quick else 60
    sections = {
        "cascade beside full overlap": cascade(records, 1 << 15),
        "archive beside all samples": archive(records, 1 << 14),
        "windows of a bank beside all windows": windows(records, 7800),
    }
    for title, rows in sections.items():
        print(f"\n{title}\n{table(rows)}")
    if arguments.json:
        arguments.json.write_text(json.dumps(sections, indent=1))


if __name__ == "__main__":
    main()
