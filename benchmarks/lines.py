"""How often the source and the true frequency of a line are told, and told right.

    python benchmarks/lines.py --records 100

Simulated sensors with one line each: of their own clock, from outside below the Nyquist frequency,
and beyond it, up to six times the sample rate. One record of a clock that drifts by 30 ppm in ten
minutes; the same board at another rate; two boards whose rates are off by up to 4 %. The line is
found as the highest peak of the spectrum.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from figures import Figure

from allanscope.analysis.line_origin import clock_wander_of, origin_of
from allanscope.analysis.shared_lines import RecordedLines, lines_in_both
from allanscope.clock import Clock
from allanscope.simulator import AxisTruth, Simulator, Truth

RATE = 104.0
HIGH_RATE = 1660.0
MINUTES = 10.0
KINDS = ("internal", "direct", "alias")
CRYSTAL_PPM = 40.0


def truth(true_hz: float, ppm: float, locked: bool, error: float) -> Truth:
    """Return a gyroscope axis with a line, and a clock that drifts by `ppm` in the record."""
    effects = [
        f"clock_error:relative={error},drift={60 * ppm / MINUTES}",
        f"sinusoid:frequency={true_hz},amplitude=0.02,locked={int(locked)}",
    ]
    return Truth({"gx": AxisTruth(N=2.7e-3, B=1e-3, K=1e-4)}).with_effects(effects)


def record(sensor: Simulator) -> tuple[np.ndarray, Clock, tuple[float, float, float]]:
    """Return ten minutes of a sensor: samples, its clock, and the highest peak with its error."""
    block = sensor.read(int(60 * MINUTES * sensor.info.nominal_hz))
    clock = Clock.of(sensor.info)
    clock.update(0, block.ticks)
    values = block.counts.astype(float)
    n = len(values)
    spectrum = np.abs(np.fft.rfft(values[:, 0] - values.mean(), 8 * n)) ** 2
    frequency = np.fft.rfftfreq(8 * n, 1 / clock.rate().hz)
    spectrum[frequency < 1] = 0
    seen = float(frequency[np.argmax(spectrum)])
    half = 0.2 / (60 * MINUTES)
    return values, clock, (seen, seen - half, seen + half)


def drawn(seed: int) -> tuple[str, float]:
    """Return the kind of a line and its true frequency."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % 3]
    f = rng.uniform(6.0, 46.0)
    return kind, (rng.integers(1, 6) * RATE + rng.choice([-1, 1]) * f if kind == "alias" else f)


def one_record(seed: int, ppm: float) -> tuple[str, str, bool]:
    """Return the kind, the source that was told, and whether the true frequency is right."""
    kind, true_hz = drawn(seed)
    error = np.random.default_rng(seed + 10_000).uniform(-0.04, 0.04)
    sensor = Simulator(
        rate=RATE, seed=seed, truth=truth(true_hz, ppm, kind == "internal", error), axes=("gx",)
    )
    values, clock, line = record(sensor)
    rate = clock.rate()
    found = origin_of(
        values,
        np.arange(len(values), dtype=float),
        rate.hz,
        line,
        clock_wander_of(clock.arrivals()),
        rate_ppm=rate.uncertainty_ppm,
    )
    return kind, found.source, _right(found.frequency_hz, true_hz)


def two_records(seed: int, boards: bool) -> tuple[str, str, bool]:
    """Return the same of two boards, or of one board at two rates."""
    kind, true_hz = drawn(seed)
    rng = np.random.default_rng(seed + 20_000)
    errors = rng.uniform(-0.04, 0.04, 2)
    seen = []
    for number in (0, 1):
        rate = RATE if boards or number == 0 else HIGH_RATE
        error = errors[number if boards else 0]
        # A line of the clock is at the same fraction of every rate.
        at = true_hz * rate / RATE * (1 + error) if kind == "internal" else true_hz
        sensor = Simulator(
            rate=rate,
            seed=seed + 1000 * number * boards,
            run=number,
            truth=truth(at, 0.0, kind == "internal", error),
            axes=("gx",),
        )
        _, clock, line = record(sensor)
        ppm = max(clock.rate().uncertainty_ppm or 0.0, CRYSTAL_PPM if boards else 0.0)
        seen.append(RecordedLines(clock.rate().hz, ppm, [line]))
    found = lines_in_both(*seen)
    if not found:
        return kind, "unknown", False
    return kind, found[0].source, _right(found[0].frequency_hz, true_hz)


def _right(found: float | None, true_hz: float) -> bool:
    return found is not None and abs(found / true_hz - 1) < 3e-4


def main() -> None:
    """Print a table and write the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--records", type=int, default=99)
    options.add_argument("--quick", action="store_true")
    options.add_argument("--json")
    chosen = options.parse_args()
    count = 12 if chosen.quick else chosen.records
    ways = {
        "one record, 30 ppm": lambda seed: one_record(seed, 30.0),
        "one board at 104 and 1660 Hz": lambda seed: two_records(seed, False),
        "two boards": lambda seed: two_records(seed, True),
    }
    figures = []
    for way, run in ways.items():
        told = [run(seed) for seed in range(count)]
        wanted = {"internal": "internal", "direct": "external", "alias": "external"}
        source = [found == wanted[kind] for kind, found, _ in told]
        wrong = [found not in (wanted[kind], "unknown") for kind, found, _ in told]
        true = [right for kind, _, right in told if kind != "internal"]
        shares = [100 * float(np.mean(one)) for one in (source, wrong, true)]
        print(
            f"{way:28} source right {shares[0]:5.1f} %  wrong {shares[1]:4.1f} %  "
            f"true frequency right {shares[2]:5.1f} %  ({count} records)"
        )
        figures += [
            Figure(f"{way}: source right", shares[0], "%"),
            Figure(f"{way}: source wrong", shares[1], "%"),
            Figure(f"{way}: true frequency right", shares[2], "%"),
        ]
    if chosen.json:
        content = {"figures": [asdict(one) for one in figures]}
        Path(chosen.json).write_text(json.dumps(content, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
