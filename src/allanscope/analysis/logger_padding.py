"""Rows at the beginning or the end of a record that are all the same: a logger's padding.

A logger that fills its last block, or writes before its sensor answers, leaves rows that no sensor
measured, zeros most of all. To a model they are repeats, a burst, a drift and a gap in the
spectrum at once. They are kept back until it is known what follows: what is the same on every axis
up to the end, ten times longer than any such run in the rows beside it, is left out of all sums.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from allanscope.analysis.row_buffer import Piece

__all__ = ["Padding"]

_KEPT_BACK = 2
"""Rows at the end of a piece that are the same, from which they wait for the next piece."""
_FEWEST = 64
"""Rows that are padding at the least."""
_LONGER = 10
"""How many times longer than the longest such run beside it padding must be."""
_BESIDE = 1 << 10
_AT_A_TIME = 1 << 13


@dataclass
class Padding:
    """What is kept back of one configuration, and what was left out.

    Attributes
    ----------
    leading, trailing : int
        Rows at the beginning that were left out, and rows that wait, at the end so far.

    Examples
    --------
    >>> rows = np.random.default_rng(1).integers(1, 99, (500, 2))
    >>> rows[400:] = 0
    >>> padding = Padding()
    >>> [len(counts) for counts, _ in padding.feed(rows, None)], padding.trailing
    ([400], 100)
    >>> padding.remarks(rate_hz=100.0)
    ('The last 1 s (100 rows) are zero on every axis: padding of the logger, left out.',)
    """

    leading: int = 0
    trailing: int = 0
    _begun: bool = False
    _first_is_zero: bool = False
    _row: NDArray[np.generic] = field(default_factory=lambda: np.empty(0))
    _before: NDArray[np.generic] = field(default_factory=lambda: np.empty((0, 0)))
    _temperature_c: float = np.nan

    def feed(
        self, counts: NDArray[np.generic], temperature_c: NDArray[np.float64] | None
    ) -> Iterator[Piece]:
        """Take contiguous rows, at least one, and yield those that may be summed up, in order."""
        waiting = self.trailing
        if waiting or not self._begun:
            row = self._row if waiting else counts[0].copy()
            same = _run(counts, row)
            if same == len(counts):
                self.trailing, self._row = waiting + same, row
                return
            ends = len(counts) - _run(counts[::-1], counts[-1])  # it may be padded there too
            beside = counts[same : min(same + _BESIDE, ends)]
            if not self._begun and _is_padding(waiting + same, beside):
                self.leading, self.trailing = waiting + same, 0
                self._first_is_zero = not np.any(row)
                counts = counts[same:]
                temperature_c = None if temperature_c is None else temperature_c[same:]
            yield from self.release()
        self._begun = True
        same = _run(counts[::-1], counts[-1])
        own = len(counts) - same if same >= _KEPT_BACK else len(counts)
        before = counts[max(0, own - _BESIDE) : own]
        if len(before) < _BESIDE and len(self._before):
            before = np.concatenate([self._before[len(before) - _BESIDE :], before])
        self._before = before.copy()
        if own == len(counts):
            yield counts, temperature_c
            return
        self.trailing, self._row = same, counts[-1].copy()
        self._temperature_c = np.nan if temperature_c is None else float(temperature_c[-1])
        if own:
            yield counts[:own], None if temperature_c is None else temperature_c[:own]

    def release(self) -> Iterator[Piece]:
        """Yield what waits: it was measured after all."""
        self._begun = self._begun or self.trailing > 0
        while self.trailing:
            rows = min(self.trailing, _AT_A_TIME)
            self.trailing -= rows
            yield np.tile(self._row, (rows, 1)), np.full(rows, self._temperature_c)

    @property
    def is_trailing(self) -> bool:
        """Whether what waits is padding, if nothing follows."""
        return self._begun and _is_padding(self.trailing, self._before)

    @property
    def is_padding(self) -> bool:
        """Whether any rows of the record are left out."""
        return self.leading > 0 or self.is_trailing

    def remarks(self, rate_hz: float) -> tuple[str, ...]:
        """Return what was left out, once the record has ended."""
        out = []
        for rows, end, is_zero, times in (
            (self.leading, "first", self._first_is_zero, " Times count from the row after them."),
            (self.trailing if self.is_trailing else 0, "last", not np.any(self._row), ""),
        ):
            what = "zero" if is_zero else "the same row"
            if rows:
                out.append(
                    f"The {end} {rows / rate_hz:.2g} s ({rows} rows) are {what} on every axis: "
                    f"padding of the logger, left out.{times}"
                )
        return tuple(out)


def _run(rows: NDArray[np.generic], row: NDArray[np.generic]) -> int:
    """Return how many of the first rows are equal to a row."""
    reach = 1
    while True:  # nearly always the second differs: not all of a long piece is compared
        differs = np.any(rows[:reach] != row, axis=1)
        if differs.any():
            return int(np.argmax(differs))
        if reach >= len(rows):
            return len(rows)
        reach *= 8


def _is_padding(rows: int, beside: NDArray[np.generic]) -> bool:
    """Return whether so many equal rows are far more than those beside them let expect."""
    if rows < _FEWEST or len(beside) < _FEWEST:
        return False
    ends = np.flatnonzero(np.any(beside[1:] != beside[:-1], axis=1)) + 1
    longest = int(np.diff(np.concatenate([[0], ends, [len(beside)]])).max())
    return rows > _LONGER * longest
