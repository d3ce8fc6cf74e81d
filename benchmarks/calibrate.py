"""Calibration of the penalties: what each kind of effect gains by chance where there is none.

    python benchmarks/calibrate.py [--records 50] [--seed 1] [--keep FOLDER] [--write]
                                   [--json FILE] [--quick]

Every record has three axes of noise without any effect: white noise, with flicker, with a random
walk, and with both, in `SHAPES` of length and rate, a new one of each for every count in
``--records``. Every kind proposes on every axis of the untouched model, with the false-alarm
probability of its penalty put to 1, so that what it gains by chance is seen; a candidate that gains
more than that is asked for again with the penalty as it is. Counted is what would be accepted on
the penalty alone: the gates behind it (held-out data, replication) refuse most of that.

With ``--keep`` the outcome of every record is kept in a file of its own: a run can be interrupted
and continued, and several can share the work by ``--first``; what was kept is counted.
``--write`` puts the counts into the package, beside the penalties, which it leaves as they are.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
from blind_generator import draw_temperature
from blind_noise import base_noise, draw_noise
from figures import Figure, written

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effects import KINDS
from allanscope.explain.series import series_of
from allanscope.explain.view import Clock, View
from allanscope.history import Record

AXES = ("gx", "gy", "ax")
SHAPES = ((1200.0, 26.0), (1200.0, 104.0), (7200.0, 26.0), (2400.0, 104.0))
"""Length in s and samples per second."""
MIXES = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
"""Whether there is flicker, and a random walk, beside the white noise."""
TABLE = Path(__file__).parent.parent / "src/allanscope/noise/calibration.toml"
CLOCK_ERROR = 15e-6
LEAST_PENALTY = -math.log(ALPHA)

Chance = tuple[float, bool]
"""Largest gain in nats, and whether it is accepted on its penalty alone."""


def null_record(seed: int, seconds: float, rate: float, mix: tuple[float, float]) -> Record:
    """Return a record without an effect."""
    rng = np.random.default_rng([seed, int(seconds), int(rate), *map(int, mix)])
    n = int(seconds * rate)
    noises = [draw_noise(rng, axis) for axis in AXES]
    noises = [replace(noise, b=noise.b * mix[0], k=noise.k * mix[1]) for noise in noises]
    lsb = np.array([noise.lsb for noise in noises])
    table = np.column_stack([base_noise(rng, noise, n, rate) + noise.offset for noise in noises])
    return Record(
        rate_hz=rate,
        stride=1,
        axes=AXES,
        values=np.round(table / lsb) * lsb,
        lsb=tuple(lsb.tolist()),
        temperature_c=draw_temperature(rng, n, rate)[1],
        start_s=np.arange(n) / rate,
        segments=np.array([[0, n]], np.int64),
    )


def views(record: Record, seed: int) -> Iterator[View]:
    """Yield every axis before anything was accepted."""
    series = series_of(record)
    measured = record.rate_hz * (1 + CLOCK_ERROR * np.random.default_rng([seed, 3]).normal())
    clock = Clock(record.rate_hz, measured, record.rate_hz * CLOCK_ERROR)
    for column, axis in enumerate(series.axes):
        data = np.ascontiguousarray(series.values[:, column])
        yield View(series, series.grid, axis, data, series.lsb[column], clock=clock)


@contextmanager
def without_penalties() -> Iterator[None]:
    """Put the false-alarm probability of every penalty to 1, and what has no other to 0."""
    kept: list[tuple[ModuleType, str, float]] = []
    for name, module in list(sys.modules.items()):
        if name.startswith("allanscope.explain"):
            for constant, value in (("ALPHA", 1.0), ("DRIFT_PENALTY", 0.0)):
                if hasattr(module, constant):
                    kept.append((module, constant, getattr(module, constant)))
                    setattr(module, constant, value)
    try:
        yield
    finally:
        for module, constant, value in kept:
            setattr(module, constant, value)


def word(candidate: Candidate) -> str:
    """Return what a candidate is counted as."""
    return "drift" if candidate.effect.is_unnamed_drift else candidate.kind


def chances(view: View) -> dict[str, Chance]:
    """Return what each kind gains by chance, and whether that is more than its penalty."""
    none = (0.0, False)
    found: dict[str, Chance] = {"drift": none}
    for name, kind in KINDS.items():
        if not kind.available(view):
            continue
        found[name] = none
        with without_penalties():
            free = list(kind.propose(view))
        for candidate in free:
            gain, _ = found[word(candidate)]
            found[word(candidate)] = max(gain, float(candidate.gain)), False
        if any(candidate.gain > LEAST_PENALTY for candidate in free):
            for candidate in kind.propose(view):
                if candidate.excess > 0:
                    found[word(candidate)] = max(found[word(candidate)][0], candidate.gain), True
    return found


def outcomes(
    number: int, seconds: float, rate: float, keep: Path | None
) -> list[dict[str, Chance]]:
    """Return the chances of every axis of one record, kept or new."""
    path = keep / f"{number}-{seconds:g}s-{rate:g}Hz.json" if keep else None
    if path and path.exists():
        return list(json.loads(path.read_text(encoding="utf-8")))
    mix = MIXES[(number + SHAPES.index((seconds, rate))) % len(MIXES)]
    found = [chances(view) for view in views(null_record(number, seconds, rate, mix), number)]
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(found), encoding="utf-8")
    return found


def rows(axes: list[dict[str, Chance]]) -> dict[str, dict[str, float]]:
    """Return one row a kind."""
    table = {}
    for kind in sorted({kind for axis in axes for kind in axis}):
        asked = [axis[kind] for axis in axes if kind in axis]
        gains = np.array([gain for gain, _ in asked])
        table[kind] = {
            "axes": len(asked),
            "false_alarms": sum(accepted for _, accepted in asked),
            "gain_of_1_in_100": round(float(np.quantile(gains, 0.99, method="lower")), 1),
            "largest_gain": round(float(gains.max()), 1),
        }
    return table


def written_table(counts: dict[str, dict[str, float]], head: str) -> str:
    """Return the table of the package with other counts."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    lines = [head.rstrip()]
    for kind, row in table.items():
        lines += ["", f"[{kind}]"]
        for key, value in (row | counts.get(kind, {})).items():
            lines.append(f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--records", type=int, default=50, help="of each length and rate")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    parser.add_argument("--write", action="store_true", help="put the counts into the package")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--quick", action="store_true", help="one record of each length and rate")
    arguments = parser.parse_args()
    records = 1 if arguments.quick else arguments.records
    numbers = range(arguments.first, arguments.first + records)
    began = time.process_time()
    axes = [
        axis
        for number in numbers
        for seconds, rate in SHAPES
        for axis in outcomes(1000 * arguments.seed + number, seconds, rate, arguments.keep)
    ]
    counts = rows(axes)
    for kind, row in counts.items():
        print(f"{kind:20} {row}")
    print(f"{len(axes)} axes, {time.process_time() - began:.0f} s of processor time")
    if arguments.write:
        head = TABLE.read_text(encoding="utf-8").partition("\n\n")[0]
        TABLE.write_text(written_table(counts, head), encoding="utf-8")
    if arguments.json:
        alarms = sum(row["false_alarms"] for row in counts.values())
        rate = 1000 * alarms / len(axes)
        figures = [Figure("effects by chance, before the gates", rate, "a 1000 axes")]
        written(figures, arguments.json, counts=counts)


if __name__ == "__main__":
    main()
