"""The workers that recordings are given to: those with this version of allanscope.

A result is kept under the version of whoever started the fleet, so it must be made by that. Workers
of a cluster are asked when they are first seen, and one with another version gets nothing as long
as it is there. What it was given in the moment before that is thrown away and done again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from allanscope.errors import UsageError

if TYPE_CHECKING:
    from distributed import Client, Future

__all__ = ["Crew"]

MOST_STRANDED = 3
"""So often a recording may lose all workers that it was given to."""


class Crew:
    """The workers of a cluster that have the right version.

    Parameters
    ----------
    client : Client
        Of the cluster.
    complain : callable
        Takes one line for each worker that is refused.

    Attributes
    ----------
    threads : int
        Tasks that can run at a time.
    """

    def __init__(self, client: Client, complain: Callable[[str], None]) -> None:
        self.threads = 0
        self._client = client
        self._complain = complain
        self._own = version("allanscope")
        self._versions: dict[str, str] = {}
        self._here: set[str] = set()
        self._allowed: list[str] | None = None
        self._given: dict[str, frozenset[str]] = {}
        self.look()
        if self._here and self._allowed == []:
            raise UsageError(
                f"no worker has allanscope {self._own}; install the version of this command there"
            )

    def look(self) -> None:
        """See which workers there are now, and ask new ones for their version."""
        threads = self._client.nthreads()
        self._here = set(threads)
        new = [worker for worker in threads if worker not in self._versions]
        if new:
            self._ask(new)
        good = [worker for worker in threads if self._versions.get(worker) == self._own]
        known = [worker for worker in threads if worker in self._versions]
        # Without a bad one nothing is tied to an address, which a restarted worker changes.
        self._allowed = None if len(good) == len(known) else sorted(good)
        self.threads = sum(threads[worker] for worker in good)

    def submit(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Future:
        """Hand out a task, as `Client.submit` does."""
        if self._allowed is None:
            return self._client.submit(function, *arguments, **options)
        future = self._client.submit(function, *arguments, workers=self._allowed, **options)
        self._given[future.key] = frozenset(self._allowed)
        return future

    def stranded(self, futures: Iterable[Future]) -> list[Future]:
        """Return the tasks whose workers are all gone."""
        return [
            future
            for future in futures
            if future.key in self._given and not self._given[future.key] & self._here
        ]

    def _ask(self, workers: list[str]) -> None:
        # A function of the standard library: another version may not have one of ours.
        answers = self._client.run(version, "allanscope", workers=workers, on_error="return")
        for worker, answer in answers.items():
            if isinstance(answer, OSError):
                continue  # gone since; if it comes back it is asked again
            found = answer if isinstance(answer, str) else ""
            self._versions[worker] = found
            if found != self._own:
                has = f"has allanscope {found}" if found else "has no allanscope"
                self._complain(
                    f"worker {worker} {has}, this is {self._own}: it gets no recordings; "
                    "install the same version there"
                )
