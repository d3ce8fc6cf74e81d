"""Calibration of the limits: degrees of freedom of totals and Theo1, where no equation has them.

    python benchmarks/calibrate_limits.py [--runs 3000] [--seed 1] [--write] [--json FILE] [--quick]

Nothing is published for TOTDEV and HTOTDEV of phase noise, nor for the ratio that TheoBR is scaled
with, and the fit for THEO1 of random-walk FM fails at the end of the run. Discrete power-law noise
of `LENGTHS` samples is generated ``--runs`` times and each estimator evaluated at windows of
n / 2^k samples; the degrees of freedom are twice the squared mean of the variance over its
variance. ``--write`` puts them into the package, where `allanscope.allan.edf` interpolates in the
logarithms. 3000 runs are good to 3 % in degrees of freedom, 1.5 % in the width of the limits.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from figures import Figure, written
from interval_coverage import power_law

from allanscope.allan.estimators import REGISTRY
from allanscope.allan.noise_type import NAMES

TABLE = Path(__file__).parent.parent / "src/allanscope/allan/edf_calibration.toml"
LENGTHS = (256, 1024, 4096)
SHORT = {"totdev": (64,), "htotdev": (64,)}
"""Lengths that are simulated too; shorter than 89 samples TheoBR has no ratio."""
MOST = 128
"""Windows in a run; with more of them equations hold."""

CELLS = {
    "totdev": (2, 1),
    "htotdev": (2, 1),
    "theobr": (2, 1, 0, -1, -2),
    "theo1": (-2,),
}
"""Estimators and power laws without an equation."""

FEWEST_SAMPLES = {"theobr": 10, "theo1": 10}
"""Of a window, where the shortest means nothing."""

HEAD = """\
# Degrees of freedom by simulation, where no equation has them: for each estimator and power law,
# at windows of n / `windows` samples in runs of `samples` (rows of `edf`).
# Written by: python benchmarks/calibrate_limits.py --runs {runs} --write
"""


def degrees(kind: str, phases: np.ndarray, m: int) -> float:
    """Return the degrees of freedom of a variance over many runs."""
    values = np.array([REGISTRY[kind].exact(phase, m)[0] for phase in phases])
    return float(2.0 * values.mean() ** 2 / values.var(ddof=1))


def table_of(kind: str, alpha: int, runs: int, seed: int) -> tuple[list[int], list[list[float]]]:
    """Return numbers of windows, and the degrees of freedom for each length."""
    estimator = REGISTRY[kind]
    fewest = FEWEST_SAMPLES.get(kind, 4)
    first = 0 if kind.startswith("theo") else 1 if kind == "totdev" else 2
    windows = [2**k for k in range(first, MOST.bit_length())]
    rows = []
    for n in (*SHORT.get(kind, ()), *LENGTHS):
        rng = np.random.default_rng([seed, n, alpha + 9])
        some = max(runs * 1024 // n // 3, 50) if n > 1024 else runs
        rates = power_law(alpha, n, some, rng)
        phases = np.concatenate([np.zeros((some, 1)), rates.cumsum(axis=1)], axis=1)
        fitting = [w for w in windows if n // w >= fewest and estimator.needed(n // w) <= n]
        rows.append([round(degrees(kind, phases, n // w), 2) for w in fitting])
    return windows, rows


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the table into the package")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--quick", action="store_true", help="a hundred runs")
    options = parser.parse_args()
    runs = 100 if options.quick else options.runs
    began = time.process_time()
    text, worst = HEAD.format(runs=runs), 1.0
    for kind, alphas in CELLS.items():
        for alpha in alphas:
            windows, rows = table_of(kind, alpha, runs, options.seed)
            lines = ",\n".join(f"    {row}" for row in rows)
            text += f"\n[{kind}.{NAMES[alpha]}]\nsamples = {[*SHORT.get(kind, ()), *LENGTHS]}\n"
            text += f"windows = {windows}\nedf = [\n{lines},\n]\n"
            print(kind, NAMES[alpha], windows, rows, flush=True)
            lengths = (*SHORT.get(kind, ()), *LENGTHS)
            for n, row in zip(lengths, rows, strict=True):
                for count, found in zip(windows, row, strict=False):
                    kept = max(float(REGISTRY[kind].edf(alpha, n // count, n, 1)), 1.0)
                    worst = max(worst, found / kept, kept / found)
    print(f"{time.process_time() - began:.0f} s of processor time")
    if options.write:
        TABLE.write_text(text, encoding="utf-8")
    if options.json:
        written([Figure("largest ratio to the kept table", worst, "")], options.json)


if __name__ == "__main__":
    main()
