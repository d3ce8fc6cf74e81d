"""How large an effect must be for half of them to be named, against an ideal detector.

    python benchmarks/sensitivity.py [--kinds step,outliers] [--trials 24] [--seed 1] [--quick]
                                     [--json FILE]

The size of an effect is d', the square root of twice the log-likelihood ratio of one who knows the
noise and what to look for: the deviations by which it stands out. Each trial hides one effect on
one axis of a record of two; sizes spread evenly over the range in question, and the d' at which
half are named is that of a logistic curve through the answers. The bound is that of an ideal
detector that knows the noise but has to look at all places, at the same rate of false alarms.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from blind_effects import forgetting
from blind_noise import Array, base_noise, draw_noise, information
from figures import Figure, written
from scipy.optimize import minimize

from allanscope.explain import explain
from allanscope.history import Record

IDEAL = {"step": 4.4, "excursion": 4.9, "outliers": 5.7, "cross_coupling": 3.8}
RANGE = (2.0, 10.0)
RATE, SECONDS = 52.0, 1200.0
FALSE_PERCENT = 2.5
"""One false effect in 40 clean axes."""


def shape_of(kind: str, rng: np.random.Generator, n: int, source: Array) -> Array:
    """Return an effect of unit size at a random place."""
    shape = np.zeros(n)
    if kind == "step":
        shape[int(n * rng.uniform(0.08, 0.92)) :] = 1.0
    elif kind == "excursion":
        length = int(n * np.exp(rng.uniform(*np.log([0.01, 0.1]))))
        first = int(rng.uniform(0.05, 0.85) * n)
        shape[first : first + length] = 1.0
    elif kind == "outliers":
        shape[int(rng.uniform(0.02, 0.98) * n)] = 1.0
    else:
        shape = source - source.mean()
    return shape


def trial(kind: str, d: float, seed: int) -> tuple[bool, int]:
    """Hide an effect of size d'; return whether it was named, and what else was."""
    rng = np.random.default_rng([seed, 1225])
    n = int(RATE * SECONDS)
    noises = [draw_noise(rng, axis) for axis in ("gx", "gy")]
    columns = [base_noise(rng, noise, n, RATE) for noise in noises]
    if kind == "cross_coupling":  # a source that tilts
        columns[1] = columns[1] + forgetting(rng, n, np.exp(-1 / (20 * RATE)), 100 * noises[1].b)
    shape = shape_of(kind, rng, n, columns[1])
    columns[0] = columns[0] + d / np.sqrt(information(shape, noises[0], RATE)) * shape
    table = np.column_stack(columns) + [noise.offset for noise in noises]
    lsb = np.array([noise.lsb for noise in noises])
    record = Record(
        rate_hz=RATE,
        stride=1,
        axes=("gx", "gy"),
        values=np.round(table / lsb) * lsb,
        lsb=tuple(lsb),
        temperature_c=np.full(n, np.nan),
        start_s=np.arange(n) / RATE,
        segments=np.array([[0, n]], np.int64),
    )
    found = [effect.kind for effect in explain(record).axes["gx"].effects]
    return kind in found, len([name for name in found if name != kind])


def half_named(d: Array, named: Array) -> float:
    """Return the d' at which half are named, by a logistic curve."""

    def loss(p: Array) -> float:
        x = (d - p[0]) * np.exp(p[1])
        return float(np.sum(np.logaddexp(0, -x) * named + np.logaddexp(0, x) * (1 - named)))

    return float(minimize(loss, [np.mean(RANGE), 1.0], method="Nelder-Mead").x[0])


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kinds", default=",".join(IDEAL))
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--clean", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    trials, clean = (6, 2) if arguments.quick else (arguments.trials, arguments.clean)
    started = time.process_time()
    figures, answers = [], {}
    for kind in arguments.kinds.split(","):
        sizes = np.linspace(*RANGE, trials)
        seeds = 10_000 * arguments.seed + np.arange(trials)
        told = [trial(kind, d, int(s)) for d, s in zip(sizes, seeds, strict=True)]
        named = np.array([t[0] for t in told], float)
        answers[kind] = {"sizes": sizes.tolist(), "named": named.tolist(),
                         "others": sum(t[1] for t in told)}  # fmt: skip
        figures.append(
            Figure(f"d' of half named, {kind}", half_named(sizes, named), "sd", bound=IDEAL[kind])
        )
    if clean:
        told = [trial("step", 0.0, 10_000 * arguments.seed + 5000 + k) for k in range(clean)]
        false = sum(named + others for named, others in told)
        figures.append(
            Figure("false effects on clean axes", 100 * false / clean, "%", goal=FALSE_PERCENT)
        )
    seconds = time.process_time() - started
    written(figures, arguments.json, answers=answers, cpu_seconds=seconds)


if __name__ == "__main__":
    main()
