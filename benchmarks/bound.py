"""How often `export --bound` covers held-out data, and by how much it is inflated.

    python benchmarks/bound.py --records 40

Each sensor has white, flicker and random-walk noise of random size. Its bound is set on one record;
the second difference of the integrated signal of another record, as long, is compared with it.
"""

from __future__ import annotations

import argparse

import numpy as np

from allanscope.allan import deviation
from allanscope.noise import bound_model
from allanscope.noise.bound import LONGEST_S, SHORTEST_S

RATE = 2.0


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
            bound = bound_model(curve, quantile=q)
            inside = (taus >= bound.shortest_s) & (taus <= bound.longest_s)
            below = held_out.deviation**2 <= bound.variance(taus)
            covered[q].append(np.mean(below[inside]))
            inflation[q].append(bound.inflation)
    return {q: (float(np.mean(covered[q])), float(np.mean(inflation[q]))) for q in quantiles}


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--records", type=int, default=40)
    options.add_argument("--quantiles", type=float, nargs="*", default=[0.8, 0.85, 0.9])
    options.add_argument("--hours", type=float, default=12.0)
    options.add_argument("--seed", type=int, default=1)
    chosen = options.parse_args()
    for q, (share, excess) in coverage(
        chosen.records, chosen.quantiles, chosen.hours, chosen.seed
    ).items():
        print(f"quantile {q:.2f}: covered {100 * share:.1f} %, inflation {excess:.3f}")
