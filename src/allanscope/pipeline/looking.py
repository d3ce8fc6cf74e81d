"""The closed loop while a run goes on, in a process of its own.

A look at a long record takes seconds of plain Python and small transforms, through which the
interpreter would hardly let go: a reader in the same process would be late, and a late reader loses
samples. So each look is a child process that is given what there is to look at and gives back what
it found. Looks come when the run has doubled (`allanscope.explain.live`), so there are a dozen in a
night; between them the child is gone, and with it the memory that it took.

::

    refresh thread          thread "look"                  child, at low priority
    offer(frozen) ─ due? ─▶ pickle ─── standard input ───▶ LiveLoop.update
    explanation  ◀───────── unpickle ◀─ standard output ── LiveLoop, with what it knows now
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading

from allanscope.analysis import Analyser, LoopInput, loop_input
from allanscope.explain import Explanation, LiveLoop
from allanscope.samples import StreamInfo

__all__ = ["Looking"]

LOW_PRIORITY = 10


class Looking:
    """Look for what the model lacks whenever the run is long enough; nothing here ever waits.

    Parameters
    ----------
    first_s : float
        Length of the run at the first look.

    Attributes
    ----------
    trouble : str
        Why the last look came to nothing; empty while all is well.
    """

    def __init__(self, first_s: float = 120.0) -> None:
        self.trouble = ""
        self._first_s = self._due_s = first_s
        self._loop = LiveLoop(first_s)
        self._info: StreamInfo | None = None
        self._thread: threading.Thread | None = None
        self._child: subprocess.Popen[bytes] | None = None
        self._closed = False

    @property
    def explanation(self) -> Explanation | None:
        """What is known as of the last look; None before the first."""
        return self._loop.explanation

    @property
    def looks(self) -> int:
        """How often it was looked."""
        return self._loop.looks

    @property
    def busy(self) -> bool:
        """Whether a look is under way."""
        return self._thread is not None and self._thread.is_alive()

    def offer(self, frozen: Analyser) -> None:
        """Begin a look at a copy of the analyser, if one is due and none is under way."""
        state = frozen.state
        if state is None or self.busy or self._closed:
            return
        if self._info is None or self._info.configuration != state.info.configuration:
            self._loop = LiveLoop(self._first_s, nominal_hz=state.info.nominal_hz or None)
            self._info, self._due_s = state.info, self._first_s
        if state.samples < self._due_s * state.info.nominal_hz:
            return
        look = loop_input(state)
        if not self._loop.due(look.record):
            return
        self._due_s = 1.9 * look.length_s  # a little early: the true rate may be a little lower
        self._thread = threading.Thread(target=self._look, args=(look,), name="look", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Give up a look that is under way: the run has ended, and is now searched in full."""
        self._closed = True
        if (child := self._child) is not None:
            child.terminate()
        if self._thread is not None:
            self._thread.join(timeout=5.0)

    def _look(self, look: LoopInput) -> None:
        loop, request = self._loop, pickle.dumps((self._loop, look), pickle.HIGHEST_PROTOCOL)
        # A session of its own: Ctrl-C in the terminal is for us to understand, not for the child.
        command = [sys.executable, "-m", __name__]
        pipe = subprocess.PIPE
        self._child = child = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True
        )
        with child:
            answer, complaint = child.communicate(request)
        self._child = None  # it holds on to the request
        if child.returncode:
            last = complaint.decode(errors="replace").strip().rpartition("\n")[2]
            self.trouble = last or f"the search for effects ended with code {child.returncode}"
        elif loop is self._loop:
            self._loop, self.trouble = pickle.loads(answer), ""


def main() -> None:
    """Be the child: take a loop and what it is to look at, give back the loop."""
    if hasattr(os, "nice"):
        os.nice(LOW_PRIORITY)
    loop, look = pickle.load(sys.stdin.buffer)
    loop.update(look.record, rate_fit=look.rate_fit, densities=look.densities)
    pickle.dump(loop, sys.stdout.buffer, pickle.HIGHEST_PROTOCOL)


if __name__ == "__main__":
    main()
