"""Rows that a damaged line has altered and no check has caught: one value far from all others.

Text has no checksum, so a flipped bit can make one digit of another, and TMsg sums eight bits. What
is known of such a row is what happened to it: the line damages rows, and in this one a single value
was changed. So a row is suspect if all of this holds::

    the line     a row that was visibly damaged is among the last 10,000
    one value    lies more than 3 r outside the band of the 64 rows before
    all others   lie within r of theirs: a shock moves several axes, through the part's package
    the rows before and after it lie within r too: a step stays, a shock rings, saturation lasts

The band of an axis goes from the third lowest to the third highest of its 64 values, and r is its
width, 3.5 standard deviations of Gaussian noise: 3 r outside is 12 of them from the mean. No noise
does that, but a part may (a read that mixes two samples, a glitch); hence the first condition. On
a line that has never shown any damage nothing is suspect, whatever the sensor says. With 3 none of
311,000 rows of real recordings would be suspect even without that condition; with 2 one is
(`benchmarks/bit_flips.py`).

A row is judged by the rows around it alone, never by how they came in reads; so a replay judges as
the live run did.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

__all__ = ["Plausibility"]

WINDOW = 64
_RANK = 3
_FAR, _NEAR = 3.0, 1.0
_REMEMBERED = 10_000
_LEAST_WIDTH = 2.0
"""In counts: of axes whose values hardly change."""
_AT_ONCE = 1024


class Plausibility:
    """Follows rows of counts and finds those that their neighbours contradict.

    Examples
    --------
    >>> rows = np.random.default_rng(1).normal(0.0, 5.0, (100, 3)).round()
    >>> rows[90, 1] = 800.0
    >>> follower = Plausibility()
    >>> follower.note_damage()
    >>> checks = follower.check(rows)
    >>> [i for i in range(100) if checks.next()]
    [90]
    """

    def __init__(self) -> None:
        self._recent: NDArray[Any] = np.empty((0, 0))
        self.since_damage = _REMEMBERED
        """Rows since the last visible damage."""

    def restart(self) -> None:
        """Forget the rows so far: those that follow mean something else."""
        self._recent = np.empty((0, 0))

    def note_damage(self) -> None:
        """Take note of a row that was visibly damaged."""
        self.since_damage = 0

    def check(self, rows: NDArray[Any]) -> RowChecks:
        """Return the checks of rows, shape (n, k), one after the other."""
        return RowChecks(self, rows)

    def update(self, rows: NDArray[Any]) -> None:
        """Take rows, shape (n, k), that have been checked: accepted or not, they are the past."""
        if self._recent.shape[1:] != rows.shape[1:]:
            self._recent = rows[:0]
        self._recent = np.concatenate([self._recent, rows[-WINDOW:]])[-WINDOW:]

    def isolated(self, rows: NDArray[Any]) -> NDArray[np.bool_]:
        """Return which of rows, shape (n, k), have one value far off between quiet neighbours.

        The last row has no successor: it is True when only that is missing.
        """
        found = np.zeros(len(rows), np.bool_)
        past = self._recent if self._recent.shape[1:] == rows.shape[1:] else rows[:0]
        together = np.concatenate([past, rows]).astype(np.float64)
        least = _LEAST_WIDTH if np.issubdtype(rows.dtype, np.integer) else 0.0
        for start in range(max(WINDOW - len(past), 0), len(rows), _AT_ONCE):
            stop = min(start + _AT_ONCE, len(rows))
            first = len(past) + start
            around = together[first - WINDOW : len(past) + stop + 1]
            found[start:stop] = _isolated(around, stop - start, least)
        return found


class RowChecks:
    """Which rows are suspect, in their order; nothing is computed on a line without damage.

    Attributes
    ----------
    is_last : bool
        Whether the row that was asked for is the last one: its successor may still confirm it.
    """

    def __init__(self, follower: Plausibility, rows: NDArray[Any]) -> None:
        self._follower = follower
        self._rows = rows
        self._at = -1
        self._isolated: NDArray[np.bool_] | None = None

    @property
    def is_last(self) -> bool:
        return self._at + 1 == len(self._rows)

    def count_sound(self, count: int) -> int:
        """Return how many of the next `count` rows come before one that is suspect.

        None of these has damage before it. They are still to be asked for, or passed over.
        """
        watched = min(count, _REMEMBERED - self._follower.since_damage)
        if watched <= 0:
            return count
        first = self._at + 1
        suspect = np.flatnonzero(self._found()[first : first + watched])
        return int(suspect[0]) if len(suspect) else count

    def skip(self, count: int) -> None:
        """Pass over rows that `count_sound` has counted."""
        self._at += count
        self._follower.since_damage = min(self._follower.since_damage + count, _REMEMBERED)

    def next(self, damaged_before: bool = False) -> bool:
        """Return whether the next row is suspect, before which there may have been damage."""
        self._at += 1
        if damaged_before:
            self._follower.note_damage()
        if self._follower.since_damage >= _REMEMBERED:
            return False
        self._follower.since_damage += 1
        return bool(self._found()[self._at])

    def _found(self) -> NDArray[np.bool_]:
        if self._isolated is None:
            self._isolated = self._follower.isolated(self._rows)
        return self._isolated


def _isolated(values: NDArray[np.float64], count: int, least: float) -> NDArray[np.bool_]:
    """Judge `count` rows, of which the first has `WINDOW` before it; one may come after them."""
    past = sliding_window_view(values[: WINDOW + count - 1], WINDOW, axis=0)
    ranked = np.partition(past, [_RANK - 1, WINDOW - _RANK], axis=-1)
    low, high = ranked[..., _RANK - 1], ranked[..., WINDOW - _RANK]
    width = np.maximum(high - low, least)

    def outside(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far rows are outside the bands, in widths; inside and unknown are 0."""
        beyond = np.maximum(low[: len(rows)] - rows, rows - high[: len(rows)])
        # An axis that never changes has no width and tells nothing.
        there = width[: len(rows)] > 0.0
        return np.where(there, beyond, 0.0) / np.where(there, width[: len(rows)], 1.0)

    here = outside(values[WINDOW : WINDOW + count])
    single = ((here > _FAR).sum(axis=1) == 1) & ((here > _NEAR).sum(axis=1) == 1)
    before = outside(values[WINDOW - 1 : WINDOW - 1 + count])
    quiet: NDArray[np.bool_] = np.asarray((before <= _NEAR).all(axis=1))
    after = outside(values[WINDOW + 1 : WINDOW + 1 + count])
    quiet[: len(after)] &= (after <= _NEAR).all(axis=1)
    return np.asarray(single & quiet)
