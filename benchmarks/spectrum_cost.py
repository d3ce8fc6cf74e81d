"""What the streaming spectrum and a refresh of the fit cost.

    python benchmarks/spectrum_cost.py [--samples 4000000] [--json FILE] [--quick]

CPU time per sample and axis of a SpectrumBank on six axes of int16 counts, for several sizes of
block (a serial read at 6.66 kHz brings about 333 samples), the size of its state, and the CPU time
of reading six densities and of fitting six axes from a full history.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict
from typing import Any

import numpy as np
from figures import Figure

from allanscope.history import History
from allanscope.noise import fit_noise
from allanscope.parts import part_named
from allanscope.samples import AXES
from allanscope.spectrum import SpectrumBank

RATE, STEP = 6664.0, 4.375e-3


def counts_of(samples: int) -> np.ndarray:
    """Six axes of white noise and a random walk in counts."""
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.standard_normal((samples, 6)), axis=0) * 0.003
    return np.round(10 * rng.standard_normal((samples, 6)) + walk).astype(np.int16)


def figures_of(results: dict[str, float]) -> list[dict[str, Any]]:
    """Return what goes to the common table."""
    return [
        asdict(Figure(what, value, "ms" if "ms" in what else "KiB" if "KiB" in what else "ns"))
        for what, value in results.items()
    ]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=4_000_000, help="samples of each axis")
    parser.add_argument("--quick", action="store_true", help="200 000 samples")
    parser.add_argument("--json", metavar="FILE", help="write the results here too")
    options = parser.parse_args()
    counts = counts_of(200_000 if options.quick else options.samples)
    results: dict[str, float] = {}
    for block in (1 << 17, 4096, 333):
        bank = SpectrumBank(RATE, 6)
        started = time.process_time()
        for first in range(0, len(counts), block):
            bank.update(counts[first : first + block])
        results[f"ns per sample and axis, blocks of {block}"] = (
            1e9 * (time.process_time() - started) / counts.size
        )
    size = sum(array.nbytes for array in bank.state().values())
    results["state, KiB per axis"] = size / 6 / 1024
    history = History(6, 1 << 18)
    for first in range(0, len(counts), 1 << 16):
        history.update(counts[first : first + (1 << 16)])
    record = history.record(RATE, AXES, (STEP,) * 6)
    part = part_named("LSM6DSM")
    for name in ("first", "again"):
        started = time.process_time()
        densities = bank.densities(scale=STEP)
        results[f"six densities, ms ({name})"] = 1e3 * (time.process_time() - started)
        started = time.process_time()
        for axis, density in zip(AXES, densities, strict=True):
            fit_noise(record, axis, density, part=part)
        results[f"six fits, ms ({name})"] = 1e3 * (time.process_time() - started)
    for name, value in results.items():
        print(f"{name:45s}{value:10.1f}")
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump({"figures": figures_of(results), **results}, file, indent=1)


if __name__ == "__main__":
    main()
