"""How close the coefficients come to the Cramer-Rao bound, and how often their intervals hold.

    python benchmarks/efficiency.py --records 200 --hours 1 12 [--absent 400] [--json FILE]

Records of known N, B and K (an LSM6DSL's noise at 104 Hz) pass through what a run keeps, a History
and a SpectrumBank, and are fitted. Beside it, on the same records, the recipes in common use, each
written from its published description: tangents at 1 s and 3 s, an unweighted fit of five terms to
the logarithms, and what kalibr_allan and allan_variance_ros do. The table gives the rms error over
the bound of the record's length (1.00 is the best that is possible), the bias in per cent, and the
share of 95 % intervals that hold. `--absent` counts coefficients that are found where there are
none, in records of white noise and of white noise plus flicker.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import least_squares

from allanscope.history import History
from allanscope.noise import NoiseFit, fit_noise, relative_bounds
from allanscope.noise.components import Flicker, RandomWalk, White
from allanscope.spectrum import SpectrumBank

Array = NDArray[np.float64]

RATE = 104.0
TRUTH = {"N": 4e-3, "B": 3 / 3600 / 0.664282, "K": 1e-4}
FLOOR = 2 * np.log(2) / np.pi


def simulate(n: int, rng: np.random.Generator, truth: dict[str, float]) -> Array:
    """Make white noise, flicker from exact increments, and a random walk."""
    samples = rng.standard_normal(n) * truth["N"] * np.sqrt(RATE)
    if truth["B"]:
        # Increments of flicker have the autocovariance -4 B^2 / pi / (4 k^2 - 1), put on a circle.
        half = next_fast_len(n, real=True)
        row = -4 / np.pi / (4.0 * np.arange(half + 1.0) ** 2 - 1)
        eigenvalues = np.maximum(rfft(np.concatenate([row, row[-2:0:-1]])).real, 0.0)
        noise = rng.standard_normal((2, half + 1))
        noise[0, [0, -1]] *= np.sqrt(2)
        ordinates = (noise[0] + 1j * noise[1]) * np.sqrt(eigenvalues * half)
        samples += truth["B"] * np.cumsum(irfft(ordinates, 2 * half)[:n])
    if truth["K"]:
        samples += np.cumsum(rng.standard_normal(n)) * truth["K"] / np.sqrt(RATE)
    return samples


def allanscope_fit(samples: Array) -> NoiseFit:
    """Do what a run does: the history, the streaming spectrum, the fit."""
    history, bank = History(1), SpectrumBank(RATE, 1)
    for first in range(0, len(samples), 1 << 17):
        history.update(samples[first : first + (1 << 17)])
        bank.update(samples[first : first + (1 << 17), np.newaxis])
    record = history.record(RATE, ("gx",), (1.0,))
    return fit_noise(record, "gx", bank.density(0))


def overlapping(phase: Array, m: NDArray[np.int64]) -> Array:
    """Overlapping Allan deviation; long windows move by a 64th of their length."""
    out = np.empty(len(m))
    for i, window in enumerate(m):
        step = max(1, int(window) // 64)
        d = phase[2 * window :: step] - 2 * phase[window:-window:step]
        d += phase[: -2 * window : step]
        out[i] = np.sqrt(0.5 * np.dot(d, d) / len(d)) / window
    return out


def plain(phase: Array, m: NDArray[np.int64]) -> Array:
    """Allan deviation without overlap."""
    means = [np.diff(phase[::window]) / window for window in m]
    return np.array([np.sqrt(0.5 * np.mean(np.diff(mean) ** 2)) for mean in means])


def tangents(tau: Array, dev: Array) -> list[float]:
    """Lines of slope -1/2, 0, 1/2 through the points of nearest slope (a vendor's example)."""
    slope = np.diff(np.log10(dev)) / np.diff(np.log10(tau))

    def at(wanted: float, where: float) -> float:
        i = int(np.argmin(np.abs(slope - wanted)))
        return float(dev[i] * (where / tau[i]) ** wanted)

    return [at(-0.5, 1.0), at(0.0, 1.0) / 0.664, at(0.5, 3.0)]


def unweighted(tau: Array, dev: Array) -> list[float]:
    """Five terms fitted to log deviations, every tau counting the same (imu_utils)."""
    basis = np.column_stack([3 / tau**2, 1 / tau, np.full_like(tau, FLOOR), tau / 3, tau**2 / 2])
    start = [dev[0] ** 2 * tau[0] ** 2 / 60, dev[0] ** 2 * tau[0], dev.min() ** 2 / FLOOR]
    start += [3 * dev[-1] ** 2 / tau[-1] / 2, dev[-1] ** 2 / tau[-1] ** 2 / 10]

    def residual(x: Array) -> Array:
        return np.asarray(np.log(dev**2) - np.log(basis @ np.exp(x)))

    found = least_squares(residual, np.log(start), bounds=(-80, 20), max_nfev=300).x
    return [float(np.exp(found[i] / 2)) for i in (1, 2, 3)]


def kalibr(tau: Array, dev: Array) -> list[float]:
    """Slope -1/2 up to the minimum, slope 1/2 from it on (kalibr_allan)."""
    i = int(np.argmin(dev))
    white = np.exp(np.mean(np.log(dev[: i + 1] * np.sqrt(tau[: i + 1]))))
    after = dev[i + 1 :] / np.sqrt(tau[i + 1 :] / 3)
    walk = np.exp(np.mean(np.log(after))) if len(after) else np.nan
    return [float(white), float(dev[i] / 0.664), float(walk)]


def ros(tau: Array, dev: Array) -> list[float]:
    """Slope -1/2 below 10 s, slope 1/2 through everything, B the minimum (allan_variance_ros)."""
    short = tau <= 10
    white = np.exp(np.mean(np.log(dev[short] * np.sqrt(tau[short]))))
    walk = np.exp(np.mean(np.log(dev / np.sqrt(tau / 3))))
    return [float(white), float(dev.min()), float(walk)]


def recipes(samples: Array, grids: dict[str, NDArray[np.int64]]) -> dict[str, list[float]]:
    """All recipes on one record."""
    phase = np.concatenate([[0.0], np.cumsum(samples - samples.mean())])
    log_taus, fine = grids["log"], grids["fine"]
    curve = overlapping(phase, np.union1d(log_taus, fine))
    by_m = dict(zip(np.union1d(log_taus, fine).tolist(), curve, strict=True))
    on = {name: np.array([by_m[m] for m in grids[name].tolist()]) for name in ("log", "fine")}
    return {
        "tangents at 1 s and 3 s": tangents(log_taus / RATE, on["log"]),
        "unweighted log fit, 5 terms": unweighted(log_taus / RATE, on["log"]),
        "kalibr_allan": kalibr(fine / RATE, on["fine"]),
        "allan_variance_ros": ros(grids["ros"] / RATE, plain(phase, grids["ros"])),
    }


def grids_for(n: int) -> dict[str, NDArray[np.int64]]:
    """Averaging factors of each recipe: log-spaced, to T / 2.5 for Kalibr, 0.1 s steps for ROS."""
    log_taus = np.unique(np.round(np.geomspace(1, n // 2 - 1, 100)).astype(np.int64))
    fine = np.unique(np.round(np.geomspace(1, n / 2.5, 200)).astype(np.int64))
    steps = np.unique((RATE * 0.1 * np.arange(1, 10_000)).astype(np.int64))
    return {"log": log_taus, "fine": fine, "ros": steps[steps <= n // 4]}


def study(hours: float, records: int, seed: int, compared: int) -> dict[str, Any]:
    """Monte Carlo at one length of record."""
    n = int(hours * 3600 * RATE)
    rng = np.random.default_rng([seed, n])
    model = [White(TRUTH["N"]), Flicker(TRUTH["B"]), RandomWalk(TRUTH["K"])]
    bound = np.array([relative_bounds(model, 1 / RATE, n / RATE)[name] for name in "NBK"])
    truth = np.array(list(TRUTH.values()))
    estimates: dict[str, list[Any]] = {"allanscope": []}
    inside, surplus, seconds = [], {"Q": 0, "R": 0, "band limit": 0}, 0.0
    grids = grids_for(n)
    for record in range(records):
        samples = simulate(n, rng, TRUTH)
        started = time.process_time()
        fit = allanscope_fit(samples)
        seconds += time.process_time() - started
        found = fit.coefficients
        estimates["allanscope"].append([found[name].value for name in "NBK"])
        inside.append([found[c].lower <= TRUTH[c] <= found[c].upper for c in "NBK"])
        surplus["Q"] += found["Q"].detected
        surplus["R"] += found["R"].detected
        surplus["band limit"] += fit.band_limit is not None
        if record < compared:
            for name, values in recipes(samples, grids).items():
                estimates.setdefault(name, []).append(values)
    rows = {}
    for name, values in estimates.items():
        error = np.array(values) / truth - 1
        rows[name] = {
            "records": len(values),
            "rmse_over_crlb": (np.sqrt(np.nanmean(error**2, axis=0)) / bound).tolist(),
            "bias_percent": (100 * np.nanmean(error, axis=0)).tolist(),
        }
    return {
        "hours": hours,
        "crlb_percent": (100 * bound).tolist(),
        "coverage_percent": (100 * np.mean(inside, axis=0)).tolist(),
        "detected_where_absent": surplus,
        "fit_seconds": seconds / records,
        "estimators": rows,
    }


def absent(hours: float, records: int, seed: int) -> dict[str, Any]:
    """Count what is found where there is none."""
    n = int(hours * 3600 * RATE)
    out = {}
    for title, missing in (("white noise", "BK"), ("white noise and flicker", "K")):
        rng = np.random.default_rng([seed, n, len(missing)])
        truth = {name: 0.0 if name in missing else value for name, value in TRUTH.items()}
        counts = dict.fromkeys([*missing, "Q", "R", "band limit"], 0)
        for _ in range(records):
            fit = allanscope_fit(simulate(n, rng, truth))
            for name in counts:
                found = fit.band_limit if name == "band limit" else fit.coefficients[name]
                counts[name] += found is not None and found.detected
        out[title] = {"records": records, "false": counts}
    return out


def show(result: dict[str, Any]) -> None:
    """Print the table of one study."""
    crlb = ", ".join(f"{c} {v:.3g} %" for c, v in zip("NBK", result["crlb_percent"], strict=True))
    print(f"\n{result['hours']:g} h at {RATE:g} Hz; Cramer-Rao bound {crlb}")
    print(f"{'':28s}{'records':>8s}  rmse / bound: N      B      K    bias %:  N       B       K")
    for name, row in result["estimators"].items():
        ratio = "".join(f"{v:7.2f}" for v in row["rmse_over_crlb"])
        bias = "".join(f"{v:8.2f}" for v in row["bias_percent"])
        print(f"{name:28s}{row['records']:8d}         {ratio}     {bias}")
    coverage = ", ".join(
        f"{c} {v:.1f} %" for c, v in zip("NBK", result["coverage_percent"], strict=True)
    )
    print(f"95 % intervals of allanscope hold: {coverage}")
    print(f"found where there is none: {result['detected_where_absent']}")
    print(f"history, spectrum and fit: {result['fit_seconds']:.3f} s CPU a record")


def main() -> None:
    """Run the studies and print or write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=200, help="records of each length")
    parser.add_argument("--hours", type=float, nargs="+", default=[1.0, 12.0])
    parser.add_argument("--compared", type=int, default=40, help="records given to the recipes too")
    parser.add_argument("--absent", type=int, default=0, help="records without B and K")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="20 records of 20 min")
    parser.add_argument("--json", metavar="FILE", help="write the results here too")
    options = parser.parse_args()
    if options.quick:
        options.records, options.hours, options.compared = 20, [1 / 3], 5
    studies: list[Callable[[], dict[str, Any]]] = [
        lambda h=hours: study(h, options.records, options.seed, options.compared)
        for hours in options.hours
    ]
    results: dict[str, Any] = {"studies": []}
    for run in studies:
        results["studies"].append(run())
        show(results["studies"][-1])
    if options.absent:
        results["absent"] = absent(options.hours[0], options.absent, options.seed)
        for title, row in results["absent"].items():
            print(f"\nfound in {row['records']} records of {title} alone: {row['false']}")
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump(results, file, indent=1)


if __name__ == "__main__":
    main()
