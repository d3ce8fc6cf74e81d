"""Records that carry a time at best, and no number: rows to events.

Text and stock firmware send rows of values. What they mean (which axes, which scale) shows in the
first few of them, so the first 25 are held back until a format has decided; then come the
StreamInfo and the Blocks. Losses are told by the time stamps where there are any (`pacing`); where
there are none, a damaged row leaves a hole of unknown length.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Block, Event, Gap, GapReason, Notice, StreamInfo, Ticks
from allanscope.wire.base import LinkStats
from allanscope.wire.pacing import Pacer, period_of

__all__ = ["HELD", "Convert", "Meaning", "Row", "Rows", "nominal_rate"]

HELD = 25
"""Rows that are looked at before it is decided what they mean."""

_FORGIVEN = 2
_FORGOTTEN = 1000

Values = NDArray[np.float64]
Convert = Callable[[Values], tuple[NDArray[np.generic], NDArray[np.bool_]]]


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
        By what to divide the times of the rows, where only now their unit is known.
    remarks : tuple of str
        What the user should know of how it was decided.
    """

    info: StreamInfo
    convert: Convert
    mistaken: Callable[[Values], bool] = lambda _: False
    needed: tuple[int, ...] = ()
    time_per_second: float = 1.0
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


class Rows:
    """Collects rows and returns the events that they make.

    Parameters
    ----------
    stats : LinkStats
        Counters to keep.
    decide : callable
        Says what a list of rows, at most `HELD`, means.
    """

    def __init__(self, stats: LinkStats, decide: Callable[[list[Row]], Meaning | None]) -> None:
        self._stats = stats
        self._decide = decide
        self._pending: list[Row] = []
        self._meaning: Meaning | None = None
        self._time_per_second = 1.0
        self._times: list[float] = []
        self._resolution_s = 0.0
        self._pacer: Pacer | None = None
        self._index = 0
        self._accepted = 0
        self._discarded = False
        self._misfits: list[tuple[int, tuple[float, ...]]] = []
        self._gap_due: GapReason | None = None
        self._damaged = False

    def add(
        self,
        values: tuple[float, ...],
        device_s: float,
        host_s: float,
        temperature_c: float = math.nan,
    ) -> None:
        """Take a row."""
        device_s /= self._time_per_second
        self._pending.append(Row(values, device_s, host_s, temperature_c, self._damaged))
        self._damaged = False

    def damaged(self) -> None:
        """Note that something was unreadable."""
        self._damaged = True

    def interrupt(self, reason: GapReason) -> None:
        """Note that the stream was interrupted: the next Block follows a Gap of this reason.

        Rows that were still held back are given up: they are too few to say what they mean.
        """
        self._pending.clear()
        self._damaged = False
        if self._accepted:
            self._gap_due = reason

    def change(self) -> list[Event]:
        """Note that the rows that follow mean something else; return what was held back."""
        events = self.take(final=True)
        self._meaning = None
        self._time_per_second = 1.0
        return events

    def take(self, final: bool = False) -> list[Event]:
        """Return the events of the rows since the last call; of all rows if `final`."""
        events: list[Event] = []
        while self._pending:
            if self._meaning is None:
                if len(self._pending) < HELD and not final:
                    break
                self._settle(events)
            elif not self._deliver(self._meaning, events):
                break
        if final:
            self._pending.clear()
        return events

    def _settle(self, events: list[Event]) -> None:
        """Decide what the rows mean; throw them away when they mean nothing."""
        first = self._pending[:HELD]
        self._meaning = self._decide(first)
        if self._meaning is None:
            self._stats.unknown += len(first)
            del self._pending[: len(first)]
            return
        self._rescale(self._meaning.time_per_second)
        self._times = [row.device_s for row in _whole(self._pending[:HELD], self._meaning)]
        self._resolution_s = self._meaning.info.time_resolution_s
        self._pacer = self._new_pacer()
        if self._accepted and self._gap_due is None:
            self._gap_due = "restarted"
        events.append(self._meaning.info)
        events += [Notice("status", remark) for remark in self._meaning.remarks]

    def _rescale(self, time_per_second: float) -> None:
        if time_per_second != self._time_per_second:
            self._time_per_second = time_per_second
            self._pending = [
                row._replace(device_s=row.device_s / time_per_second) for row in self._pending
            ]

    def _deliver(self, meaning: Meaning, events: list[Event]) -> bool:
        """Deliver what is pending; return False when the last row must wait for the one after."""
        rows, self._pending = _whole(self._pending, meaning), []
        if not rows:
            return True
        counts, agree = meaning.convert(np.array([row.values for row in rows], np.float64))
        start = 0
        for i, (row, agrees) in enumerate(zip(rows, agree.tolist(), strict=True)):
            missing = self._missing(row)
            doubtful = agrees and self._in_doubt(row, missing)
            failed = not agrees and self._failed(meaning, row)
            if failed or (doubtful and i + 1 == len(rows)):
                self._block(rows[start:i], counts[start:i], events)
                self._pending = rows[i:]
                self._meaning = None if failed else meaning
                return failed
            if not agrees or (doubtful and not self._borne_out(row, rows[i + 1])):
                self._block(rows[start:i], counts[start:i], events)
                self._stats.resyncs += 1
                self._discarded = True
                start = i + 1
                continue
            gap = self._follow(row, missing)
            if gap is not None:
                self._block(rows[start:i], counts[start:i], events)
                self._say(gap, events)
                start = i
        self._block(rows[start:], counts[start:], events)
        return True

    def _failed(self, meaning: Meaning, row: Row) -> bool:
        """Note a row that does not fit; return whether it is the meaning that does not.

        It is where a fifth of the last rows do not fit, or where a few of the last thousand do
        not and have another meaning in common. Damaged rows have nothing in common.
        """
        self._misfits = [m for m in self._misfits if m[0] > self._accepted - _FORGOTTEN]
        self._misfits.append((self._accepted, row.values))
        many = sum(number > self._accepted - HELD for number, _ in self._misfits) > HELD // 5
        few = len(self._misfits) > _FORGIVEN
        if many or (few and meaning.mistaken(np.array([values for _, values in self._misfits]))):
            self._misfits.clear()
            return True
        return False

    def _in_doubt(self, row: Row, missing: int | Literal["back"] | None) -> bool:
        """Return whether the time of a row is to be believed only if the next one bears it out."""
        if self._pacer is None or math.isnan(row.device_s):
            return False
        return missing != 0 or self._pacer.fresh

    def _missing(self, row: Row) -> int | Literal["back"] | None:
        """Return what is missing before a row, as `Pacer.missing` does."""
        if self._accepted == 0:
            return 0
        if self._gap_due is not None:
            self._pacer = self._new_pacer()
            return 0
        if self._pacer is None or math.isnan(row.device_s):
            return None if row.damaged_before or self._discarded else 0
        return self._pacer.missing(row.device_s)

    def _borne_out(self, row: Row, after: Row) -> bool:
        return self._pacer is None or self._pacer.believable(row.device_s, after.device_s)

    def _new_pacer(self) -> Pacer | None:
        return Pacer.of(self._times, self._resolution_s)

    def _follow(self, row: Row, missing: int | Literal["back"] | None) -> Gap | None:
        """Accept a row and return the hole before it, if there is one."""
        self._accepted += 1
        due, self._gap_due = self._gap_due, None
        damaged, self._discarded = row.damaged_before or self._discarded, False
        if self._pacer is not None and not math.isnan(row.device_s):
            self._pacer.follow(row.device_s, missing)
        if due is not None:
            return Gap(due, None)
        if missing == "back":
            return Gap("restarted", None)
        cause: GapReason = "link" if damaged else "device"
        return None if missing == 0 else Gap(cause, missing)

    def _say(self, gap: Gap, events: list[Event]) -> None:
        self._stats.lost_samples += gap.lost or 0
        self._stats.unknown_losses += gap.lost is None
        self._index += gap.lost or 0
        events.append(gap)

    def _block(self, rows: list[Row], counts: NDArray[np.generic], events: list[Event]) -> None:
        if not rows:
            return
        events.append(Block(self._index, counts, _ticks(rows)))
        self._index += len(rows)
        self._stats.samples += len(rows)


def _whole(rows: list[Row], meaning: Meaning) -> list[Row]:
    """Return the rows that have all that is needed."""
    needed = list(meaning.needed)
    if not needed:
        return rows
    values = np.array([row.values for row in rows], np.float64)
    there = np.asarray(np.isfinite(values[:, needed]).all(axis=1)).tolist()
    if all(there):
        return rows
    whole: list[Row] = []
    damaged = False
    for row, is_whole in zip(rows, there, strict=True):
        damaged |= row.damaged_before
        if is_whole:
            whole.append(row._replace(damaged_before=damaged))
            damaged = False
    return whole


def _ticks(rows: list[Row]) -> Ticks:
    device, host, temperature = np.array(
        [(row.device_s, row.host_s, row.temperature_c) for row in rows], np.float64
    ).T.copy()
    if np.isnan(device).all() and np.isnan(host).all() and np.isnan(temperature).all():
        return Ticks.none()
    return Ticks(np.arange(len(rows)), device, host, temperature)
