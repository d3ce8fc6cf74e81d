"""How often the advised experiment settles what was open, within 1.5 times its predicted time.

    python benchmarks/next_experiment.py --records 20

The simulator does what the result advises: records for longer until a coefficient that was not
detected is, or has a limit below what was expected; goes to another rate for a line without a
source; switches the part on again after a warm-up that was seen once or that a drift may imitate;
turns the board by hand where noise does not tell which axis leaks. Records are of one or two
gyroscope axes at 10 Hz, of the line at 104 Hz.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from figures import Figure
from lines import RecordedLines, lines_in_both, record, truth

from allanscope import analyse
from allanscope.analysis.line_origin import origin_of
from allanscope.labels import kind_name
from allanscope.parts import PARTS
from allanscope.simulator import AxisTruth, Simulator, Truth

RATE = 10.0
LATE = 1.5
N = 3e-3


def run(axes: dict[str, AxisTruth], effects: list[str], seconds: float, seed: int, again: int):
    """Return the result of a run of one specimen."""
    wanted = Truth(axes).with_effects(["clock_error:relative=0", *effects])
    sensor = Simulator(
        rate=RATE, seed=seed, truth=wanted, axes=tuple(axes), run=again, duration_s=seconds
    )
    block = sensor.read(int(seconds * RATE))
    scale = dict(zip(sensor.info.axes, sensor.info.scale, strict=True))
    columns = {f"{k}[dps]": block.counts[:, i] * scale[k] for i, k in enumerate(sensor.info.axes)}
    return analyse(columns, rate=RATE)


def coefficient(seed: int, letter: str) -> Iterator[bool]:
    """Yield whether a coefficient is detected, or excluded from where it was expected."""
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(-1.6, -0.6)
    noise = {"K": {"K": N * size / 3}, "B": {"B": N * size}}[letter]
    axes = {"gx": AxisTruth(N=N, **noise)}
    first = run(axes, [], 600.0, seed, 0)
    for one in first.experiments:
        if one.question.startswith(f"{letter} of gx"):
            known = first.axes["gx"].coefficients[letter]
            expected = np.sqrt(known.value * known.upper)
            longer = run(axes, [], min(LATE * one.duration_s, 2e5), seed, 1)
            found = longer.axes["gx"].coefficients[letter]
            yield found.detected or found.upper < expected


def line(seed: int) -> Iterator[bool]:
    """Yield whether another rate tells the source and the frequency of a line."""
    rng = np.random.default_rng(seed)
    f = rng.uniform(6.0, 46.0)
    alias = rng.integers(1, 6) * 104.0 + rng.choice([-1, 1]) * f
    is_internal = seed % 3 == 0
    true_hz = f if is_internal else alias
    seen = []
    advised = None
    for number in (0, 1):
        rate = 104.0 if advised is None else advised.rate_hz
        at = true_hz * rate / 104.0 if is_internal else true_hz
        sensor = Simulator(
            rate=rate, seed=seed, run=number, truth=truth(at, 0.0, is_internal, 0.0), axes=("gx",)
        )
        values, clock, where = record(sensor)
        seen.append(RecordedLines(clock.rate().hz, clock.rate().uncertainty_ppm or 0.0, [where]))
        if advised is None:
            numbers = np.arange(len(values), dtype=float)
            offered = PARTS["LSM6DSM"].rates_hz
            told = origin_of(values, numbers, clock.rate().hz, where, offered_hz=offered)
            advised = told.experiment
            if advised is None:
                return
    found = lines_in_both(*seen)
    right = bool(found) and found[0].source == ("internal" if is_internal else "external")
    frequency = found[0].frequency_hz if found else None
    yield right and (is_internal or (frequency is not None and abs(frequency / true_hz - 1) < 3e-4))


def warm_up(seed: int) -> Iterator[bool]:
    """Yield whether a second warm-up shows the same again, or a drift does not come back."""
    rng = np.random.default_rng(seed)
    tau = rng.uniform(60.0, 200.0)
    size = N * 10 ** rng.uniform(0.2, 0.8)
    effects = [f"warm_up:amplitude={size},time_constant={tau}"]
    axes = {"gx": AxisTruth(N=N, K=N / 300)}
    first = run(axes, effects, 1200.0, seed, 0)
    for one in first.experiments:
        if kind_name("warm_up") in one.question:
            again = run(axes, effects, LATE * one.duration_s, seed, 1)
            kinds = {e.kind for e in again.axes["gx"].explanation.effects}
            yield bool(kinds & {"warm_up", "temperature"})


def leak(seed: int) -> Iterator[bool]:
    """Yield whether a turn of the board tells which axis leaks."""
    rng = np.random.default_rng(seed)
    slope = rng.uniform(0.2, 0.6)
    axes = {"gx": AxisTruth(N=N), "gy": AxisTruth(N=N * np.sqrt(1 - slope**2))}
    effects = [f"cross_coupling:source=gx,slope={slope},axis=gy"]
    first = run(axes, effects, 1200.0, seed, 0)
    for one in first.experiments:
        if "couples into" in one.question:
            source = one.question.split()[2]
            turned = 30.0 * np.sin(np.arange(600) / RATE)
            # The axis that is turned shows it, and takes the other along if it is the source.
            follows = slope * turned if source == "gx" else 0.0 * turned
            rest = N * np.sqrt(RATE / 2) * rng.standard_normal(600)
            seen = follows + rest
            gain = (turned @ seen) ** 2 / (turned @ turned) / (2 * rest.var())
            yield (gain > 10.0) == (source == "gx")


WAYS: dict[str, Callable[[int], Iterator[bool]]] = {
    "K not detected": lambda seed: coefficient(seed, "K"),
    "B not detected": lambda seed: coefficient(seed, "B"),
    "line without a source": line,
    "warm-up seen once": warm_up,
    "coupling without a direction": leak,
}


def main() -> None:
    """Print a table and write the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--records", type=int, default=20)
    options.add_argument("--only", default="")
    options.add_argument("--quick", action="store_true")
    options.add_argument("--json")
    chosen = options.parse_args()
    count = 3 if chosen.quick else chosen.records
    figures, total = [], []
    for way, settled in WAYS.items():
        if chosen.only not in way:
            continue
        told = [one for seed in range(count) for one in settled(seed)]
        total += told
        share = 100 * float(np.mean(told)) if told else 0.0  # no advice settles nothing
        print(f"{way:30} settled {share:5.1f} % of {len(told)} (of {count} records)", flush=True)
        figures.append(Figure(f"{way}: settled", share, "%", goal=80.0, more=True))
    print(f"all{'':27} settled {100 * float(np.mean(total)):5.1f} % of {len(total)}")
    figures.append(Figure("settled", 100 * float(np.mean(total)), "%", goal=80.0, more=True))
    if chosen.json:
        content = {"figures": [asdict(one) for one in figures]}
        Path(chosen.json).write_text(json.dumps(content, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
