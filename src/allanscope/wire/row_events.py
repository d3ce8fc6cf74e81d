"""Records that carry a time at best, and no number: rows to events.

Text and stock firmware send rows of values. What they mean (which axes, which scale) shows in the
first few of them, so the first 25 are held back until a format has decided (of a file up to 1024
where their times come unevenly); then come the StreamInfo and the Blocks. Losses are told by the
time stamps where there are any (`continuity`); where there are none, a damaged row leaves a gap of
unknown length. On a line that damages rows one that its neighbours contradict is left out as
suspect (`plausibility`). A row with blank cells or NaN is a lost sample, and so is one of zeros
where an accelerometer shows gravity: times beside it tell, or its place where there are none,
unless most rows are like that because a device prints several rates in one table.

Of a file, where nobody sees the gaps as they come, the first rows that were left out and the first
places where the time goes back are also said.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Block, Event, Gap, GapReason, Notice
from allanscope.wire.base import LinkStats
from allanscope.wire.continuity import Continuity
from allanscope.wire.plausibility import Plausibility
from allanscope.wire.rows import HELD, Interpretation, Row, RowTable

__all__ = ["RowEvents"]

_FORGIVEN = 2
_FORGOTTEN = 1000
_MOST_REPORTED = 3
_ALIKE = 0.1
"""Scatter of the steps of a stream, in periods, up to which a few rows tell its period."""
_AGAIN = "the row before it again; such rows are left out"
_IMPOSSIBLE = "its values are impossible; such rows are left out"
_ODD_TIME = "its time does not fit the next row; such rows are left out"


class RowEvents:
    """Collects rows and returns the events that they make.

    Parameters
    ----------
    stats : LinkStats
        Counters to keep.
    decide : callable
        Says what a list of rows means: the first `HELD`, or `patience`.
    checked : bool
        Whether rows come with a checksum, so that a damaged one rarely passes for a sound one.
    patience : int
        Rows of a file, which may wait, that are looked at where the times of the first few
        come unevenly.
    """

    def __init__(
        self,
        stats: LinkStats,
        decide: Callable[[list[Row]], Interpretation | None],
        checked: bool = False,
        patience: int = HELD,
    ) -> None:
        self._stats = stats
        self._decide = decide
        self._patience = patience
        self._single: list[Row] = []
        self._tables: list[RowTable] = []
        self._interpretation: Interpretation | None = None
        self._time_per_second = 1.0
        self._continuity = Continuity(checked)
        self._plausibility = Plausibility()
        self._index = 0
        self._last: NDArray[np.float64] = np.empty(0)
        self._misfits: list[tuple[int, tuple[float, ...]]] = []
        self._damaged = False
        self._blank = 0
        self._reported = 0

    def add(
        self,
        values: tuple[float, ...],
        device_s: float,
        host_s: float,
        temperature_c: float = math.nan,
    ) -> None:
        """Take a row; one without any value only counts."""
        if all(map(math.isnan, values)):
            self._blank += 1
            return
        device_s /= self._time_per_second
        before = self._damaged, self._blank
        self._single.append(Row(values, device_s, host_s, temperature_c, *before))
        self._damaged, self._blank = False, 0

    def extend(
        self,
        values: NDArray[np.float64],
        device_s: NDArray[np.float64],
        host_s: float,
        temperature_c: NDArray[np.float64],
    ) -> None:
        """Take many rows, values of shape (n, axes), that came without damage between them."""
        at = np.flatnonzero(~np.isnan(values).all(axis=1))
        if not len(at):
            self._blank += len(values)
            return
        damaged = np.zeros(len(at), np.bool_)
        damaged[0], self._damaged = self._damaged, False
        blank = np.diff(at, prepend=-1) - 1
        blank[0] += self._blank
        self._blank = len(values) - 1 - int(at[-1])
        self._collect()
        times = device_s[at] / self._time_per_second
        hosts = np.full(len(at), host_s)
        self._tables.append(RowTable(values[at], times, hosts, temperature_c[at], damaged, blank))

    def note_damage(self) -> None:
        """Note that something was unreadable."""
        self._damaged = True

    def interrupt(self, reason: GapReason) -> None:
        """Note that the stream was interrupted: the next Block follows a Gap of this reason.

        Rows that were still held back are given up: they are too few to say what they mean.
        """
        self._single, self._tables = [], []
        self._damaged, self._blank = False, 0
        self._continuity.interrupt(reason)

    def change(self) -> list[Event]:
        """Note that the rows that follow mean something else; return what was held back."""
        events = self.events(final=True)
        self._interpretation = None
        self._time_per_second = 1.0
        return events

    def events(self, final: bool = False) -> list[Event]:
        """Return the events of the rows since the last call; of all rows if `final`."""
        events: list[Event] = []
        self._collect()
        if not self._tables:
            return events
        pending: RowTable | None = RowTable.joined(self._tables)
        while pending:
            if self._interpretation is not None:
                pending, waits = self._deliver(self._interpretation, pending, events, final)
                if waits:
                    break
                continue
            held = self._held(pending)
            if len(pending) < held and not final:
                break
            pending = self._settle(pending, events, held)
        self._tables = [pending] if pending and not final else []
        return events

    def _collect(self) -> None:
        """Put the single rows that came last into a table."""
        if self._single:
            self._tables.append(RowTable.of(self._single))
            self._single = []

    def _held(self, pending: RowTable) -> int:
        """Return how many rows to look at before it is decided what they mean."""
        times = pending.device_s[: 4 * HELD].tolist()
        if self._patience == HELD or not math.isnan(pending.host_s[0]) or len(times) < HELD:
            return HELD
        if math.isnan(times[0]) or (len(times) == 4 * HELD and _even(times)):
            return HELD
        return self._patience

    def _settle(self, pending: RowTable, events: list[Event], held: int) -> RowTable:
        """Decide what the rows mean and return them; without those that mean nothing."""
        first = [pending.row(i) for i in range(min(held, len(pending)))]
        interpretation = self._interpretation = self._decide(first)
        if interpretation is None:
            self._stats.unknown += len(first)
            return pending[len(first) :]
        self._plausibility.restart()
        if interpretation.time_per_second != self._time_per_second:
            self._time_per_second = interpretation.time_per_second
            pending = replace(pending, device_s=pending.device_s / interpretation.time_per_second)
        whole = pending[:HELD].whole(interpretation)
        blank = float(np.median(whole.blank_before[1:])) if len(whole) > 1 else 0.0
        resolution_s = interpretation.info.time_resolution_s
        self._continuity.interrupt("restarted")
        self._continuity.learn(
            pending[:held].whole(interpretation).device_s.tolist(),
            resolution_s,
            interpretation.farthest_s,
            blank_is_lost=blank == 0.0,
        )
        events.append(interpretation.info)
        assumed = {"host": 1, "assumed": 1}
        events += [Notice("text", remark, assumed) for remark in interpretation.remarks]
        return pending

    def _deliver(
        self, interpretation: Interpretation, pending: RowTable, events: list[Event], final: bool
    ) -> tuple[RowTable | None, bool]:
        """Deliver rows; return those that are left, and whether they wait for one after them.

        Rows about which there is nothing to say are taken together; what is said of the others
        they would be told, too, one by one.
        """
        rows = pending.whole(interpretation)
        self._blank += pending.blank_at_end(interpretation)
        if not len(rows):
            return None, False
        counts, agree = interpretation.convert(rows.values)
        checks = self._plausibility.check(counts[agree])
        between = self._continuity
        lost = between.blank_losses(rows.blank_before)
        again = _Again(rows.values, self._last)
        alone = ~agree | rows.damaged_before | (lost > 0) | again.rows(between.lookahead > 1)
        alone = np.append(np.flatnonzero(alone), len(rows))
        start = i = 0
        while i < len(rows):
            until = int(alone[np.searchsorted(alone, i)])
            count = between.accept(rows.device_s[i : i + checks.count_sound(until - i)])
            if count:
                checks.skip(count)
                i += count
                continue
            row, agrees = rows.row(i), bool(agree[i])
            ahead = i + between.lookahead
            missing = between.missing(row, rows.device_s[i + 1 : ahead + 1], again.at(i))
            doubtful = agrees and between.needs_confirmation(row, missing)
            failed = not agrees and self._failed(interpretation, row)
            suspect = agrees and checks.next(row.damaged_before)
            waits = doubtful and (i + 1 if final else ahead) >= len(rows)
            if failed or waits or (suspect and checks.is_last and not final):
                self._block(rows[start:i], counts[start:i], events)
                self._interpretation = None if failed else interpretation
                self._plausibility.update(counts[:i][agree[:i]])
                self._last = rows.values[i - 1].copy() if i else self._last
                return rows[i:], not failed
            twice = missing == "repeat" and agrees and again.at(i)
            doubtful = doubtful and missing != "repeat"
            unsound = not agrees or (doubtful and not between.is_confirmed(row, rows.row(i + 1)))
            if unsound or suspect or twice:
                self._block(rows[start:i], counts[start:i], events)
                damaged = _IMPOSSIBLE if not agrees else _ODD_TIME if unsound else ""
                self._leave_out(row, _AGAIN if twice else damaged, events)
                start = i = i + 1
                continue
            gap = between.update(row, missing)
            if gap is not None:
                self._block(rows[start:i], counts[start:i], events)
                self._append_gap(gap, events)
                self._explain_gap(row, missing == "back", int(lost[i]), events)
                start = i
            i += 1
        self._block(rows[start:], counts[start:], events)
        self._plausibility.update(counts[agree])
        self._last = rows.values[-1].copy()  # and not all the rows
        return None, False

    def _explain_gap(self, row: Row, back: bool, blank: int, events: list[Event]) -> None:
        """Say of a file why rows are missing, as far as they say so themselves."""
        if back:
            self._report_row(row, "the time goes back: a gap of unknown length", events)
        elif blank:
            self._report_row(row, _blank_remark(blank), events)

    def _leave_out(self, row: Row, why: str, events: list[Event]) -> None:
        """Note a row that is left out: damaged or there twice if it is said why, else suspect."""
        if why:
            self._report_row(row, why, events)
        if why == _AGAIN:
            return
        if why:
            self._stats.resyncs += 1
            self._plausibility.note_damage()
        else:
            self._stats.suspect += 1
        self._continuity.note_discarded()

    def _report_row(self, row: Row, what: str, events: list[Event]) -> None:
        """Say what is wrong with a row of a file; of a live stream the counters are seen."""
        if self._reported == _MOST_REPORTED or not math.isnan(row.host_s):
            return
        self._reported += 1
        at = "" if math.isnan(row.device_s) else f", time {row.device_s:.6g} s"
        events.append(Notice("error", f"sample {self._index}{at}: {what}"))

    def _failed(self, interpretation: Interpretation, row: Row) -> bool:
        """Note a row that does not fit; return whether it is the interpretation that does not.

        It is where a fifth of the last rows do not fit, or where a few of the last thousand do
        not and have another interpretation in common. Damaged rows have nothing in common.
        """
        now = self._continuity.accepted
        self._misfits = [misfit for misfit in self._misfits if misfit[0] > now - _FORGOTTEN]
        self._misfits.append((now, row.values))
        wrong = sum(number > now - HELD for number, _ in self._misfits) > HELD // 5
        if not wrong and len(self._misfits) > _FORGIVEN:
            wrong = interpretation.fits_another(np.array([row for _, row in self._misfits]))
        if wrong:
            self._misfits.clear()
        return wrong

    def _append_gap(self, gap: Gap, events: list[Event]) -> None:
        self._stats.lost_samples += gap.lost or 0
        self._stats.unknown_losses += gap.lost is None
        self._index += gap.lost or 0
        events.append(gap)

    def _block(self, rows: RowTable, counts: NDArray[np.generic], events: list[Event]) -> None:
        if not len(rows):
            return
        events.append(Block(self._index, counts, rows.ticks()))
        self._index += len(rows)
        self._stats.samples += len(rows)


def _blank_remark(count: int) -> str:
    """Return what to say of rows without all their values.

    >>> _blank_remark(2)
    'the 2 rows before it have blank cells, NaN or zeros only: lost samples'
    """
    if count == 1:
        return "the row before it has blank cells, NaN or zeros only: a lost sample"
    return f"the {count} rows before it have blank cells, NaN or zeros only: lost samples"


class _Again:
    """Which rows have the values of the row before, the first those of `last`."""

    def __init__(self, values: NDArray[np.float64], last: NDArray[np.float64]) -> None:
        self._values = values
        self._last = last

    def at(self, i: int) -> bool:
        """Return whether row i has."""
        before = self._values[i - 1] if i else self._last
        return np.array_equal(self._values[i], before, equal_nan=True)

    def rows(self, asked: bool) -> NDArray[np.bool_]:
        """Return it of all rows, none if not asked: of a precise clock the time says it first."""
        again = np.zeros(len(self._values), np.bool_)
        if not asked:
            return again
        again[0] = self.at(0)
        column = self._values[:, int(np.isfinite(self._values[0]).argmax())]
        for i in (np.flatnonzero(column[1:] == column[:-1]) + 1).tolist():
            again[i] = self.at(i)
        return again


def _even(times: list[float]) -> bool:
    """Return whether all steps are alike: these are no bursts, and no polling loop's."""
    steps = np.diff(np.asarray(times, np.float64))
    middle = float(np.median(steps)) if np.isfinite(steps).all() else math.nan
    off = np.abs(steps - middle)
    return bool(middle > 0.0 and off.max() < 0.5 * middle and steps.std() < _ALIKE * middle)
