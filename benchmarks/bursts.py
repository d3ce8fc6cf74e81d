"""How well N and the lines are told on a bench where somebody walks and machines run now and then.

    python benchmarks/bursts.py [--records 30] [--seed 1] [--quick] [--json FILE]

5 to 20 minutes at 104 Hz of white noise. In one or two ranges of frequencies 2 to 25 bursts of
vibration, up to some 20 times as loud as the white noise there; up to two lines that are on for a
while, of 0.05 to 2.5 times its rms, which stay where they are or wander; a step and a random walk
in about half of the records. An axis that fails counts as N that is off.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from figures import Figure, written
from numpy.typing import NDArray
from remainder import record_of
from scipy.signal import butter, sosfilt

from allanscope.explain import AxisExplanation, explain

Array = NDArray[np.float64]
RATE, N, K, LSB = 104.0, 4e-3, 3e-4, 4.375e-3
SIGMA = N * RATE**0.5
LOUD = 0.3
"""Rms of a line over that of the white noise from which it is asked for by name."""
NEAR_HZ = 0.5
"""Distance within which a line that was found is one that is there."""


def bursts(rng: np.random.Generator, t: Array) -> Array:
    """Draw bursts of noise in one range of frequencies."""
    low = rng.uniform(3, 40)
    high = low * rng.uniform(1.15, 2.5)
    edges, kind = (low, "high") if high >= 50 else ([low, high], "band")
    sos = butter(2, edges, kind, fs=RATE, output="sos")
    loud = np.full(len(t), rng.choice([0.0, 0.1, 0.3]))
    number, seconds = int(rng.integers(2, 25)), rng.uniform(0.3, 8)
    for at in rng.uniform(0, t[-1], number):
        loud += rng.uniform(1, 10) * np.exp(-(((t - at) / seconds) ** 2))
    return np.asarray(rng.uniform(0.3, 1.5) * loud * sosfilt(sos, rng.normal(0, SIGMA, len(t))))


def line(rng: np.random.Generator, t: Array) -> tuple[Array, float, float]:
    """Draw a line that is on for a while, with its frequency and its rms over that of the noise."""
    hz, peak = rng.uniform(2, 50), rng.uniform(0.05, 2.5)
    lasts = rng.uniform(0.1, 1) * t[-1]
    begins = rng.uniform(0, t[-1] - 0.99 * lasts)
    wander = np.cumsum(rng.normal(0, rng.choice([0.0, 1e-3, 1e-2]), len(t))) / RATE**0.5
    on = (t > begins) & (t < begins + lasts)
    wave = peak * SIGMA * on * np.sin(2 * np.pi * np.cumsum(hz + wander) / RATE)
    return wave, hz, float(np.sqrt(np.mean(wave**2))) / SIGMA


def bench(rng: np.random.Generator) -> tuple[Array, list[float]]:
    """Draw a record, with the frequencies of its loud lines."""
    t = np.arange(int(rng.choice([300, 600, 1200]) * RATE)) / RATE
    x = rng.normal(0, SIGMA, len(t))
    for _ in range(rng.integers(1, 3)):
        x += bursts(rng, t)
    lines = [line(rng, t) for _ in range(rng.integers(0, 3))]
    x += sum(wave for wave, _, _ in lines)
    if rng.random() < 0.4:
        x += SIGMA * rng.uniform(0.1, 1) * (t > rng.uniform(0, t[-1]))
    if rng.random() < 0.5:
        x += np.cumsum(rng.normal(0, K / RATE**0.5, len(t)))
    return x, [hz for _, hz, rms in lines if rms > LOUD]


def found_in(x: Array) -> AxisExplanation:
    """Return what is found in the samples of one axis."""
    return explain(record_of(np.round(x / LSB) * LSB, RATE, lsb=LSB)).axes["gx"]


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--records", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    records = 3 if options.quick else options.records
    off, failed, larger, asked, named = list[float](), 0, 0, 0, 0
    for k in range(records):
        x, lines = bench(np.random.default_rng([options.seed, k]))
        found = found_in(x)
        failed += bool(found.failure)
        told = found.coefficients_after.get("N")
        off.append(abs(told.value / N - 1) if told is not None else np.inf)
        larger += not found.after.chi2_per_dof <= found.before.chi2_per_dof
        at = [e.parameters["frequency"].value for e in found.effects if "frequency" in e.parameters]
        asked += len(lines)
        named += sum(any(abs(hz - one) < NEAR_HZ for one in at) for hz in lines)
    written(
        [
            Figure("N off by more than 3 %", sum(one > 0.03 for one in off), "records"),
            Figure("N off by more than 10 %", sum(one > 0.1 for one in off), "records"),
            Figure("axis failed", failed, "records"),
            Figure("chi-square larger after", larger, "records"),
            Figure("loud lines", asked, ""),
            Figure("of these named", named, ""),
            Figure("records", records, ""),
        ],
        options.json,
    )


if __name__ == "__main__":
    main()
