"""What is to do and what has come back, recording by recording, and the last words about it.

Whom a recording is handed to is Dask's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from allanscope.fleet.inputs import RecordingInput
from allanscope.fleet.outcome import Loss, Outcome
from allanscope.fleet.store import Folder, Store
from allanscope.pipeline import DeviceSettings
from allanscope.quantities import counted

if TYPE_CHECKING:
    from distributed import Future

    from allanscope.fleet.acceptance import Acceptance
    from allanscope.fleet.cluster import WorkerPool

__all__ = ["FleetResult", "WorkQueue", "problem_lines", "summary_lines"]

PART_BYTES = 128 << 20
"""Of packed bytes: smaller parts cost more in a second decoding than they gain."""

MOST_LINES = 20
"""Of one kind; the report has them all."""


@dataclass(slots=True)
class FleetResult:
    """How a fleet ended.

    Attributes
    ----------
    keys : dict of str to str
        Path of each recording that has a result, and the name of that.
    done : int
        Results that this run added.
    failures : dict of str to str
        Path of each recording without a result, and one line why.
    left : int
        Recordings that were not looked at because the run was stopped.
    copies : dict of str to str
        Path of each recording that is left out of the lot, and of the one that it is a copy of.
    losses : list of Loss
        Recordings that are not complete, those that lost most first.
    acceptance : Acceptance or None
        The lot against limits.
    table, report : Path, RemotePath or None
        What was written.
    """

    keys: dict[str, str] = field(default_factory=dict)
    done: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    left: int = 0
    copies: dict[str, str] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)
    acceptance: Acceptance | None = None
    table: Folder | None = None
    report: Folder | None = None


class WorkQueue:
    """What is to do and what has come back."""

    def __init__(self, store: Store, items: Iterable[RecordingInput]) -> None:
        self.result = FleetResult()
        self.todo: deque[RecordingInput] = deque()
        self.is_deserted = False
        self._store = store
        self._looked_up: set[str] = set()
        for item in items:
            self._consider(item)

    def submit(
        self, pool: WorkerPool, item: RecordingInput, device: DeviceSettings, idle: int
    ) -> Future:
        """Hand out one recording while so many workers are idle.

        One that may be known is only looked at; a large one is split among workers that no other
        recording waits for.
        """
        from allanscope.fleet.split import submit_split
        from allanscope.fleet.worker_tasks import analyse_recording, fingerprint_recording

        if self._store.may_contain(item) and item.url not in self._looked_up:
            return pool.submit(fingerprint_recording, item, device, pure=False)
        parts = self._parts(item, idle)
        if parts > 1:
            return submit_split(pool, item, device, parts)
        return pool.submit(analyse_recording, item, device, pure=False)

    def record(self, item: RecordingInput, outcome: Outcome) -> bool:
        """Keep what came back; return whether the recording is done with."""
        if not outcome.is_of_this_version:
            self.todo.append(item)
            return False
        if outcome.error:
            self.result.failures[item.url] = outcome.error
            self.todo.extend(item.later)
            return True
        key = self._store.note(item, outcome)
        if outcome.result:
            self._store.put(key, outcome.result)
            self.result.done += 1
        elif not self._store.has(key):
            self._looked_up.add(item.url)
            self.todo.append(item)
            return False
        self._finish(item, key, outcome.files)
        return True

    def _parts(self, item: RecordingInput, idle: int) -> int:
        """Return in how many parts a recording is worth doing: many workers, and much of it."""
        return min(idle - len(self.todo), item.bytes // PART_BYTES)

    def _consider(self, item: RecordingInput) -> None:
        key = self._store.known(item)
        if key:
            self._finish(item, key, self._store.files_of(item))
        else:
            self.todo.append(item)

    def _finish(self, item: RecordingInput, key: str, files: tuple[str, ...]) -> None:
        self.result.keys[item.url] = key
        for one in item.later:
            if one.name not in files:  # numbered like a part of this session, but of another
                self._consider(one)


def problem_lines(result: FleetResult) -> list[str]:
    """Return what went wrong, recording by recording, the worst first.

    Examples
    --------
    >>> problem_lines(FleetResult(failures={"c": "c is empty"}, copies={"b": "a"}, left=2))
    ['c is empty', 'b is a copy of a: left out of the lot',
     'stopped before it was done; 2 recordings left: repeat the command to continue']
    """
    copies = [
        f"{one} is a copy of {other}: left out of the lot"
        for one, other in sorted(result.copies.items())
    ]
    lines = [*result.failures.values(), *_some([str(one) for one in result.losses]), *_some(copies)]
    if result.left:
        left = f"{counted(result.left, 'recording')} left"
        lines.append(f"stopped before it was done; {left}: repeat the command to continue")
    return lines


def summary_lines(result: FleetResult) -> list[str]:
    """Return what was done, what was not, and where it is.

    Examples
    --------
    >>> summary_lines(FleetResult({"a": "1", "b": "2"}, 1, {"c": "c is empty"}, left=4))
    ['2 recordings analysed, 1 of them earlier; 1 failed; 4 left: repeat the command to continue']
    """
    ready = len(result.keys)
    before = ready - result.done
    text = f"{counted(ready, 'recording')} analysed"
    if before:
        text += f", {before} of them earlier" if result.done else " earlier"
    if result.copies:
        text += f", {len(result.copies)} of them copies"
    if result.losses:
        text += f"; {len(result.losses)} incomplete"
    if result.failures:
        text += f"; {len(result.failures)} failed"
    if result.left:
        text += f"; {result.left} left: repeat the command to continue"
    files = [f"Saved: {path}" for path in (result.table, result.report) if path is not None]
    accepted = [] if result.acceptance is None else [result.acceptance.words]
    return [text, *accepted, *files]


def _some(lines: Sequence[str]) -> list[str]:
    more = len(lines) - MOST_LINES
    return [*lines[:MOST_LINES], *([f"and {more} more like this"] if more > 0 else [])]
