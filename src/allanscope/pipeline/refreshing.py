"""The result while a run goes on: computed beside it, as often as that costs next to nothing."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

from allanscope.analysis import Analyser
from allanscope.pipeline.memory import let_go_of_what_rests

__all__ = ["Refresher"]

REFRESH_S = 1.0
"""No result comes sooner after the last one."""

FRESH_S, OLDEST_S, OLDEST_SHARE = 5.0, 60.0, 0.1
"""No result grows older than this share of the run, within these limits: whatever it costs, people
watch the first minute, and nobody believes a number that stands for ten."""


class Refresher:
    """Computes results in a thread of its own, as often as the machine can bear.

    At the beginning they come more often than their share allows, whenever the run has become
    three times as long: the curves grow with the logarithm of time. And however little it allows,
    in the first minute one comes every 5 s, and later before the last one is older than a tenth of
    the run, or a minute.

    Parameters
    ----------
    show : callable
        Computes a result from a copy of the analyser, and shows it.
    share : float
        Of one core, that results may take where they are not due anyway.

    Attributes
    ----------
    error : Exception or None
        Why the last result that failed did so: it must not end the recording.
    """

    def __init__(self, show: Callable[[Analyser], None], share: float) -> None:
        self._show = show
        self._share = share
        self._next = 0.0
        self._began: float | None = None
        self._work: queue.Queue[Analyser | None] = queue.Queue(maxsize=1)
        self._busy = threading.Event()
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="refresh", daemon=True)
        self._thread.start()

    def offer(self, analyser: Analyser) -> None:
        """Take a copy of the analyser if a refresh is due and none is running."""
        now = time.monotonic()
        if self._began is None:
            self._began = now
        if self._busy.is_set() or now < self._next:
            return
        self._busy.set()
        self._work.put(analyser.frozen())

    def close(self) -> None:
        """Wait for a refresh that is running, and end."""
        self._work.put(None)
        self._thread.join(timeout=30.0)

    def _run(self) -> None:
        results = 0
        while (frozen := self._work.get()) is not None:
            began_s, began_cpu_s = time.monotonic(), time.thread_time()
            try:
                self._show(frozen)
            except Exception as error:
                self.error = error
            spent_s = time.thread_time() - began_cpu_s
            del frozen  # twenty megabytes that nobody needs until the next one
            results += 1
            if results.bit_count() == 1:  # ever more rarely: each may have loaded code of its own
                let_go_of_what_rests()
            now = time.monotonic()
            self._next = now + _pause(
                now - (self._began or now), spent_s / self._share, now - began_s
            )
            self._busy.clear()


def _pause(run_s: float, wanted_s: float, took_s: float) -> float:
    """Return how long to wait after a result.

    Parameters
    ----------
    run_s : float
        Length of the run.
    wanted_s : float
        What the share of the core asks for.
    took_s : float
        How long the last result took: the next one takes as long, and is to be there in time. But
        half of the time is left free on however slow a machine.

    Examples
    --------
    After 20 s, after 5 min and after a night, with results that take a second of processor time
    and a hundredth of a core:

    >>> [round(_pause(run_s, 100.0, 1.0), 1) for run_s in (20.0, 300.0, 40_000.0)]
    [4.0, 29.0, 59.0]
    """
    oldest_s = min(max(OLDEST_SHARE * run_s, FRESH_S), OLDEST_S)
    return max(min(wanted_s, oldest_s - took_s, 2 * run_s), took_s, REFRESH_S - took_s)
