"""The Allan deviation over time: one curve for each of many windows that slide along a run.

A single curve of a night shows that it was worse than the night before, but not when. The dynamic
Allan deviation (Galleani and Tavella, "The dynamic Allan variance", IEEE Trans. UFFC 56, 2009) is
the estimator on each stretch of the run by itself. It needs no second pass: with A the sum of
squares of all terms that end by a moment, and K that of the terms that reach across it,

    window from i to j:   (A[j] - A[i] - K[i]) / (number of the same terms) / (2 m^2)

are exactly the terms that lie within. The cascade notes A and K at each border (`kernels`), one in
eighth of a window; a window is the difference of two. Where a run grows beyond the room for its
borders, every second one is dropped, and windows that were not asked for by their length double.

Terms are those of the cascade: above m = 64 they start at every 2^L-th sample of their segment. A
border lies where those of a cascade that took the window alone would start as well.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.cascade import Cascade
from allanscope.allan.kernels import COLUMNS, FREE, NOTED

__all__ = ["SLOTS", "DynamicDeviation", "WindowBorders"]

Floats = NDArray[np.float64]

MOST_BORDERS = 1024
"""Between half of them and all are in use: some 10 MiB for six axes."""
PER_WINDOW = 8
"""Borders in a window at first; windows overlap by all but one."""
FIRST_WINDOW_S = 10.0
SHORTEST = 64
"""Samples."""
MOST_LEVELS = 48
SLOTS = 128
"""Marks that wait on a rung: its terms and batches span 80 borders, a slice has 32, and up to 15
have been noted but not fetched."""
AT_A_TIME = 32
FETCHED_TOGETHER = 16
"""Borders: to fetch what a rung has noted costs as much for many of them as for one."""
FEWEST_TERMS = 2
_OADEV = COLUMNS.index("oadev")


@dataclass(frozen=True, slots=True)
class DynamicDeviation:
    """Allan deviation (``oadev``) of each window of a run, at each averaging time.

    Attributes
    ----------
    tau : ndarray, shape (k,)
        Averaging times in s.
    start_s, stop_s : ndarray, shape (windows,)
        Where each window begins and ends, in s since the first sample, gaps counted.
    deviation : ndarray, shape (axes, windows, k)
        In the unit of the bank; NaN where a window has fewer than two terms.
    terms : ndarray of int64, shape (windows, k)
        Terms summed.
    window_s : float
        Length of a window in s, gaps left out.
    """

    tau: Floats
    start_s: Floats
    stop_s: Floats
    deviation: Floats
    terms: NDArray[np.int64]
    window_s: float

    @property
    def centre_s(self) -> Floats:
        """Middle of each window, in s since the first sample."""
        return (self.start_s + self.stop_s) / 2.0

    def relative(self, axis: int) -> Floats:
        """Return the deviation of an axis over its median at each averaging time.

        What a map can show: over all averaging times the deviation itself spans decades, of which
        a change by a half is a small part. Shape (windows, k), NaN where there is none.
        """
        own = self.deviation[axis]
        usual = np.array([np.median(one[one >= 0]) if (one >= 0).any() else 0.0 for one in own.T])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(usual > 0.0, own / usual, np.nan))


class WindowBorders:
    """The borders of windows, and what the cascade has noted there.

    Parameters
    ----------
    axes : int
        Number of axes.
    rate_hz : float
        Samples a second.
    window_s : float
        Length of a window in s, kept to 6 %; 0 has it grow with the run, from 10 s on.

    Attributes
    ----------
    step : int
        Samples from one border to the next.
    in_window : int
        Borders in a window.
    """

    def __init__(self, axes: int, rate_hz: float, window_s: float) -> None:
        self._grows = window_s <= 0.0
        samples = max((window_s if window_s > 0.0 else FIRST_WINDOW_S) * rate_hz, SHORTEST)
        step = samples / PER_WINDOW
        # Borders are multiples of the stride of the highest rung that a window has terms on.
        self._stride = 1 << max(int(np.log2(step / 8)), 0)
        self.step = round(step / self._stride) * self._stride
        self.in_window = PER_WINDOW
        self._next = 0
        self._lost = 0
        self._places = np.zeros((MOST_BORDERS, 2), np.int64)  # samples taken, and with those lost
        self._used = 0
        self._unfetched = 0  # borders set since the last fetch
        self._squares = np.zeros((MOST_BORDERS, axes, 0, 2))
        self._terms = np.zeros((MOST_BORDERS, 0, 2), np.int64)
        self._rows = np.zeros((MOST_LEVELS, SLOTS), np.int64)  # of the marks of each rung
        self._waiting: list[tuple[int, int, int]] = []

    @property
    def most_samples(self) -> int:
        """Samples that may be taken in after `plan`."""
        return AT_A_TIME * self.step

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return self._places.nbytes + self._squares.nbytes + self._terms.nbytes

    def copy(self) -> WindowBorders:
        """Return an independent copy."""
        return deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process or a copy needs: no borders that are not in use."""
        used = {name: getattr(self, name)[: self._used] for name in ("_squares", "_terms")}
        return vars(self) | used

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._squares, self._terms = self._with_room(self._squares), self._with_room(self._terms)

    def lose(self, samples: int) -> None:
        """Note that so many samples are missing."""
        self._lost += samples

    def plan(self, cascade: Cascade, samples: int) -> None:
        """Set the marks that the next samples will pass; there is room for them in the cascade."""
        self._grow(cascade)
        while True:
            due = cascade.taken + self._next * self.step - cascade.samples
            mark = max(-(-due // self._stride) * self._stride, 0)
            if mark > cascade.taken + samples:
                break
            if mark < cascade.taken:  # a segment took its first border when it began
                self._next += 1
                continue
            if self._used == MOST_BORDERS:
                self._thin(cascade)
                continue
            self._add(cascade, mark)
        ready = [one for one in self._waiting if one[0] < cascade.levels]
        for level, mark, row in ready:
            self._waiting.remove((level, mark, row))
            self._mark(cascade, level, level + 1, mark, row)

    def _add(self, cascade: Cascade, mark: int) -> None:
        row = self._used
        taken = cascade.samples - cascade.taken + mark
        self._places[row] = taken, taken + self._lost
        self._squares[row], self._terms[row] = 0.0, 0
        # Once every second border has been given up so often, this one is a border of windows that
        # are longer by as much.
        doublings = (self._next & -self._next).bit_length() - 1 if self._next else 48
        longest = self.step * self.in_window << doublings
        self._mark(cascade, 0, min((longest // 64).bit_length(), MOST_LEVELS), mark, row)
        self._used += 1
        self._unfetched += 1
        self._next += 1

    def _mark(self, cascade: Cascade, first: int, stop: int, mark: int, row: int) -> None:
        """Set a mark on some rungs; those that are not there yet wait."""
        there = min(stop, cascade.levels)
        self._waiting += [(level, mark, row) for level in range(max(first, there), stop)]
        if there <= first:
            return
        free = cascade.marks[first:there] == FREE
        slots = free.argmax(axis=1)
        levels = np.flatnonzero(free.any(axis=1))
        cascade.marks[first + levels, slots[levels]] = mark
        self._rows[first + levels, slots[levels]] = row
        bounds = cascade.first[first : there + 1]
        taus = slice(bounds[0], bounds[-1])
        entries = np.repeat(mark >> np.arange(first, there), np.diff(bounds))
        ended = np.maximum(entries - 2 * cascade.lags[taus] + 1, 0)
        self._terms[row, taus, 0] = cascade.counts[taus, 0, _OADEV] + ended

    def collect_when_due(self, cascade: Cascade) -> None:
        """Fetch what has been noted, if there may be much of it."""
        if self._unfetched >= FETCHED_TOGETHER:
            self.collect(cascade)

    def collect(self, cascade: Cascade) -> None:
        """Fetch what has been noted."""
        self._unfetched = 0
        noted = cascade.marks == NOTED
        for level in np.flatnonzero(noted.any(axis=1)):
            slots = np.flatnonzero(noted[level])
            rows = self._rows[level, slots]
            taus = slice(cascade.first[level], cascade.first[level + 1])
            found = cascade.marked[:, taus, slots]  # (axes, taus, slots, 3)
            self._squares[rows, :, taus] = found[..., :2].transpose(2, 0, 1, 3)
            self._terms[rows, taus, 1] = found[0, ..., 2].T
        cascade.marks[noted] = FREE

    def close(self, cascade: Cascade) -> None:
        """Fetch the rest, of a segment that has ended."""
        self.collect(cascade)
        self._waiting = []

    def _grow(self, cascade: Cascade) -> None:
        missing = len(cascade.lags) - self._terms.shape[1]
        if missing:
            self._squares = self._with_room(self._squares, missing)
            self._terms = self._with_room(self._terms, missing)

    def _with_room(self, held: NDArray[Any], taus: int = 0) -> NDArray[Any]:
        """Return an array with room for all borders: what is not written to takes no memory."""
        shape = (MOST_BORDERS, *held.shape[1:-2], held.shape[-2] + taus, 2)
        new = np.zeros(shape, held.dtype)
        new[: self._used, ..., : held.shape[-2], :] = held[: self._used]
        return new

    def _thin(self, cascade: Cascade) -> None:
        """Give up every second border."""
        self.collect(cascade)
        half = MOST_BORDERS // 2
        for held in (self._places, self._squares, self._terms):
            held[:half] = held[::2].copy()
        odd = self._rows[: cascade.levels] % 2 == 1
        cascade.marks[odd] = FREE
        self._rows //= 2
        self._waiting = [(k, mark, row // 2) for k, mark, row in self._waiting if row % 2 == 0]
        self._used = half
        self._next = -(-self._next // 2)
        self.step *= 2
        if self._grows or self.in_window == 1:
            self._stride *= 2
        else:
            self.in_window //= 2

    def deviation(self, cascade: Cascade, scale: Floats, rate_hz: float) -> DynamicDeviation:
        """Return the windows so far, of a closed cascade whose sums have been fetched."""
        self._grow(cascade)
        many = max(self._used - self.in_window, 0)
        begin, end = slice(0, many), slice(self.in_window, self.in_window + many)
        terms = self._terms[end, :, 0] - self._terms[begin].sum(axis=2)
        squares = self._squares[end, ..., 0] - self._squares[begin].sum(axis=3)
        m, window = cascade.m.astype(np.float64), self.step * self.in_window
        fits = 2 * cascade.m + cascade.stride <= window
        fits &= (terms >= FEWEST_TERMS).any(axis=0) if many else False
        terms, squares, m = terms[:, fits], squares[..., fits], m[fits]
        enough = terms >= FEWEST_TERMS
        variance = np.where(enough, np.maximum(squares.swapaxes(0, 1), 0.0), np.nan)
        variance = variance / np.maximum(terms, 1) / (2.0 * m**2)
        deviation = np.sqrt(variance) * scale[:, np.newaxis, np.newaxis]
        places = self._places[:, 1] / rate_hz
        return DynamicDeviation(
            tau=m / rate_hz,
            start_s=places[begin],
            stop_s=places[end],
            deviation=deviation,
            terms=np.where(enough, terms, 0),
            window_s=window / rate_hz,
        )
