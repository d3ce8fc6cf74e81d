"""How often the intervals of readings hold, on records of white noise, flicker noise and walk.

    python benchmarks/readings.py --records 300

Each record goes through what a run keeps, a SpectrumBank and an AllanBank, and is read. The truth
of N is the white noise; of N at 1 s and of B what the expected deviation is at 1 s and at its
least; of K the random walk.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np
from efficiency import RATE, simulate
from figures import Figure, written

from allanscope.allan import AllanBank
from allanscope.analysis.readings import read_axis
from allanscope.noise import NoiseModel
from allanscope.noise.components import Flicker, RandomWalk, White
from allanscope.spectrum import SpectrumBank

RECORDS = (
    {"samples": 60_000, "N": 4e-3, "B": 0.0, "K": 5e-5},
    {"samples": 60_000, "N": 4e-3, "B": 1.2e-3, "K": 1e-4},
    {"samples": 400_000, "N": 4e-3, "B": 1.2e-3, "K": 1e-4},
    {"samples": 400_000, "N": 4e-3, "B": 6e-3, "K": 3e-4},
    {"samples": 200_000, "N": 4e-3, "B": 2e-3, "K": 4e-3},
)


def main() -> None:
    """Read many records and print how often the intervals hold."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=300, help="of each of five kinds")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="40 records of each kind")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures here too")
    options = parser.parse_args()
    records = 40 if options.quick else options.records
    pooled: dict[str, list[bool]] = defaultdict(list)
    for kind, truth in enumerate(RECORDS):
        held: dict[str, list[bool]] = defaultdict(list)
        errors: dict[str, list[float]] = defaultdict(list)
        for seed in range(records):
            rng = np.random.default_rng([options.seed, kind, seed])
            for name, (value, lower, upper, true) in read(truth, rng).items():
                held[name].append(lower <= true <= upper)
                errors[name].append(value / true - 1)
        print(f"{truth}")
        for name, one in held.items():
            pooled[name] += one
            print(
                f"  {name:5} read in {100 * len(one) / records:3.0f} %, interval holds in "
                f"{100 * np.mean(one):5.1f} %, off by {100 * np.mean(errors[name]):+.2f} % "
                f"+- {100 * np.std(errors[name]):.2f} %"
            )
    figures = [
        Figure(f"interval of the reading of {name} holds", 100 * float(np.mean(one)), "%")
        for name, one in pooled.items()
    ]
    written(figures, options.json)


def read(
    truth: dict[str, float], rng: np.random.Generator
) -> dict[str, tuple[float, float, float, float]]:
    """Return value, limits and truth of every reading of one record."""
    samples = simulate(int(truth["samples"]), rng, truth)[:, np.newaxis]
    spectrum, allan = SpectrumBank(RATE, 1), AllanBank(RATE, axes=1)
    spectrum.update(samples)
    allan.update(samples)
    curve = allan.deviation("oadev").axis(0)
    model = NoiseModel((White(truth["N"]), Flicker(truth["B"]), RandomWalk(truth["K"])), 1 / RATE)
    expected = model.deviation("oadev", curve.m)
    true = {
        **truth,
        "N_1s": float(model.deviation("oadev", [RATE])[0]),
        "B": float(expected.min()) / np.sqrt(2 * np.log(2) / np.pi),
    }
    found = read_axis(spectrum.density(0), curve, "dps")
    return {name: (one.value, one.lower, one.upper, true[name]) for name, one in found.items()}


if __name__ == "__main__":
    main()
