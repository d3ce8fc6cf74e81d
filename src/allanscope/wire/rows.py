"""Rows of values, their interpretation, and rows made of halves.

Both sensors of a part run on one oscillator, but firmware polls them one after the other, so that
the two halves of a sample may come in two messages or on two lines (`Pairing`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import StreamInfo, Ticks
from allanscope.wire.timestamps import period_of

__all__ = [
    "ABSENT",
    "HELD",
    "Convert",
    "Interpretation",
    "Pairing",
    "Row",
    "RowTable",
    "Triple",
    "Values",
    "nominal_rate",
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
    blank_before : int
        Rows without a value between this row and the one before.
    """

    values: tuple[float, ...]
    device_s: float
    host_s: float
    temperature_c: float = math.nan
    damaged_before: bool = False
    blank_before: int = 0


@dataclass(frozen=True, slots=True)
class Interpretation:
    """What the values of rows are: axes, scales, rate.

    Attributes
    ----------
    info : StreamInfo
        What to tell the rest of the program.
    convert : callable
        Takes values (n, k) and returns counts (n, axes) and which rows agree with it. A
        row that does not is damaged, unless there are too many of them.
    fits_another : callable
        Takes values of rows that do not agree and returns whether something else fits them all.
    needed : tuple of int
        Columns without which a row is no sample: where devices print several rates in one table,
        most rows have empty cells.
    zeros_are_blank : bool
        Whether a row of zeros has no values either, as an accelerometer among them shows gravity.
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
    fits_another: Callable[[Values], bool] = lambda _: False
    needed: tuple[int, ...] = ()
    zeros_are_blank: bool = False
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


@dataclass(frozen=True, slots=True)
class RowTable:
    """Many rows, a column for each field of `Row`.

    Attributes
    ----------
    values : ndarray, shape (n, k)
    device_s, host_s, temperature_c : ndarray, shape (n,)
    damaged_before : ndarray of bool, shape (n,)
    blank_before : ndarray of int, shape (n,)
    """

    values: Values
    device_s: NDArray[np.float64]
    host_s: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    damaged_before: NDArray[np.bool_]
    blank_before: NDArray[np.int64]

    @classmethod
    def of(cls, rows: Sequence[Row]) -> RowTable:
        """Return single rows together."""
        values, device_s, host_s, degrees, damaged, blank = zip(*rows, strict=True)
        return cls(
            np.array(values, np.float64),
            np.array(device_s, np.float64),
            np.array(host_s, np.float64),
            np.array(degrees, np.float64),
            np.array(damaged, np.bool_),
            np.array(blank, np.int64),
        )

    @classmethod
    def joined(cls, tables: Sequence[RowTable]) -> RowTable:
        """Return tables one after the other; there is one at least."""
        if len(tables) == 1:
            return tables[0]
        return cls(*(np.concatenate(each) for each in zip(*map(_columns, tables), strict=True)))

    def __len__(self) -> int:
        return len(self.device_s)

    def __getitem__(self, chosen: slice | NDArray[np.int64]) -> RowTable:
        return RowTable(*(column[chosen] for column in _columns(self)))

    def row(self, i: int) -> Row:
        """Return one row."""
        values = tuple(self.values[i].tolist())
        times = float(self.device_s[i]), float(self.host_s[i]), float(self.temperature_c[i])
        return Row(values, *times, bool(self.damaged_before[i]), int(self.blank_before[i]))

    def whole(self, interpretation: Interpretation) -> RowTable:
        """Return the rows that have all that is needed; the others are blank ones before them."""
        there = self._has_all(interpretation)
        if there.all():
            return self
        at = np.flatnonzero(there)
        if not len(at):
            return self[at]
        # Damage before a row that is left out is damage before the next that is not.
        begins = np.append(0, at[:-1] + 1)
        damaged = np.logical_or.reduceat(self.damaged_before[: at[-1] + 1], begins)
        blank = np.add.reduceat(self.blank_before[: at[-1] + 1], begins) + at - begins
        return replace(self[at], damaged_before=damaged, blank_before=blank)

    def blank_at_end(self, interpretation: Interpretation) -> int:
        """Return how many rows there were after the last one that has all that is needed."""
        there = self._has_all(interpretation)
        begin = int(np.flatnonzero(there)[-1]) + 1 if there.any() else 0
        return len(self) - begin + int(self.blank_before[begin:].sum())

    def _has_all(self, interpretation: Interpretation) -> NDArray[np.bool_]:
        values = self.values[:, list(interpretation.needed)]
        there = np.isfinite(values).all(axis=1)
        if interpretation.zeros_are_blank:
            there = there & values.any(axis=1)
        return np.asarray(there)

    def ticks(self) -> Ticks:
        """Return the times and temperatures; none at all when the rows have none."""
        columns = self.device_s, self.host_s, self.temperature_c
        if all(np.isnan(column).all() for column in columns):
            return Ticks.none()
        return Ticks(np.arange(len(self)), *(column.copy() for column in columns))


def _columns(table: RowTable) -> tuple[NDArray[Any], ...]:
    return (
        table.values, table.device_s, table.host_s, table.temperature_c, table.damaged_before,
        table.blank_before,
    )  # fmt: skip


class Pairing:
    """Halves of samples to rows of six values."""

    def __init__(self) -> None:
        self._gyro: Triple | None = None
        self._accel: Triple | None = None
        self._without_gyro = 0
        self._without_accel = 0

    def update(self, gyro: Triple | None, accel: Triple | None) -> tuple[float, ...] | None:
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
