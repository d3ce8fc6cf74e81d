"""How often `export --bound` covers held-out data, and by how much it is inflated.

    python benchmarks/bound.py --records 40
    python benchmarks/bound.py --measured

Each sensor has white, flicker and random-walk noise of random size. Its bound is set on one record;
the second difference of the integrated signal of another record, as long, is compared with it. Of
the measured recordings that are long enough the bound of each half is compared with the other.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from independent_reading import samples_of

from allanscope.allan import Deviation, deviation
from allanscope.noise import bound_model
from allanscope.noise.bound import LONGEST_S, QUANTILE, SHORTEST_S

RATE = 2.0
MEASURED = Path(__file__).parent.parent / "recordings" / "measured"
LEAST_S = 60.0
"""Shortest half of a recording."""


def record(rng: np.random.Generator, hours: float, flicker: float, walk: float) -> np.ndarray:
    """Return unit white noise with flicker noise and a random walk of given relative density."""
    n = int(hours * 3600 * RATE)
    f = np.fft.rfftfreq(2 * n, 1 / RATE)
    f[0] = f[1] / 2
    density = 1.0 + flicker / f + walk / f**2
    noise = np.fft.irfft(np.fft.rfft(rng.standard_normal(2 * n)) * np.sqrt(density), 2 * n)
    return noise[:n]


def coverage(
    records: int, quantiles: list[float], hours: float, seed: int
) -> dict[float, tuple[float, float]]:
    """Return share of held-out variances below the bound, and mean inflation of the deviation."""
    rng = np.random.default_rng(seed)
    covered = {q: [] for q in quantiles}
    inflation = {q: [] for q in quantiles}
    taus = np.unique(np.round(np.geomspace(SHORTEST_S, LONGEST_S, 31) * RATE)) / RATE
    for _ in range(records):
        size = 10 ** rng.uniform(-4, -1), 10 ** rng.uniform(-8, -4)
        curve, held_out = (
            deviation(record(rng, hours, *size), RATE, "oadev", taus, noise="FFM") for _ in range(2)
        )
        for q in quantiles:
            share, excess = compared(curve, held_out, q)
            covered[q].append(share)
            inflation[q].append(excess)
    return {q: (float(np.mean(covered[q])), float(np.mean(inflation[q]))) for q in quantiles}


def compared(curve: Deviation, held_out: Deviation, quantile: float) -> tuple[float, float]:
    """Return the share of held-out variances below the bound of a curve, and its inflation."""
    bound = bound_model(curve, quantile=quantile)
    assert bound is not None
    inside = (curve.tau >= bound.shortest_s) & (curve.tau <= bound.longest_s)
    below = held_out.deviation**2 <= bound.variance(curve.tau)
    return float(np.mean(below[inside])), bound.inflation


def measured(quantile: float) -> None:
    """Print the same of the halves of measured recordings."""
    found = []
    for path in sorted(MEASURED.glob("*.parquet")):
        samples = samples_of(path)
        for axis, x in samples.axes.items():
            n, rate = len(x) // 2, samples.rate_hz
            if n / rate < LEAST_S:
                continue
            taus = np.geomspace(SHORTEST_S, min(LONGEST_S, n / rate / 4), 24)
            taus = np.unique(np.round(taus * rate)) / rate
            one, other = (deviation(half, rate, "oadev", taus) for half in (x[:n], x[n : 2 * n]))
            both = [compared(one, other, quantile), compared(other, one, quantile)]
            found += both
            shares = ", ".join(f"{100 * share:.0f} % at {excess:.2f}" for share, excess in both)
            print(f"{path.stem} {axis}: {shares}")
    share, excess = np.mean(found, axis=0)
    print(f"{len(found)} halves: covered {100 * share:.1f} %, inflation {excess:.3f}")


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--measured", action="store_true", help="halves of measured recordings")
    options.add_argument("--records", type=int, default=40)
    options.add_argument("--quantiles", type=float, nargs="*", default=[0.8, 0.85, 0.9])
    options.add_argument("--hours", type=float, default=12.0)
    options.add_argument("--seed", type=int, default=1)
    chosen = options.parse_args()
    if chosen.measured:
        measured(QUANTILE)
        options.exit()
    for q, (share, excess) in coverage(
        chosen.records, chosen.quantiles, chosen.hours, chosen.seed
    ).items():
        print(f"quantile {q:.2f}: covered {100 * share:.1f} %, inflation {excess:.3f}")
