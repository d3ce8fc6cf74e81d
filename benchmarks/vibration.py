"""How well N, and a low-pass or none, is told beside several resonances of a vibration.

N is what is published: all that is white at low frequencies, which resonances add to.

    python benchmarks/vibration.py [--records 20] [--seed 1] [--quick] [--json FILE]

Five minutes at 100 Hz of white noise, a slow random walk and three to seven bands side by side,
each 0.3 to 3 times as loud as the white noise and 1 to 15 % of its frequency wide; half of the
records behind a low-pass of two poles at 15 to 35 Hz, with a thirtieth of the noise behind it.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from figures import Figure, written
from numpy.typing import NDArray
from remainder import record_of
from scipy.linalg import expm
from scipy.signal import butter, lfilter

from allanscope.analysis.coefficients import total_white
from allanscope.explain import Explanation, explain
from allanscope.noise.components import Narrowband

Array = NDArray[np.float64]
RATE, SAMPLES, N, K, LSB = 100.0, 30_000, 4e-3, 5e-5, 4.375e-3
SIGMA = N * RATE**0.5
BEHIND = 0.03
"""Noise behind the low-pass, over that before it."""


def resonance(rng: np.random.Generator, frequency: float, width: float, samples: int) -> Array:
    """Return an oscillator that noise shakes, of unit variance, exact at the samples."""
    turn = 2 * np.pi * frequency
    step = expm(np.array([[0.0, 1.0], [-(turn**2), -2 * np.pi * width]]) / RATE)
    stationary = np.diag([1.0, turn**2])
    kick = np.linalg.cholesky(stationary - step @ stationary @ step.T)
    poles, modes = np.linalg.eig(step)
    each: NDArray[Any] = np.linalg.solve(modes, kick @ rng.normal(size=(2, samples)) + 0j)
    parts = [lfilter([1], [1, -pole], x) for pole, x in zip(poles, each, strict=True)]
    return np.asarray(np.sum(modes[0][:, np.newaxis] * parts, axis=0).real)


def found_in(
    rng: np.random.Generator,
    bands: list[tuple[float, float, float]],
    cutoff: float | None,
    samples: int = SAMPLES,
) -> Explanation:
    """Return what is found beside bands of (Hz, width in Hz, rms over that of the white noise)."""
    x = rng.normal(0, SIGMA, samples) + np.cumsum(rng.normal(0, K / RATE**0.5, samples))
    for frequency, width, times in bands:
        x += times * SIGMA * resonance(rng, frequency, width, samples)
    if cutoff is not None:
        x = lfilter(*butter(2, 2 * cutoff / RATE), x) + rng.normal(0, BEHIND * SIGMA, samples)
    return explain(record_of(np.round(x / LSB) * LSB, RATE, lsb=LSB))


def white(bands: list[tuple[float, float, float]]) -> float:
    """Return N with what the bands add at 0 Hz."""
    added = (Narrowband(times * SIGMA, f, width) for f, width, times in bands)
    return float(np.sqrt(N**2 + sum(one.density(0.0, 1 / RATE) / 2 for one in added)))


def drawn(rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Draw three to seven bands side by side."""
    middle, count = rng.uniform(6, 35), rng.integers(3, 8)
    at = np.clip(middle * np.exp(rng.normal(0, 0.25, count)), 2, 45)
    width = at * np.exp(rng.uniform(np.log(0.01), np.log(0.15), count))
    times = np.exp(rng.uniform(np.log(0.3), np.log(3), count))
    return list(zip(at.tolist(), width.tolist(), times.tolist(), strict=True))


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--records", type=int, default=20, help="with a low-pass, and without")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    records = 3 if options.quick else options.records
    figures = []
    for behind in ("", " behind a low-pass"):
        off, outside, wrong, nameless = [], 0, 0, 0
        for k in range(records):
            rng = np.random.default_rng([options.seed, k])
            cutoff = rng.uniform(15, 35) if behind else None
            bands = drawn(rng)
            whole = found_in(rng, bands, cutoff)
            found, true, told = whole.axes["gx"], white(bands), total_white(whole.fits["gx"])
            low = [e.parameters["cutoff"].value for e in found.effects if e.kind == "band_limit"]
            right = [one for one in low if cutoff is not None and abs(one / cutoff - 1) < 0.1]
            wrong += len(low) != len(right) or (cutoff is not None and not right)
            nameless += any(e.kind == "unexplained" for e in found.effects)
            off.append(abs(told.value / true - 1))
            outside += not told.lower < true < told.upper
        figures += [
            Figure(f"N off by more than 3 %{behind}", sum(x > 0.03 for x in off), "records"),
            Figure(f"N off by more than 10 %{behind}", sum(x > 0.1 for x in off), "records"),
            Figure(f"N outside its interval{behind}", outside, "records"),
            Figure(f"low-pass wrong by 10 % or invented{behind}", wrong, "records"),
            Figure(f"with power without a name{behind}", nameless, "records"),
            Figure(f"records{behind}", records, ""),
        ]
    written(figures, options.json)


if __name__ == "__main__":
    main()
