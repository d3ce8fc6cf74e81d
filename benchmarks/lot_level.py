"""How often a lot without any outlier has a unit named: the promised 1 % for shapes and sizes.

    python benchmarks/lot_level.py [--lots 300] [--seed 1]

Lots are made up as the table of a fleet has them: curves whose squares are chi-square about one
true shape, with the degrees of freedom of an overlapping Allan deviation of white noise;
coefficients and slopes of the temperature with normal errors; and units that differ in N, in shape
and in slope by a normal deviation of their own. Each lot is judged as a whole, as the report judges
it; a lot counts when any unit is named for anything.
"""

from __future__ import annotations

import argparse
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.lot import TAUS, EffectColumn, Lot
from allanscope.fleet.outliers import FALSE_ALARMS
from allanscope.fleet.verdict import findings

Floats = NDArray[np.float64]

MIXES: dict[str, tuple[Floats, float]] = {
    "6 units of 10 min": (np.full(6, 600.0), 0.1),
    "12 units of 10 min": (np.full(12, 600.0), 0.1),
    "12 units of 10 min that are alike": (np.full(12, 600.0), 0.0),
    "40 units of 1 h": (np.full(40, 3600.0), 0.05),
    "10 units of 12 h, 10 of 3 min": (np.repeat([43_200.0, 180.0], 10), 0.05),
    "1 unit of 12 h, 11 of 3 min": (np.repeat([43_200.0, 180.0], [1, 11]), 0.05),
    "30 units of 1 min to 3 h": (np.geomspace(60.0, 10_800.0, 30), 0.05),
    "100 units of 20 min": (np.full(100, 1200.0), 0.02),
}
"""Durations of the runs in s, and by how much units differ (standard deviation of logarithms)."""

AXES = ("gx", "az")
RATE_HZ = 104.0


def a_lot(durations: Floats, scatter: float, rng: np.random.Generator) -> Lot:
    """Return a lot without an outlier, a run a unit."""
    rows = [axis_rows(axis, durations, scatter, rng) for axis in AXES]
    effects = [one for row in rows for one in row.pop("effects")]
    columns: dict[str, Any] = {
        name: np.concatenate([one[name] for one in rows]) for name in rows[0]
    }
    return Lot({**columns, "effects": EffectColumn.of(effects)})


def axis_rows(
    axis: str, durations: Floats, scatter: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Return the columns of one axis."""
    many = len(durations)
    names = np.array([f"{number:03d}" for number in range(many)], object)
    edf = np.maximum(durations[:, None] / TAUS * 1.5, 1.0)
    known = (TAUS >= 1.0 / RATE_HZ) & (durations[:, None] / 5.0 >= TAUS)
    tilt = scatter * rng.standard_normal(many)
    shape = TAUS**-0.5 * (1.0 + TAUS / 30.0) ** (0.5 + tilt[:, None])
    curve = shape * np.sqrt(rng.chisquare(edf) / edf)
    columns: dict[str, Any] = {
        "unit": names,
        "recording": names,
        "axis": np.full(many, axis, object),
        "sensor_unit": np.full(many, "dps" if axis.startswith("g") else "g", object),
        "curve": np.where(known, curve, np.nan).astype(np.float32),
        "curve_edf": np.where(known, edf, np.nan).astype(np.float32),
        "level_mean": rng.standard_normal(many),
        "nominal_hz": np.full(many, RATE_HZ),
        "measured_hz": RATE_HZ * (1.0 + 0.01 * rng.standard_normal(many)),
        "rate_uncertainty_ppm": np.full(many, 10.0),
    }
    for name in "NBK":
        error = np.sqrt(1.0 / durations) * (1.0 if name == "N" else 2.0)
        logs = scatter * rng.standard_normal(many) + error * rng.standard_normal(many)
        value, wide = np.exp(logs), np.exp(1.96 * error)
        columns |= {f"{name}_value": value, f"{name}_lower": value / wide}
        columns |= {f"{name}_upper": value * wide, f"{name}_detected": np.ones(many)}
    error = 0.02 * np.sqrt(600.0 / durations)
    slope = 1.0 + scatter * rng.standard_normal(many) + error * rng.standard_normal(many)
    columns["effects"] = [
        [{"kind": "temperature", "parameters": [parameter(*one)]}]
        for one in zip(slope.tolist(), error.tolist(), strict=True)
    ]
    return columns


def parameter(value: float, error: float) -> dict[str, Any]:
    """Return a slope with its interval."""
    wide = 1.96 * error
    return {
        "name": "slope", "value": value, "lower": value - wide, "upper": value + wide,
        "unit": "dps/degC", "text": None,
    }  # fmt: skip


def main() -> None:
    """Judge lots and say of how many a unit was named, and for what."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--lots", type=int, default=300, help="of each mix")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    total = wrong = 0
    for number, (mix, (durations, scatter)) in enumerate(MIXES.items()):
        rng = np.random.default_rng([options.seed, number])
        reasons: Counter[str] = Counter()
        named = 0
        for _ in range(options.lots):
            told = findings(a_lot(durations, scatter, rng))
            named += bool(told)
            reasons.update({one.quantity or one.reason.split(" is ")[0] for one in told})
        print(f"{mix:36s} {100.0 * named / options.lots:5.2f} %  {dict(reasons)}", flush=True)
        total, wrong = total + options.lots, wrong + named
    print(f"{100.0 * wrong / total:.2f} % of {total} lots ({100.0 * FALSE_ALARMS:g} % promised)")


if __name__ == "__main__":
    main()
