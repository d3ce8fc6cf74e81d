"""Streams whose rate, or the moment of an event in them, is known, for `rank_calibration.py`.

The clock sees the arrivals of frames at a host that polls; the watch sees counts of one axis in
which something begins, with a size from what it just sees to what is plain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from blind_noise import Array

from allanscope.clock import Clock
from allanscope.quantities import TWO_SIDED_95
from allanscope.samples import Gap, StreamInfo, Ticks
from allanscope.watch import Event, Watch

RATE, BEFORE, AFTER = 52.0, 240, 120
"""Samples a second; seconds before and after an onset."""
BLOCK_S = 1.0
"""What the watch looks at: within one an onset is anywhere."""
SIGMA = 20.0
"""Counts of noise."""
ONSETS = (
    *("step", "ramp", "variance_change", "sinusoid"),
    *("outliers", "repeated_samples", "lost_samples", "rate_change"),
)


def rate(rng: np.random.Generator) -> tuple[float, tuple[float, float, float]]:
    """Return the true rate of a stream, and what a clock says of it: the rate and its limits."""
    true = 104.0 * (1 + rng.normal(0, 0.02))
    seconds = float(np.exp(rng.uniform(np.log(30.0), np.log(900.0))))
    clock = Clock(nominal_hz=104.0, device_clock=False)
    frame = int(rng.integers(1, 9))
    number = np.arange(0, int(true * seconds), frame)
    sent = number / true + rng.uniform(0, 1)
    delay = rng.exponential(float(np.exp(rng.uniform(np.log(1e-4), np.log(3e-3)))), len(number))
    arrived = np.maximum.accumulate(sent + delay)
    poll = float(np.exp(rng.uniform(np.log(1e-3), np.log(0.05))))  # a frame of USB, a slow reader
    arrived = np.ceil(arrived / poll) * poll + rng.exponential(1e-4, len(number))
    arrived = np.maximum.accumulate(arrived)
    unknown = np.full(len(number), np.nan)
    clock.update(0, Ticks(number, unknown, arrived, unknown))
    found = clock.rate()
    error = TWO_SIDED_95 * found.hz * found.uncertainty_ppm * 1e-6
    return true, (found.hz, found.hz - error, found.hz + error)


@dataclass(frozen=True)
class Begun:
    """When something began in a stream, at which frequency if it is a line, and what was told."""

    at_s: float
    frequency_hz: float
    events: tuple[Event, ...]


def onset(kind: str, rng: np.random.Generator) -> Begun:
    """Let something begin in a stream, and watch it.

    What is counted has begun before the first one is seen.
    """
    n = int(RATE * (BEFORE + AFTER))
    at = BEFORE + rng.uniform(0.0, 20.0)
    t = np.arange(n) / RATE
    size = float(np.exp(rng.uniform(0.0, np.log(6.0))))
    rows = SIGMA * rng.standard_normal(n)
    after = t >= at
    frequency = float(rng.uniform(3.0, 22.0))
    if kind == "step":
        rows += 0.15 * size * SIGMA * after
    elif kind == "ramp":
        rows += 0.01 * size * SIGMA * np.maximum(t - at, 0.0)
    elif kind == "variance_change":
        rows[after] *= 1 + 0.12 * size
    elif kind == "sinusoid":
        phase = 2 * np.pi * (frequency * t + rng.random())
        rows += 0.25 * size * SIGMA * np.sin(phase) * after
    elif kind == "outliers":
        rows += 12 * SIGMA * (after & (rng.random(n) < 0.004 * size)) * rng.choice([-1, 1], n)
    counts = np.rint(rows).astype(np.int16)
    if kind == "repeated_samples":
        again = after & (rng.random(n) < 0.02 * size)
        counts = counts[np.maximum.accumulate(np.where(again, 0, np.arange(n)))]
    return Begun(at, frequency, _watched(kind, counts, at, size, rng))


def _watched(
    kind: str, counts: Array, at: float, size: float, rng: np.random.Generator
) -> tuple[Event, ...]:
    """Return the events."""
    info = StreamInfo(axes=("gx",), scale=(1e-3,), nominal_hz=RATE)
    watch = Watch(info)
    frame = 13
    drift = 2e-3 * size * (kind == "rate_change")
    for first in range(0, len(counts), frame):
        time_s = (first + frame - 1) / RATE
        time_s += drift * max(time_s - at, 0.0) + 2e-5 * rng.standard_normal()
        offset = np.array([frame - 1])
        watch.ticks(
            first, Ticks(offset, np.array([time_s]), np.array([np.nan]), np.full(1, np.nan))
        )
        if kind == "lost_samples" and first / RATE >= at and rng.random() < 0.03 * size:
            watch.gap(Gap("link", frame))
            continue
        watch.rows(counts[first : first + frame, np.newaxis])
    return watch.events(RATE)
