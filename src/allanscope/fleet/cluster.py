"""The engine: a LocalCluster on this machine, or an existing scheduler. All of it is Dask's."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

from allanscope.errors import UsageError

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

__all__ = ["connected", "dashboard_line", "local_cluster", "require_extra"]

NEEDED = ("dask", "distributed", "fsspec", "pyarrow")
REACH_S = 10
_LOOPBACK = "127.0.0.1"
_WORKER_ENVIRONMENT = dict.fromkeys(
    ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"
)
"""As Dask sets it, but for MALLOC_TRIM_THRESHOLD_: with that every array above 128 kB is asked of
the system anew, and a fifth of a worker's time goes into clearing pages."""


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
        If nobody answers at the address.
    """
    import logging

    from distributed import Client

    # A scheduler that goes away is told of in one line, by whoever asked for the fleet.
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


def local_cluster(workers: int | None) -> LocalCluster:
    """Return a cluster of this machine, which listens on the loopback interface only.

    Its workers are processes with one thread each, because much of an analysis holds the
    interpreter's lock; one for each core if not told otherwise.
    """
    import dask
    from distributed import LocalCluster

    with dask.config.set({"distributed.nanny.pre-spawn-environ": _WORKER_ENVIRONMENT}):
        return LocalCluster(
            n_workers=workers or os.cpu_count() or 1,
            threads_per_worker=1,
            processes=True,
            host=_LOOPBACK,
            # Any free port: a second fleet on the same machine must not be in the way.
            dashboard_address=f"{_LOOPBACK}:0",
            silence_logs=50,
            preload=["allanscope.fleet.steady_worker"],
        )


def dashboard_line(client: Client) -> str:
    """Say where the dashboard is, or why there is none; an address alone does not mean there is."""
    if not client.run_on_scheduler(_has_bokeh):
        return "no dashboard: bokeh is not installed where the scheduler runs (pip install bokeh)"
    return f"dashboard: {client.dashboard_link}"


def _has_bokeh() -> bool:
    return find_spec("bokeh") is not None


def _plain(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
