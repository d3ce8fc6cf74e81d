"""How often the limits of a deviation hold the truth: coverage of the chi-square intervals.

Power-law noise of known kind is generated again and again, each run goes through the public
`deviation` (which has to find the kind of noise by itself), and it is counted how often the 95 %
limits contain the expectation. For unbiased estimators that is the mean over all runs of the
variance itself; for the totals and bias-removed THEO1 the mean of the variance they estimate.
THEO1 and the standard deviations are held against their own mean.

    python benchmarks/interval_coverage.py --runs 2000 --samples 1024
    python benchmarks/interval_coverage.py --runs 300 --samples 8192 --stream
    python benchmarks/interval_coverage.py --alphas 0 --beside -2 --knee 16

prints, for each estimator and noise, the coverage pooled over all trusted octave taus, the lowest
single one and its tau, and how often the noise was named right. With ``--stream`` the runs go
through an `AllanBank`, whose terms are thinned at long tau.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank, deviation
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.noise_type import NAMES

TARGET = {
    "totdev": "oadev",
    "theobr": "oadev",
    "theoh": "oadev",
    "mtotdev": "mdev",
    "ttotdev": "tdev",
    "htotdev": "ohdev",
}
"""Estimator whose expectation another one estimates with less scatter."""


def power_law(alpha: int, samples: int, runs: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return Gaussian noise with S(f) ~ |2 sin(pi f)|^alpha, shape (runs, samples)."""
    # The first half is thrown away: it still remembers that there was nothing before it.
    k = np.arange(1, 2 * samples)
    response = np.append(1.0, np.cumprod((k - 1 - alpha / 2) / k))
    length = 4 * samples
    white = np.fft.rfft(rng.standard_normal((runs, 2 * samples)), length, axis=1)
    noise = np.fft.irfft(white * np.fft.rfft(response, length), length, axis=1)
    return noise[:, samples : 2 * samples]


def truth(kind: str, tau: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean variance at each tau; NaN where tau is no whole number of samples."""
    target = REGISTRY[TARGET.get(kind, kind)]
    phases = [np.append(0.0, np.cumsum(run)) for run in noise]
    result = np.full(tau.size, np.nan)
    for i, samples in enumerate(tau.tolist()):
        m = round(samples / target.tau_factor)
        if abs(m * target.tau_factor - samples) < 1e-9:
            result[i] = np.mean([target.exact(phase, m)[0] for phase in phases])
    return result


def coverage(
    kind: str, noise: NDArray[np.float64], alpha: int, *, stream: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return trusted taus, the coverage at each of them, and how often alpha was found."""
    if stream:
        bank = AllanBank(1.0, axes=len(noise), per_octave=1)
        bank.update(noise.T)
        curve = bank.deviation(kind)
        tau, trusted = curve.tau, curve.trusted
        lower, upper, names = curve.lower, curve.upper, curve.noise
    else:
        curves = [deviation(run, 1.0, kind) for run in noise]
        tau, trusted = curves[0].tau, curves[0].trusted
        lower, upper = np.array([c.lower for c in curves]), np.array([c.upper for c in curves])
        names = np.array([c.noise for c in curves])
    expected = np.where(trusted, np.sqrt(truth(kind, tau, noise)), np.nan)
    known = np.isfinite(expected)
    held = (lower[:, known] <= expected[known]) & (expected[known] <= upper[:, known])
    return tau[known], held.mean(axis=0), float(np.mean(names[:, known] == NAMES[alpha]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--seed", type=int, default=20)
    parser.add_argument("--kinds", nargs="*", default=list(REGISTRY))
    parser.add_argument("--alphas", nargs="*", type=int, default=[2, 1, 0, -1, -2])
    parser.add_argument("--beside", type=int, help="alpha of a second noise")
    parser.add_argument("--knee", type=int, default=16, help="where it meets the first: n / tau")
    parser.add_argument("--stream", action="store_true", help="through a bank")
    parser.add_argument("--cells", action="store_true", help="print the coverage at every tau")
    options = parser.parse_args()
    print(f"{'':8} {'noise':5} {'coverage':>8} {'lowest':>7} {'at tau':>9} {'named right':>11}")
    for kind in options.kinds:
        for alpha in options.alphas:
            rng = np.random.default_rng(options.seed)
            noise = power_law(alpha, options.samples, options.runs, rng)
            if options.beside is not None:
                second = power_law(options.beside, options.samples, options.runs, rng)
                tau = np.array([float(options.samples // options.knee)])
                level = [truth("oadev", tau, one) for one in (noise, second)]
                noise = noise + second * np.sqrt(level[0] / level[1])
            tau, held, right = coverage(kind, noise, alpha, stream=options.stream)
            print(
                f"{kind:8} {NAMES[alpha]:5} {held.mean():8.3f} {held.min():7.3f}"
                f" {tau[held.argmin()]:9g} {right:11.3f}",
                flush=True,
            )
            if options.cells:
                cells = zip(tau.tolist(), (100 * held).tolist(), strict=True)
                print("        ", " ".join(f"{at:g}: {part:.1f}" for at, part in cells), flush=True)


if __name__ == "__main__":
    main()
