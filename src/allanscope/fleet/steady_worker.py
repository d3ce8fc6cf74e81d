"""Preloaded by the workers of a local cluster: Ctrl-C is for whoever started the fleet to handle.

A terminal sends it to every process; workers that died of it would take their tasks along before
the fleet could end in order.
"""

from __future__ import annotations

import signal
from typing import Any

__all__ = ["dask_setup"]


def dask_setup(worker: Any) -> None:
    """Do as Dask asks of a preloaded module."""
    del worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
