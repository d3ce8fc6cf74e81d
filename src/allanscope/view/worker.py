"""A thread that does what it is told, in order, and never makes anyone wait.

Whoever measures hands work over and goes on. When the work cannot be done as fast as it comes, what
comes next is dropped and counted: a chart with a gap is worth less than a sample, always.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

__all__ = ["Task", "Worker"]

Task = Callable[[], None]


class Worker:
    """A bounded queue and the thread that empties it.

    Parameters
    ----------
    name : str
        Of the thread.
    room : int
        Most tasks that may wait.

    Attributes
    ----------
    dropped : int
        Tasks that found no room.
    failed : int
        Tasks that raised; `error` holds the first exception. A chart that cannot be drawn must
        not end a measurement.
    """

    def __init__(self, name: str, room: int = 256) -> None:
        self.dropped = 0
        self.failed = 0
        self.error: Exception | None = None
        self._tasks: queue.Queue[tuple[str, Task] | None] = queue.Queue(room)
        self._waiting: set[str] = set()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, task: Task, once: str = "") -> bool:
        """Queue a task; return False, at once, when there is no room for it.

        A task with a name in `once` is not queued again while one of that name still waits: for
        work that, whenever it is done, takes up all there is by then.
        """
        if once:
            if once in self._waiting:
                return True
            self._waiting.add(once)
        try:
            self._tasks.put_nowait((once, task))
        except queue.Full:
            self._waiting.discard(once)
            self.dropped += 1
            return False
        return True

    def settle(self, timeout_s: float) -> bool:
        """Wait until everything submitted so far is done; return False when that takes longer."""
        done = threading.Event()
        deadline = time.monotonic() + timeout_s
        try:
            self._tasks.put(("", done.set), timeout=timeout_s)
        except queue.Full:
            return False
        return done.wait(max(0.0, deadline - time.monotonic()))

    def close(self, last: Task, timeout_s: float) -> bool:
        """Do what waits, then `last`, then end; give up after `timeout_s` and return False."""
        deadline = time.monotonic() + timeout_s
        try:
            self._tasks.put(("", last), timeout=timeout_s)
            self._tasks.put(None, timeout=max(0.0, deadline - time.monotonic()))
        except queue.Full:
            return False
        self._thread.join(max(0.0, deadline - time.monotonic()))
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (entry := self._tasks.get()) is not None:
            once, task = entry
            self._waiting.discard(once)
            try:
                task()
            except Exception as error:
                self.failed += 1
                self.error = self.error or error
