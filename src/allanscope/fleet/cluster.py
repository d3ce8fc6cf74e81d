"""The engine: a LocalCluster on this machine, or an existing scheduler, and the workers of it.

All of it is Dask's. Of the workers, recordings are given to those with this version of allanscope:
a result is kept under the version of whoever started the fleet, so it must be made by that. Workers
are asked when they are first seen, and one with another version gets nothing as long as it is
there. What it was given in the moment before that is discarded and done again.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from allanscope.errors import UsageError

if TYPE_CHECKING:
    from distributed import Client, Future, LocalCluster

__all__ = [
    "WorkerPool",
    "connected",
    "dashboard_line",
    "dask_setup",
    "local_cluster",
    "require_extra",
]

NEEDED = ("dask", "distributed", "fsspec", "pyarrow")
REACH_S = 10
_LOOPBACK = "127.0.0.1"
_WORKER_ENVIRONMENT = dict.fromkeys(
    ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"
)
"""As Dask sets it, but for MALLOC_TRIM_THRESHOLD_: with that every array above 128 kB is asked of
the system anew, and a fifth of a worker's time goes into clearing pages."""

_NEVER = "10000 days"
"""A cluster looks so long after a worker died whether one of its name is there, and gives the name
up if not. After the 15 s that Dask means, that can be while a later one is being replaced: the
cluster would wait for a worker for ever."""

MOST_ORPHANED = 3
"""So often a recording may lose all workers that it was given to."""


def require_extra() -> None:
    """Make sure that what the fleet needs is installed.

    Raises
    ------
    UsageError
        If it is not: one line that says what to install.
    """
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise UsageError(
            f"a fleet needs {', '.join(missing)}: pip install '.[fleet]' in the folder of the "
            "sources"
        )


@contextmanager
def connected(scheduler: str, workers: int | None) -> Iterator[Client]:
    """Give a client of the scheduler at an address, or of a cluster of this machine without one.

    Raises
    ------
    UsageError
        If there is no answer at the address.
    """
    import logging

    from distributed import Client

    # A lost scheduler is reported in one line, by whoever asked for the fleet.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    if scheduler:
        try:
            client = Client(scheduler, timeout=REACH_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise UsageError(
                f"no Dask scheduler answers at {scheduler} ({_plain(error)}); start one with: "
                "dask scheduler"
            ) from None
        with client:
            yield client
        return
    with local_cluster(workers) as cluster, Client(cluster, set_as_default=False) as client:
        yield client
        # A cluster that is closed while it replaces a worker may never end.
        with suppress(TimeoutError):
            client.wait_for_workers(len(cluster.workers), timeout=REACH_S)


@contextmanager
def local_cluster(
    workers: int | None, memory_limit: str = "auto", preload: Sequence[str] = ()
) -> Iterator[LocalCluster]:
    """Give a cluster of this machine, which listens on the loopback interface only.

    Its workers are processes with one thread each, because much of an analysis holds the
    interpreter's lock; one for each core by default.

    Parameters
    ----------
    workers : int or None
        Processes.
    memory_limit : str
        Of each, as Dask writes it; one that takes more is replaced. "auto" is its share of the
        machine.
    preload : sequence of str
        Modules or files that each worker runs first, besides our own.
    """
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set(
            {
                "distributed.nanny.pre-spawn-environ": _WORKER_ENVIRONMENT,
                "distributed.deploy.lost-worker-timeout": _NEVER,
                # A worker is looked at a hundred times a second for what it does, fifty times for
                # whether it answers, and ten times for its memory: a fiftieth of all time.
                "distributed.worker.profile.enabled": False,
                "distributed.admin.tick.interval": "1s",
                "distributed.admin.system-monitor.interval": "2s",
                "distributed.worker.memory.monitor-interval": "500ms",
            }
        ),
        LocalCluster(
            n_workers=workers or os.cpu_count() or 1,
            threads_per_worker=1,
            processes=True,
            host=_LOOPBACK,
            # Any free port: a second fleet on the same machine must not be in the way.
            dashboard_address=f"{_LOOPBACK}:0",
            silence_logs=50,
            memory_limit=memory_limit,
            preload=["allanscope.fleet.cluster", *preload],
        ) as cluster,
    ):
        yield cluster


def dashboard_line(client: Client) -> str:
    """Say where the dashboard is, or why there is none; an address alone does not mean there is."""
    if not client.run_on_scheduler(_has_bokeh):
        return "no dashboard: bokeh is not installed where the scheduler runs (pip install bokeh)"
    return f"dashboard: {client.dashboard_link}"


def _has_bokeh() -> bool:
    return find_spec("bokeh") is not None


def _plain(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


class WorkerPool:
    """The workers of a cluster that have the right version.

    Parameters
    ----------
    client : Client
        Of the cluster.
    print_error : callable
        Takes one line for each worker that is refused.

    Attributes
    ----------
    threads : int
        Tasks that can run at a time.
    """

    def __init__(self, client: Client, print_error: Callable[[str], None]) -> None:
        self.threads = 0
        self._client = client
        self._print_error = print_error
        self._own = version("allanscope")
        self._versions: dict[str, str] = {}
        self._here: set[str] = set()
        self._allowed: list[str] | None = None
        self._given: dict[str, frozenset[str]] = {}
        self.refresh()
        if self._here and self._allowed == []:
            raise UsageError(
                f"no worker has allanscope {self._own}; install the version of this command there"
            )

    def refresh(self) -> None:
        """See which workers there are now, and ask new ones for their version."""
        threads = self._client.nthreads()
        self._here = set(threads)
        new = [worker for worker in threads if worker not in self._versions]
        if new:
            self._request_versions(new)
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

    def without_worker(self, futures: Iterable[Future]) -> list[Future]:
        """Return the tasks whose workers are all gone."""
        return [
            future
            for future in futures
            if future.key in self._given and not self._given[future.key] & self._here
        ]

    def _request_versions(self, workers: list[str]) -> None:
        # A function of the standard library: another version may not have one of ours.
        answers = self._client.run(version, "allanscope", workers=workers, on_error="return")
        for worker, answer in answers.items():
            if isinstance(answer, OSError):
                continue  # gone since; if it comes back it is asked again
            found = answer if isinstance(answer, str) else ""
            self._versions[worker] = found
            if found != self._own:
                has = f"has allanscope {found}" if found else "has no allanscope"
                self._print_error(
                    f"worker {worker} {has}, this is {self._own}: it gets no recordings; "
                    "install the same version there"
                )


def dask_setup(worker: Any) -> None:
    """Leave Ctrl-C to whoever started the fleet; Dask calls this in each worker that preloads us.

    A terminal sends it to every process; workers that died of it would take their tasks along
    before the fleet could end in order.
    """
    del worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
