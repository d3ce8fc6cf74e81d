"""A line for the first run on a machine, when the compiled code does not exist yet.

The loops through which every sample goes are compiled by numba when they are first called, and kept
on disk from then on. That takes some ten seconds once, in which nothing else seems to happen, so it
is said; and because numba itself tells when it really compiles, it is never said in vain.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

__all__ = ["COMPILING", "tell_when_compiling"]

COMPILING = "compiling the kernels for this machine: once, about a quarter of a minute"

_TOLD = threading.Event()


def tell_when_compiling(say: Callable[[str], None]) -> None:
    """Say `COMPILING` when numba begins to compile; once in a process, never for cached code."""
    from numba.core import event

    class Teller(event.Listener):
        def on_start(self, _: object) -> None:
            if not _TOLD.is_set():
                _TOLD.set()
                say(COMPILING)

        def on_end(self, _: object) -> None:
            """Nothing: whatever waited for it goes on."""

    event.register("numba:compile", Teller())  # type: ignore[no-untyped-call]
