"""The result while a run goes on: computed beside it, as often as that costs next to nothing."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

from allanscope.analysis.analyser import Analyser
from allanscope.pipeline.memory import let_go_of_what_rests

__all__ = ["Refresher"]

REFRESH_S = 1.0
"""No result comes sooner after the last one."""


class Refresher:
    """Computes results in a thread of its own, as often as the machine can bear.

    At the beginning they come more often than their share allows, whenever the run has become
    three times as long: the curves grow with the logarithm of time.

    Parameters
    ----------
    show : callable
        Computes a result from a copy of the analyser, and shows it.
    share : float
        Of one core, that results may take.

    Attributes
    ----------
    error : Exception or None
        Why the last result that failed did so: it must not end the recording.
    """

    def __init__(self, show: Callable[[Analyser], None], share: float) -> None:
        self._show = show
        self._share = share
        self._next = 0.0
        self._began = time.monotonic()
        self._work: queue.Queue[Analyser | None] = queue.Queue(maxsize=1)
        self._busy = threading.Event()
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="refresh", daemon=True)
        self._thread.start()

    def offer(self, analyser: Analyser) -> None:
        """Take a copy of the analyser if a refresh is due and none is running."""
        if self._busy.is_set() or time.monotonic() < self._next:
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
            pause_s = min(spent_s / self._share, 2 * (now - self._began))
            self._next = max(began_s + REFRESH_S, now + pause_s)
            self._busy.clear()
