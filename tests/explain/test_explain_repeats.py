"""Rows that repeat are told from rows that are equal by chance, whatever the values are like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from allanscope.analysis.coefficients import total_white
from allanscope.explain import explain
from allanscope.explain.effects.repeated_samples import RepeatedSamples
from allanscope.explain.effects.variance_change import VarianceChange
from allanscope.explain.series import series_of
from allanscope.explain.view import View
from allanscope.history import Record
from allanscope.noise import find_step

N = 30_000
RATE = 100.0
SEEDS = 3


def _record(values: np.ndarray) -> Record:
    n, columns = values.shape
    return Record(
        rate_hz=RATE,
        stride=1,
        axes=("gx", "gy", "gz", "ax", "ay", "az")[:columns],
        values=values,
        lsb=tuple(find_step(column) for column in values.T),
        temperature_c=np.full(n, np.nan),
        start_s=np.arange(n) / RATE,
        segments=np.array([[0, n]], np.int64),
    )


def _proposed(values: np.ndarray) -> float:
    """Return the share of repeats that passes the test, 0 for none."""
    view = View.of(series_of(_record(values)), "gx")
    found = [c for c in RepeatedSamples.candidates(view) if c.excess > 0]
    return float(found[0].effect.parameters["fraction"].value) if found else 0.0


def _rounded(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step


@pytest.mark.parametrize("seed", range(SEEDS))
def test_equal_rows_in_a_dead_zone_beside_a_loud_tone_are_no_repeats(seed: int) -> None:
    """A tone of a third of the rate comes back to the zone, and leaves it in the next row."""
    rng = np.random.default_rng([seed, 1])
    n, pole = 6000, np.exp((-0.6 * np.pi + 62.6j * np.pi) / RATE)
    noise = rng.normal(size=n) + 1j * rng.normal(size=n)
    tone = 14 * lfilter([np.sqrt(1 - abs(pole) ** 2)], [1, -pole], noise).real
    samples = np.round(tone + rng.normal(0, 3, n))
    held = np.where(np.abs(samples - 3) < 8, 3.0, samples)
    assert _proposed(held[:, np.newaxis]) == 0.0
    again = np.maximum.accumulate(np.where(rng.random(n) < 0.05, 0, np.arange(n)))
    assert _proposed(held[again][:, np.newaxis]) > 0.03


def _filtered(values: np.ndarray) -> np.ndarray:
    return 3 * lfilter(*butter(2, 0.15), values, axis=0)


BY_CHANCE = {
    "white": lambda r, k: r.normal(size=(N, k)),
    "in bursts": lambda r, k: (
        r.normal(size=(N, k)) * np.where(np.arange(N) % 4000 < 1200, 3, 1)[:, np.newaxis]
    ),
    "with a common walk": lambda r, k: (
        r.normal(size=(N, k)) + np.cumsum(r.normal(0, 0.03, (N, 1)), axis=0)
    ),
    "with a common vibration": lambda r, k: (
        0.6 * r.normal(size=(N, k)) + 0.8 * r.normal(size=(N, 1))
    ),
    "with a tone": lambda r, k: (
        r.normal(size=(N, k)) + 3 * np.sin(0.086 * np.arange(N))[:, np.newaxis]
    ),
    "behind a low-pass": lambda r, k: _filtered(r.normal(size=(N, k)) + r.normal(size=(N, 1))),
    "heavy tails": lambda r, k: r.standard_t(3, size=(N, k)),
}


@pytest.mark.parametrize("kind", BY_CHANCE)
def test_values_that_are_coarse_are_equal_by_chance(kind: str) -> None:
    """None of 72 on each: seven kinds of noise, four steps, one and three axes, three seeds."""
    false = []
    for seed in range(SEEDS):
        for step in (0.5, 1.0, 2.0, 4.0):
            for axes in (1, 3):
                rng = np.random.default_rng([seed, axes, 11])
                values = _rounded(BY_CHANCE[kind](rng, axes), step)
                if share := _proposed(values):
                    false.append((seed, step, axes, share))
    assert not false


@pytest.mark.parametrize("digits", [1, 2, 3])
@pytest.mark.parametrize("axes", [1, 3])
def test_decimal_numbers_are_equal_by_chance(digits: int, axes: int) -> None:
    """Of a lattice of 8.75 mdps, printed to so many places behind the point."""
    for seed in range(SEEDS):
        noise = np.random.default_rng([seed, 12]).normal(0, 0.06, (N, axes))
        assert _proposed(np.round(_rounded(noise, 8.75e-3), digits)) == 0.0


@pytest.mark.parametrize("axes", [1, 3])
@pytest.mark.parametrize(
    ("share", "step"), [(0.01, 0.01), (0.02, 0.3), (0.05, 0.5), (0.3, 0.8), (0.002, 1e-9)]
)
def test_rows_that_repeat_are_found_all_the_same(axes: int, share: float, step: float) -> None:
    for seed in range(SEEDS):
        rng = np.random.default_rng([seed, 13])
        rows = np.arange(N)
        rows[rng.random(N) < share] = 0
        values = _rounded(rng.normal(size=(N, axes)), step)[np.maximum.accumulate(rows)]
        assert _proposed(values) == pytest.approx(share, rel=0.25)


def test_numbers_without_a_lattice_are_equal_by_chance_too() -> None:
    """Printed to so few digits that some are equal, on a step that is not even."""
    rng = np.random.default_rng(14)
    uneven = np.cumsum(rng.uniform(0.5, 1.5, 4000)) * 5e-3
    index = np.clip(np.round(rng.normal(2000, 300, N)), 0, 3999).astype(int)
    assert _proposed(uneven[index][:, np.newaxis]) == 0.0


def test_what_repeats_every_few_rows_is_a_pattern_and_no_noise() -> None:
    values = np.tile([[0.1, 0.2], [0.2, 0.2], [0.3, 0.1], [0.2, 0.1]], (N // 4, 1))
    for axis in explain(_record(values)).axes.values():
        assert axis.effects == ()
        assert axis.hindrance.startswith("the samples repeat every 4 rows")


@pytest.mark.parametrize("known", [False, True])
def test_only_a_range_that_is_known_can_be_left(known: bool) -> None:
    """A step of 0.03 mg of decimal numbers would end at -0.983 g; 0.061 mg is of 2 g."""
    step = 0.061e-3 if known else 0.03e-3
    rng = np.random.default_rng(15)
    level = -32767 * step
    values = np.maximum(level, _rounded(level + rng.normal(0, 2e-4, (N, 1)), step))
    record = replace(_record(values), axes=("az",), lsb=(step,))
    told = [r for r in explain(record).axes["az"].remarks if "saturated" in r]
    assert bool(told) is known


def test_n_of_a_sensor_that_is_read_twice_is_that_of_its_samples():
    """Read at 100 Hz, a sensor at 50 Hz of 5 mdps/sqrt(Hz)."""
    rng = np.random.default_rng(31)
    samples = _rounded(rng.normal(0, 5e-3 * 50**0.5, (N // 2, 1)), 1e-3)
    record = _record(np.repeat(samples, 2, axis=0))
    result = explain(record)
    assert [one.kind for one in result.axes["gx"].effects] == ["repeated_samples"]
    assert total_white(result.fits["gx"]).value == pytest.approx(5e-3, rel=0.02)


@pytest.mark.parametrize("step", [1e-6, 0.028])
def test_a_sensor_that_is_read_three_or_four_times_has_white_noise_and_no_more(step: float):
    """Read at 100 Hz, a sensor at 31.7 Hz: also where 7 % of its samples are equal by chance."""
    rng = np.random.default_rng(32)
    samples = _rounded(rng.normal(0, 0.17, (2000, 2)), step)
    values = samples[np.floor(np.arange(6000) * 0.317 + 0.3).astype(int)]
    result = explain(_record(values))
    for axis, found in result.axes.items():
        assert [one.kind for one in found.effects] == ["repeated_samples"]
        assert total_white(result.fits[axis]).value == pytest.approx(0.17 / 31.7**0.5, rel=0.05)


def test_values_that_are_equal_by_chance_are_no_silence():
    """At 10 Hz a second is ten rows: of noise as large as a step these are all equal now and then.

    An hour of noise, in which it happens for two seconds.
    """
    rng = np.random.default_rng(32)
    values = _rounded(rng.normal(0, 1e-3, (36_000, 1)), 1e-3)
    values[20_000:20_020] = 0.0
    record = replace(_record(values), rate_hz=10.0, start_s=np.arange(36_000) / 10.0)
    view = View.of(series_of(record), "gx")
    assert not [c for c in VarianceChange.candidates(view) if c.excess > 0]


def _two_sensors(rng: np.random.Generator, gyro: float, accelerometer: float) -> np.ndarray:
    """Return six coarse axes, three of each sensor, with shares of rows that repeat."""
    values = _rounded(rng.normal(size=(N, 6)), 0.5)
    for columns, share in ((slice(0, 3), gyro), (slice(3, 6), accelerometer)):
        rows = np.arange(N)
        rows[rng.random(N) < share] = 0
        values[:, columns] = values[np.maximum.accumulate(rows), columns]
    return values


def test_each_of_two_slow_sensors_repeats_rows_by_its_own_rate() -> None:
    """Read at 163 Hz: a gyroscope at 51 Hz and an accelerometer at 28 Hz."""
    rng = np.random.default_rng(17)
    rows = np.arange(12_000)[:, np.newaxis]
    at = np.floor(rows * np.repeat([51 / 163, 28 / 163], 3) + 0.3).astype(int)
    values = np.take_along_axis(rng.normal(size=(12_000, 6)), at, axis=0)
    record = replace(_record(values), rate_hz=163.0, start_s=np.arange(12_000) / 163.0)
    found = explain(record).axes
    for axis, made in (("gy", 51), ("ay", 28)):
        (effect,) = found[axis].effects
        assert effect.kind == "repeated_samples"
        assert effect.parameters["fraction"].value == pytest.approx(1 - made / 163, abs=0.01)


def test_one_sensor_repeats_rows_and_the_other_has_a_share_of_its_own() -> None:
    """Their registers are filled at different times: few rows repeat on all axes."""
    for seed in range(SEEDS):
        values = _two_sensors(np.random.default_rng([seed, 16]), 0.02, 0.0)
        view = View.of(series_of(_record(values)), "gz")
        (found,) = (c for c in RepeatedSamples.candidates(view) if c.excess > 0)
        assert found.axes == ("gx", "gy", "gz")
        assert found.effect.parameters["fraction"].value == pytest.approx(0.02, rel=0.25)
        still = View.of(series_of(_record(values)), "ay")
        assert not [c for c in RepeatedSamples.candidates(still) if c.excess > 0]
