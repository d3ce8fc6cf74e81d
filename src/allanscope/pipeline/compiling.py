"""The compiled code: loaded before the first byte comes, with a line when it must be made first.

The loops through which every sample goes are compiled by numba when they are first called, and kept
on disk from then on. That takes some ten seconds once, in which nothing else seems to happen, so it
is said; and because numba itself tells when it really compiles, it is never said in vain. Loading
takes a second, more than a board can buffer: so everything runs once before the port is read.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable

from allanscope.analysis import Analyser, AnalyserSettings, summarise
from allanscope.simulator import Simulator
from allanscope.spectrum import SEGMENT
from allanscope.wire import LinkStats, format_named, formats

__all__ = ["COMPILING", "load_kernels", "tell_when_compiling"]

COMPILING = "compiling the kernels for this machine: once, about a quarter of a minute"

_TOLD = threading.Event()


def _on_stderr(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def tell_when_compiling(say: Callable[[str], None] = _on_stderr) -> None:
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


def load_kernels(wire: str) -> None:
    """Take as many samples as a spectrum needs through everything that live samples go through."""
    for name in (wire,) if wire else formats():
        format_named(name).load_kernels()
    sensor = Simulator(rate=104.0, seed=0)
    analyser = Analyser(AnalyserSettings())
    analyser.take(sensor.info)
    analyser.take(sensor.read(2 * SEGMENT))
    summarise(analyser, LinkStats(), "live", {})
