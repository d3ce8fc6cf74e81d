"""Records with undeclared effects and known truth, for the blind benchmark."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from blind_effects import NAMEABLE, OUTSIDE, Maker, Truth, draw_level
from blind_noise import Array, Noise, base_noise, draw_noise
from numpy.typing import NDArray

from allanscope.history import Record

AXES = ("gx", "gy", "gz", "ax", "ay", "az")


@dataclass(frozen=True)
class Blind:
    """A record and the truth about it. `source_row` tells which row each row repeats."""

    record: Record
    nominal_hz: float
    rate_fit: tuple[float, float]
    truths: tuple[Truth, ...]
    noise: dict[str, Noise]
    source_row: NDArray[np.int64] | None = field(default=None, repr=False)


def draw_temperature(rng: np.random.Generator, n: int, rate: float) -> tuple[Array, Array]:
    """Return true and measured temperature: a room whose heater cycles, and a drift."""
    t = np.arange(n) / rate
    period = rng.uniform(900, 3000)
    true = 26 + rng.uniform(0.2, 0.6) * np.sin(2 * np.pi * (t / period + rng.random()))
    grid = np.arange(0, t[-1] + 120, 60.0)
    true = true + np.interp(t, grid, np.cumsum(rng.normal(0, 0.03, len(grid))))
    read = true + rng.normal(0, 0.02, n)
    return true, np.round(read * 256) / 256


def make_blind(
    seed: int,
    kinds: tuple[tuple[str, str], ...],
    hours: float = 2.0,
    rate: float = 104.0,
    axes: tuple[str, ...] = AXES,
) -> Blind:
    """Return a record that holds the `kinds`, each a pair (kind, "near" or "above")."""
    rng = np.random.default_rng([seed, 77])
    n = int(hours * 3600 * rate)
    noise = {axis: draw_noise(rng, axis) for axis in axes}
    values = {axis: base_noise(rng, noise[axis], n, rate) for axis in axes}
    true_c, read_c = draw_temperature(rng, n, rate)
    maker = Maker(rng, n, rate, true_c)
    order = list(rng.permutation(list(axes)))
    truths: list[Truth] = []
    nominal, measured = rate, (rate * (1 + rng.normal(0, 10e-6)), rate * 15e-6)
    source_row = None
    for kind, level in kinds:
        axis = str(order.pop())
        times = draw_level(rng, level)
        if kind == "quantization":
            sigma = noise[axis].n * np.sqrt(rate)
            ratio = rng.uniform(0.36, 0.46) if level == "near" else rng.uniform(0.2, 0.35)
            noise[axis] = replace(noise[axis], lsb=sigma / ratio)
            truths.append(Truth(kind, axis, level, {"step": sigma / ratio}))
        elif kind == "clock_error":
            sd = 15e-6
            relative = float(sd * 7 * times if level == "near" else rng.uniform(2e-3, 6e-2))
            relative *= float(rng.choice([-1, 1]))
            nominal = rate / (1 + relative)
            truths.append(Truth(kind, "", level, {"relative": relative}))
        elif kind == "repeated_samples":
            fraction = 2e-4 * times if level == "near" else float(np.exp(rng.uniform(-6, -2)))
            repeats = rng.random(n) < fraction
            repeats[0] = False
            source_row = np.maximum.accumulate(np.where(repeats, 0, np.arange(n)))
            truths.append(Truth(kind, "", level, {"fraction": fraction}))
        else:
            name = "temperature_effect" if kind == "temperature" else kind
            others = {a: v for a, v in values.items() if a != axis}
            truth = maker.make(name, axis, level, noise[axis], others)
            truths.append(replace(truth, kind=kind))
            if truth.signal is not None:
                values[axis] = values[axis] + truth.signal
            elif truth.again is not None:
                values[axis] = truth.again(rng, values[axis])
    table = np.column_stack([values[a] + noise[a].offset for a in axes])
    lsb = np.array([noise[a].lsb for a in axes])
    table = np.round(table / lsb) * lsb
    if source_row is not None:
        table = table[source_row]
    record = Record(
        rate_hz=rate,
        stride=1,
        axes=axes,
        values=table,
        lsb=tuple(float(x) for x in lsb),
        temperature_c=read_c,
        start_s=np.arange(n) / rate,
        segments=np.array([[0, n]], np.int64),
    )
    return Blind(record, nominal, measured, tuple(truths), noise, source_row)


def another_run(blind: Blind, truth: Truth, rng: np.random.Generator) -> Array:
    """Return the axis of a truth in another run: its noise, without the signals that recur."""
    noise, rate = blind.noise[truth.axis], blind.record.rate_hz
    values = base_noise(rng, noise, len(blind.record.values), rate)
    if truth.again is not None:
        values = truth.again(rng, values)
    values = np.round((values + noise.offset) / noise.lsb) * noise.lsb
    return values if blind.source_row is None else values[blind.source_row]


def draw_kinds(rng: np.random.Generator, index: int) -> tuple[tuple[str, str], ...]:
    """None, one or two effects; every kind comes round equally often."""
    pool = (*NAMEABLE, *OUTSIDE, "")
    level = "near" if rng.random() < 0.5 else "above"
    first = (pool[index % len(pool)], level)
    if not first[0]:
        return ()
    if first[0] in OUTSIDE:
        return ((first[0], "above"),)
    if rng.random() < 0.3:
        second = (str(rng.choice(NAMEABLE)), "near" if rng.random() < 0.5 else "above")
        if second[0] != first[0]:
            return (first, second)
    return (first,)
