"""Headers that name one column more or fewer than the rows have cells.

Tables get a column of row numbers in front without a name, or a column less than was announced.
Which names belong to which cells shows in the values: a time goes up, gravity is 1 g.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from allanscope.wire.text.by_value import unit_by_gravity
from allanscope.wire.text.clock_times import ClockTimes, is_clock_time
from allanscope.wire.text.columns import Column, Columns

__all__ = ["realigned"]

_WARMTH = (-60.0, 150.0)


def realigned(columns: Columns, rows: Sequence[Sequence[str]]) -> tuple[Columns, str] | None:
    """Return the columns as the cells of some rows have them, and what to say of it.

    Parameters
    ----------
    columns : Columns
        What the header names.
    rows : sequence of rows of str
        Cells of the first rows, all of the same number.

    Returns
    -------
    (Columns, str) or None
        None where the numbers differ by more than one, or no axis would be left.

    Examples
    --------
    >>> gyro = tuple(Column("gyro", "dps", i) for i in range(3))
    >>> rows = [["1", "0.5", "0.1", "0.2"], ["2", "0.4", "0.1", "0.3"], ["3", "0.4", "0.2", "0.2"]]
    >>> realigned(gyro, rows)[0][0] is None
    True
    """
    cells = len(rows[0]) if rows else 0
    if abs(cells - len(columns)) != 1 or any(len(row) != cells for row in rows):
        return None
    values = _values(rows)
    counted = f"the header names {len(columns)} columns and the rows have {cells}: "
    if cells > len(columns):
        first = _first_cell(columns, values[:, 0])
        choices = [
            ((*columns, None), "the last cell of each row is left out"),
            ((first, *columns), f"the first cell of each row is taken as {_name(first)}"),
        ]
    else:
        choices = [
            (columns[:-1], "the last name is left out"),
            (columns[1:], "the first name is left out"),
        ]
    scores = [_fit(choice, values) for choice, _ in choices]
    if cells > len(columns) and np.all(np.diff(values[:, 0]) == 1.0):
        scores[1] += 1.0  # row numbers
    if cells < len(columns) and columns[0] is None:
        scores[1] += 0.5  # nothing of ours is lost
    best, words = choices[int(np.argmax(scores))]
    if not any(column and column.axis >= 0 for column in best):
        return None
    return best, counted + words


def _first_cell(columns: Columns, values: NDArray[np.float64]) -> Column | None:
    """Return what a cell without a name in front of the others is: a time, or a row number."""
    named = any(column and column.quantity == "time" for column in columns)
    steps = np.diff(values)
    goes_up = bool(np.isfinite(steps).all() and (steps > 0.0).all() and (steps != 1.0).any())
    return Column("time", "") if goes_up and not named else None


def _name(column: Column | None) -> str:
    return "a row number" if column is None else "the time"


def _values(rows: Sequence[Sequence[str]]) -> NDArray[np.float64]:
    """Return cells as numbers, times of day in seconds, NaN for what is neither."""
    clocks = [ClockTimes() for _ in rows[0]]

    def number(cell: str, clock: ClockTimes) -> float:
        try:
            if is_clock_time(cell):
                return clock.seconds(cell)
            return float(cell.replace(",", ".", 1))
        except ValueError:
            return math.nan

    return np.array([[number(c, k) for c, k in zip(row, clocks, strict=True)] for row in rows])


def _fit(columns: Columns, values: NDArray[np.float64]) -> float:
    """Return how well values are what their columns should be."""
    score = 0.0
    accel = []
    for column, cells in zip(columns, values.T, strict=True):
        if column is None:
            continue
        if column.quantity == "time":
            score += 2.0 if bool((np.diff(cells) > 0.0).all()) else -2.0
        elif column.quantity == "temperature":
            score += 0.25 if bool(((cells > _WARMTH[0]) & (cells < _WARMTH[1])).all()) else -1.0
        elif column.quantity == "accel":
            accel.append(cells)
    return score + (1.0 if accel and unit_by_gravity(np.column_stack(accel)) else 0.0)
