"""One row of values, what rows mean, and rows made of halves.

Both sensors of a part run on one oscillator, but firmware polls them one after the other, so that
the two halves of a sample may come in two messages or on two lines (`Pairing`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import StreamInfo, Ticks
from allanscope.wire.stamps import period_of

__all__ = [
    "ABSENT",
    "HELD",
    "Convert",
    "Meaning",
    "Pairing",
    "Row",
    "Triple",
    "Values",
    "nominal_rate",
    "ticks_of",
    "whole",
]

HELD = 25
"""Rows that are looked at before it is decided what they mean."""

Values = NDArray[np.float64]
Convert = Callable[[Values], tuple[NDArray[np.generic], NDArray[np.bool_]]]
Triple = tuple[float, float, float]
ABSENT = (math.nan,) * 3
"""The triple of a sensor that a row does not have."""

_ALONE = 8
"""Records of one sensor in a row after which the other is taken to be switched off."""


class Row(NamedTuple):
    """One sample of all axes, as it was sent.

    Attributes
    ----------
    values : tuple of float
        One for each axis of the row, NaN where an axis has none.
    device_s : float
        Unwrapped time stamp; NaN without one.
    host_s : float
        When it arrived.
    temperature_c : float
        NaN without one.
    damaged_before : bool
        Whether something unreadable came between this row and the one before.
    """

    values: tuple[float, ...]
    device_s: float
    host_s: float
    temperature_c: float = math.nan
    damaged_before: bool = False


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a format makes of its rows.

    Attributes
    ----------
    info : StreamInfo
        What to tell the rest of the program.
    convert : callable
        Takes values (n, k) and returns counts (n, axes) and which rows agree with this meaning. A
        row that does not is damaged, unless there are too many of them.
    mistaken : callable
        Takes values of rows that do not agree and returns whether another meaning fits them all.
    needed : tuple of int
        Columns without which a row is no sample: where devices print several rates in one table,
        most rows have empty cells.
    time_per_second : float
        By what to divide the times of the rows, where only now their unit is known; NaN where
        they are not to be used.
    farthest_s : float or None
        Where the times do not tell single losses: a step above which rows are missing all the same.
    remarks : tuple of str
        What the user should know of how it was decided.
    """

    info: StreamInfo
    convert: Convert
    mistaken: Callable[[Values], bool] = lambda _: False
    needed: tuple[int, ...] = ()
    time_per_second: float = 1.0
    farthest_s: float | None = None
    remarks: tuple[str, ...] = ()


def nominal_rate(rows: list[Row], usual: tuple[float, ...] = ()) -> float:
    """Return the rate that rows come at, as the usual one nearest to it if within 6 %; 0 unknown.

    >>> nominal_rate([Row((0.0,), 0.0097 * i, 0.0) for i in range(25)], (52.0, 104.0))
    104.0
    """
    period = period_of([row.device_s for row in rows])
    if period is None:
        return 0.0
    near = [rate for rate in usual if abs(rate * period - 1.0) < 0.06]
    if near:
        return min(near, key=lambda rate: abs(rate * period - 1.0))
    return float(f"{1.0 / period:.4g}")


def whole(rows: list[Row], meaning: Meaning) -> list[Row]:
    """Return the rows that have all that is needed."""
    needed = list(meaning.needed)
    if not needed:
        return rows
    values = np.array([row.values for row in rows], np.float64)
    there = np.asarray(np.isfinite(values[:, needed]).all(axis=1)).tolist()
    if all(there):
        return rows
    kept: list[Row] = []
    damaged = False
    for row, is_whole in zip(rows, there, strict=True):
        damaged |= row.damaged_before
        if is_whole:
            kept.append(row._replace(damaged_before=damaged))
            damaged = False
    return kept


def ticks_of(rows: list[Row]) -> Ticks:
    """Return the times and temperatures of rows; none at all when they have none."""
    device, host, temperature = np.array(
        [(row.device_s, row.host_s, row.temperature_c) for row in rows], np.float64
    ).T.copy()
    if np.isnan(device).all() and np.isnan(host).all() and np.isnan(temperature).all():
        return Ticks.none()
    return Ticks(np.arange(len(rows)), device, host, temperature)


class Pairing:
    """Halves of samples to rows of six values."""

    def __init__(self) -> None:
        self._gyro: Triple | None = None
        self._accel: Triple | None = None
        self._without_gyro = 0
        self._without_accel = 0

    def take(self, gyro: Triple | None, accel: Triple | None) -> tuple[float, ...] | None:
        """Take what came and return the row that it completes.

        A sensor that the last eight records of the other did not bring is switched off: rows then
        have NaN in its place. Before that, half a sample without its partner is given up.
        """
        if gyro is not None:
            self._gyro = gyro
            self._without_gyro = 0
            self._without_accel += 1
        if accel is not None:
            self._accel = accel
            self._without_accel = 0
            self._without_gyro += 1
        gyro, accel = self._gyro, self._accel
        if gyro is not None and self._without_accel > _ALONE:
            accel = ABSENT
        elif accel is not None and self._without_gyro > _ALONE:
            gyro = ABSENT
        if gyro is None or accel is None:
            return None
        self._gyro = self._accel = None
        return (*gyro, *accel)
