"""What lies between one row and the next: nothing, a hole of known length, or one of unknown."""

from __future__ import annotations

import math
from typing import Literal

from allanscope.samples import Gap, GapReason
from allanscope.wire.pacing import Pacer
from allanscope.wire.row import Row
from allanscope.wire.standstill import Standstill

__all__ = ["Continuity", "Missing"]

Missing = int | Literal["back"] | None
"""As `Pacer.missing` has it."""


class Continuity:
    """Follows the rows that are accepted, by their time stamps where they have any.

    Parameters
    ----------
    checked : bool
        Whether rows come with a checksum: a jump of the time where a damaged one was is then
        believed at once.

    Attributes
    ----------
    accepted : int
        Rows so far.
    """

    def __init__(self, checked: bool = False) -> None:
        self.accepted = 0
        self._checked = checked
        self._times: list[float] = []
        self._resolution_s = 0.0
        self._farthest_s: float | None = None
        self._pacer: Pacer | None = None
        self._standstill = Standstill()
        self._due: GapReason | None = None
        self._discarded = False

    def learn(
        self, times: list[float], resolution_s: float, farthest_s: float | None = None
    ) -> None:
        """Take the times of some rows, and the step of their clock, to see how they are paced.

        Where `farthest_s` is given the times do not tell single losses, only steps above it.
        """
        self._times = times
        self._resolution_s = resolution_s
        self._farthest_s = farthest_s
        self._start_over()

    def interrupt(self, reason: GapReason) -> None:
        """Note why the next row does not follow the last one; the first reason stands."""
        if self.accepted and self._due is None:
            self._due = reason

    def missing(self, row: Row) -> Missing:
        """Return what is missing before a row."""
        if self.accepted == 0:
            return 0
        if self._due is not None:
            self._start_over()
            return 0
        damaged = row.damaged_before or self._discarded
        if not self._timed(row):
            return None if damaged or self._standstill.jumped(row.device_s) else 0
        assert self._pacer is not None
        return self._pacer.missing(row.device_s, damaged)

    def in_doubt(self, row: Row, missing: Missing) -> bool:
        """Return whether the time of a row is to be believed only if the next one bears it out."""
        if self._pacer is None or not self._timed(row) or (self._checked and row.damaged_before):
            return False
        return missing != 0 or self._pacer.fresh

    def borne_out(self, row: Row, after: Row) -> bool:
        """Return whether the row after one that is in doubt agrees with it."""
        return self._pacer is None or self._pacer.believable(
            row.device_s, after.device_s, apart=after.damaged_before
        )

    def discard(self) -> None:
        """Note that a row was thrown away as damaged."""
        self._discarded = True

    def follow(self, row: Row, missing: Missing) -> Gap | None:
        """Accept a row and return the hole before it, if there is one."""
        self.accepted += 1
        due, self._due = self._due, None
        damaged, self._discarded = row.damaged_before or self._discarded, False
        self._standstill.follow(row.device_s)
        if self._pacer is not None and self._timed(row):
            self._pacer.follow(row.device_s, missing)
        if due is not None:
            return Gap(due, None)
        if missing == "back":
            return Gap("restarted", None)
        return None if missing == 0 else Gap("link" if damaged else "device", missing)

    def _timed(self, row: Row) -> bool:
        return self._pacer is not None and not math.isnan(row.device_s)

    def _start_over(self) -> None:
        if self._farthest_s is not None:
            self._pacer, self._standstill = None, Standstill(self._farthest_s)
            return
        self._pacer = Pacer.of(self._times, self._resolution_s)
        self._standstill = Standstill.of(self._times, self._resolution_s)
