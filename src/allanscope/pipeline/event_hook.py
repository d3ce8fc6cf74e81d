"""Call somebody when something happens: a command for each event, and a JSON line on a pipe.

Nothing of an event gets into a command line or a shell: the command is what the user wrote, split
into its words once, and the event comes on its standard input as one line of JSON. A command that
hangs is ended, and what comes while one runs waits; what comes too often is left out and counted.
The session never waits for it.
"""

from __future__ import annotations

import os
import queue
import shlex
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from allanscope.samples import Block, Gap, Notice, StreamInfo

__all__ = ["EventHook"]

MOST_WAITING = 16
MOST_AN_HOUR = 60
LONGEST_S = 60.0
"""A command that runs for longer is ended."""
PATIENCE_S = 5.0
"""So long the end of a run waits for commands that are still to be run."""


class EventHook:
    """Run a command and write a line for every event of a session.

    Parameters
    ----------
    command : str
        A program with its arguments, quoted as for a shell; empty for none.
    pipe : Path, optional
        A pipe, a file or ``/dev/fd/N`` that gets a line of JSON for each event.
    fail : callable
        Called with a line when either fails; from another thread.
    """

    def __init__(
        self,
        command: str = "",
        pipe: Path | None = None,
        fail: Callable[[str], object] = lambda _: None,
    ) -> None:
        self._words = shlex.split(command)
        self._pipe = pipe
        self.fail = fail
        self._begun: deque[float] = deque(maxlen=MOST_AN_HOUR)
        self._work: queue.Queue[str | None] = queue.Queue(MOST_WAITING)
        self._left_out = 0
        self._child: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name="events", daemon=True)
        self._thread.start()

    def info(self, info: StreamInfo) -> None:
        """Take what the samples mean: nothing to do."""

    def samples(self, info: StreamInfo, block: Block) -> None:
        """Take samples: nothing to do."""

    def gap(self, gap: Gap) -> None:
        """Take a gap: nothing to do."""

    def snapshot(self, analysis: object) -> None:
        """Take a result: nothing to do."""

    def notice(self, notice: Notice) -> None:
        """Take a remark, and pass an event on; never waits."""
        if notice.kind != "event":
            return
        try:
            self._work.put_nowait(str(notice.fields["event"]))
        except queue.Full:
            self._left_out += 1
            self.fail("events come faster than --on-event takes them; some were dropped")

    def close(self) -> None:
        """Let what waits be done, for a moment; end a command that still runs."""
        with suppress(queue.Full):
            self._work.put(None, timeout=PATIENCE_S)
        self._thread.join(PATIENCE_S)
        if (child := self._child) is not None and self._thread.is_alive():
            child.kill()

    def _run(self) -> None:
        while (event := self._work.get()) is not None:
            for pass_on in (self._write, self._call):
                try:
                    pass_on(event)
                except Exception as error:
                    self.fail(f"an event could not be delivered: {error}")

    def _write(self, event: str) -> None:
        if self._pipe is None:
            return
        # Without O_NONBLOCK a pipe without a reader would hold up every later event.
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_NONBLOCK", 0)
        file = os.open(self._pipe, flags, 0o644)
        try:
            os.write(file, (event + "\n").encode())
        finally:
            os.close(file)

    def _call(self, event: str) -> None:
        if not self._words:
            return
        now = time.monotonic()
        if len(self._begun) == MOST_AN_HOUR and now - self._begun[0] < 3600.0:
            self.fail(f"more than {MOST_AN_HOUR} events in an hour: --on-event is not run for all")
            return
        self._begun.append(now)
        nothing = subprocess.DEVNULL
        self._child = child = subprocess.Popen(
            self._words,
            stdin=subprocess.PIPE,
            stdout=nothing,
            stderr=nothing,
            start_new_session=True,
        )
        with child:
            try:
                child.communicate((event + "\n").encode(), timeout=LONGEST_S)
            except subprocess.TimeoutExpired:
                child.kill()
                self.fail(f"--on-event was ended after {LONGEST_S:g} s")
        self._child = None
        if child.returncode:
            self.fail(f"--on-event ended with code {child.returncode}")
