"""How often the intervals of each board's own noise cover it while the bench moves all boards.

    python benchmarks/together.py --benches 60

Three to eight boards on one bench, each at a rate of its own within 4 %, with a clock that is off
by 20 ppm, a gain that is off by 2 %, and a start of its own within 10 s. The bench moves with a
density that is flat up to a corner of 0.5, 3 or 10 Hz; the noise of each board is white with a
random walk. The motion is drawn at 2 kHz and averaged over the samples of each board.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from figures import Figure

from allanscope.analysis import aligned, separated

FINE_HZ = 2080.0
RATE = 104.0
WALK = 3e-3


def bench(seed: int, boards: int, seconds: float, corner_hz: float, ratio: float = 10.0):
    """Return records of boards with white noise of unit variance, and their measured rates.

    `ratio` is that of the rms of the motion to that of the noise in a sample.
    """
    rng = np.random.default_rng(seed)
    n = int((seconds + 12) * FINE_HZ)
    f = np.fft.rfftfreq(n, 1 / FINE_HZ)
    motion = np.fft.rfft(rng.normal(size=n)) / np.sqrt(1 + (f / corner_hz) ** 4)
    wave = np.fft.irfft(motion, n)
    angle = np.concatenate([[0.0], np.cumsum(ratio * wave / wave.std())]) / FINE_HZ
    records, rates = [], []
    for _ in range(boards):
        rate = RATE * (1 + rng.uniform(-0.04, 0.04))
        m = int(seconds * rate)
        ends = rng.uniform(0, 10) + np.arange(m + 1) / rate
        moved = np.diff(np.interp(ends, np.arange(n + 1) / FINE_HZ, angle)) * rate
        noise = rng.normal(size=m) + WALK * np.cumsum(rng.normal(size=m))
        records.append(((1 + 0.02 * rng.normal()) * moved + noise)[:, None])
        rates.append(rate * (1 + 20e-6 * rng.normal()))
    return records, rates


def truth(tau: np.ndarray, rate: float) -> np.ndarray:
    """Return the Allan deviation of the noise of a board."""
    m = tau * rate
    return np.sqrt(1 / m + WALK**2 * (2 * m**2 + 1) / (6 * m))


def main() -> None:
    """Print a table and write the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--benches", type=int, default=60)
    options.add_argument("--seconds", type=float, default=300.0)
    options.add_argument("--quick", action="store_true")
    options.add_argument("--json")
    chosen = options.parse_args()
    figures, every = [], []
    for boards in (3, 4, 8):
        for corner in (0.5, 3.0, 10.0):
            covered, larger = [], []
            for seed in range(4 if chosen.quick else chosen.benches):
                records, rates = bench(seed, boards, chosen.seconds, corner)
                clock = aligned(records, rates)
                found = separated(clock.values[:, :, 0], clock.rate_hz)
                for one, rate in zip(found.own, rates, strict=True):
                    true = truth(found.tau, rate)
                    covered.append((one.lower <= true) & (true <= one.upper))
                    larger.append(one.measured / true)
            every += covered
            share = 100 * float(np.mean(covered))
            each = 100 * np.mean(covered, axis=0)
            print(
                f"{boards} boards, motion to {corner:4.1f} Hz, {np.median(larger):5.1f} times the "
                f"noise: covered {share:5.1f} %, at each tau {each.min():5.1f} to {each.max():5.1f}"
            )
            figures.append(Figure(f"{boards} boards, {corner:g} Hz: covered", share, "%"))
    print(f"all: {100 * float(np.mean(every)):.1f} % of {np.size(every)}")
    figures.append(Figure("covered", 100 * float(np.mean(every)), "%"))
    if chosen.json:
        content = {"figures": [asdict(one) for one in figures]}
        Path(chosen.json).write_text(json.dumps(content, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
