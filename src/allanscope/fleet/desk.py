"""What is to do and what has come back, recording by recording; whom it is handed to is Dask's."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from allanscope.fleet.losses import Loss
from allanscope.fleet.outcome import Outcome
from allanscope.fleet.places import Place
from allanscope.fleet.result_folder import Folder
from allanscope.fleet.store import Store
from allanscope.pipeline.settings import DeviceSettings

if TYPE_CHECKING:
    from distributed import Future

    from allanscope.fleet.crew import Crew

__all__ = ["Desk", "FleetResult"]

PART_BYTES = 128 << 20
"""Of packed bytes: smaller parts cost more in a second decoding than they gain."""


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
    table, report : Path, RemotePath or None
        What was written.
    """

    keys: dict[str, str] = field(default_factory=dict)
    done: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    left: int = 0
    copies: dict[str, str] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)
    table: Folder | None = None
    report: Folder | None = None


class Desk:
    """What is to do and what has come back."""

    def __init__(self, store: Store, places: Iterable[Place]) -> None:
        self.result = FleetResult()
        self.todo: deque[Place] = deque()
        self.is_deserted = False
        self._store = store
        self._looked_up: set[str] = set()
        for place in places:
            self._consider(place)

    def submit(self, crew: Crew, place: Place, device: DeviceSettings, idle: int) -> Future:
        """Hand out one recording while so many workers are idle.

        One that may be known is only looked at; a large one is split among workers that no other
        recording waits for.
        """
        from allanscope.fleet.split import submit_split
        from allanscope.fleet.work import analyse_place, fingerprint_place

        if self._store.may_know(place) and place.url not in self._looked_up:
            return crew.submit(fingerprint_place, place, pure=False)
        parts = self._parts(place, idle)
        if parts > 1:
            return submit_split(crew, place, device, parts)
        return crew.submit(analyse_place, place, device, pure=False)

    def take(self, place: Place, outcome: Outcome) -> bool:
        """Keep what came back; return whether the recording is done with."""
        if not outcome.is_of_this_version:
            self.todo.append(place)
            return False
        if outcome.error:
            self.result.failures[place.url] = outcome.error
            self.todo.extend(place.later)
            return True
        key = self._store.note(place, outcome)
        if outcome.result:
            self._store.put(key, outcome.result)
            self.result.done += 1
        elif not self._store.has(key):
            self._looked_up.add(place.url)
            self.todo.append(place)
            return False
        self._finish(place, key, outcome.files)
        return True

    def _parts(self, place: Place, idle: int) -> int:
        """Return in how many parts a recording is worth doing: many workers, and much of it."""
        return min(idle - len(self.todo), place.bytes // PART_BYTES)

    def _consider(self, place: Place) -> None:
        key = self._store.known(place)
        if key:
            self._finish(place, key, self._store.files_of(place))
        else:
            self.todo.append(place)

    def _finish(self, place: Place, key: str, files: tuple[str, ...]) -> None:
        self.result.keys[place.url] = key
        for one in place.later:
            if one.name not in files:  # numbered like a part of this session, but of another
                self._consider(one)
