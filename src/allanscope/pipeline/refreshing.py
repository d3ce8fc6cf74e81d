"""Results while a run goes on: computed beside it, as often as that costs next to nothing.

The closed loop needs a process of its own. A search of a long record takes seconds of plain Python
and small transforms, during which the interpreter's lock is hardly released: a reader in the same
process would be late, and a late reader loses samples. So each search is a worker process that is
given what there is to search and gives back what it found. Searches come when the run has doubled
(`allanscope.explain.live`), so there are a dozen in a night; between them the process is gone, and
with it the memory that it took.

::

    refresh thread          thread "search"      worker process, at low priority
    offer(frozen) ─ due? ─▶ loop and record ───▶ LiveLoop.update
    explanation  ◀───────── LiveLoop, with what it knows now
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from allanscope.analysis import Analyser, LoopInput, StreamState, loop_input
from allanscope.explain import Finding, LiveLoop
from allanscope.optimise import least_nonnegative
from allanscope.pipeline.process import forget_transforms, trim_memory
from allanscope.quantities import duration
from allanscope.samples import StreamInfo
from allanscope.worker_process import WorkerProcess

if TYPE_CHECKING:
    from allanscope.explain import Explanation

__all__ = ["IN_TERMINAL", "IN_VIEWER", "UNWATCHED", "LoopProcess", "RefreshPolicy", "Refresher"]

REFRESH_S = 1.0
"""No result comes sooner after the last one."""

FRESH_S, OLDEST_S = 5.0, 60.0
"""No result need be younger than the one, nor grows older than the other: the first minute is
watched closely, and a number that stands for ten seems frozen."""


@dataclass(frozen=True, slots=True)
class RefreshPolicy:
    """How often results are computed.

    Attributes
    ----------
    share : float
        Of one core, that results may take where they are not due anyway.
    oldest : float
        Share of the run that no result grows older than, whatever it costs, within `FRESH_S` and
        `OLDEST_S`.
    """

    share: float
    oldest: float


IN_VIEWER, IN_TERMINAL, UNWATCHED = (
    RefreshPolicy(0.1, 0.1),
    RefreshPolicy(0.01, 0.1),
    RefreshPolicy(0.0025, 2.0),
)
"""With a viewer; in a terminal; without a screen, where results are only recorded."""

LOW_PRIORITY = 10

TRIM_S, DRAWN_S = 10.0, 2.0
"""Memory that is free is returned so often, besides after the 1st, 2nd, 4th ... result: that takes
16 ms, and what results leave behind grows to 13 MB in a minute. A result is drawn first, as long
as no other one is due: that leaves 20 MB."""

SETTLED_S, BEFORE_S, FEWEST_STRETCH = 60.0, 120.0, 512
"""The rows about an event are searched so long after it was found, from so long before its onset,
when there are so many."""


class Refresher:
    """Computes results in a thread of its own, as often as the machine can bear.

    At the beginning they come more often than their share allows, whenever the run has become
    three times as long: the curves grow with the logarithm of time. And however little it allows,
    while somebody looks one comes every 5 s in the first minute, and later before the last one is
    older than a tenth of the run, or a minute; else when the run is three times as long, or every
    minute.

    Parameters
    ----------
    show : callable
        Computes a result from a copy of the analyser, and shows it.
    policy : RefreshPolicy
        How often.
    fail : callable
        Called with a line when a result fails: that must not end the recording.
    """

    def __init__(
        self,
        show: Callable[[Analyser], None],
        policy: RefreshPolicy,
        fail: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._show = show
        self._fail = fail
        self._policy = policy
        self._next = 0.0
        self._began: float | None = None
        self._work: queue.Queue[Analyser | None] = queue.Queue(maxsize=1)
        self._busy = threading.Event()
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
        self._busy.set()
        self._thread.join(timeout=30.0)

    def _run(self) -> None:
        least_nonnegative(np.eye(1), np.ones(1))  # loads it, while the first samples gather
        results, trimmed_s = 0, time.monotonic()
        while (frozen := self._work.get()) is not None:
            began_s, began_cpu_s = time.monotonic(), time.thread_time()
            try:
                self._show(frozen)
            except Exception as error:
                self._fail(f"a result during the run failed: {type(error).__name__}: {error}")
            spent_s = time.thread_time() - began_cpu_s
            del frozen  # twenty megabytes, not needed until the next one
            forget_transforms()
            results += 1
            now = time.monotonic()
            run_s = now - (self._began or now)
            self._next = now + _pause(run_s, spent_s, now - began_s, self._policy)
            self._busy.clear()
            if results.bit_count() == 1 or now - trimmed_s > TRIM_S:  # each may have loaded code
                if self._work.empty():
                    self._busy.wait(DRAWN_S)
                trim_memory()
                trimmed_s = time.monotonic()


def _pause(run_s: float, spent_s: float, took_s: float, policy: RefreshPolicy) -> float:
    """Return how long to wait after a result.

    Parameters
    ----------
    run_s : float
        Length of the run.
    spent_s : float
        Processor time of the last result.
    took_s : float
        How long it took: the next one takes as long, and is to be there in time. But half of the
        time is left free on however slow a machine.
    policy : RefreshPolicy
        How often results are wanted.

    Examples
    --------
    After 20 s, after 5 min and after a night, with results that take a second of processor time:

    >>> [round(_pause(run_s, 1.0, 1.0, IN_TERMINAL), 1) for run_s in (20.0, 300.0, 40_000.0)]
    [4.0, 29.0, 59.0]
    >>> [round(_pause(run_s, 1.0, 1.0, UNWATCHED), 1) for run_s in (20.0, 300.0, 40_000.0)]
    [39.0, 59.0, 59.0]
    """
    oldest_s = min(max(policy.oldest * run_s, FRESH_S), OLDEST_S)
    wanted_s = spent_s / policy.share
    return max(min(wanted_s, oldest_s - took_s, 2 * run_s), took_s, REFRESH_S - took_s)


class LoopProcess:
    """Look for what the model lacks whenever the run is long enough; nothing here ever waits.

    Parameters
    ----------
    first_s : float
        Length of the run at the first search.
    fail : callable
        Called with a line when a search fails.
    report : callable
        Called with a line when the rows about an event have been searched.

    Attributes
    ----------
    trouble : str
        Why the last search failed; empty while all is well.
    """

    def __init__(
        self,
        first_s: float = 120.0,
        fail: Callable[[str], None] = lambda _: None,
        report: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.trouble = ""
        self._report = report
        self._searched = -1
        self._fail = fail
        self._first_s = self._due_s = first_s
        self._loop = LiveLoop(first_s)
        self._info: StreamInfo | None = None
        self._request: tuple[LiveLoop, LoopInput] | None = None
        self._thread: threading.Thread | None = None
        self._worker: WorkerProcess | None = None
        self._closed = False

    @property
    def explanation(self) -> Explanation | None:
        """What is known as of the last search; None before the first."""
        return self._loop.explanation

    @property
    def searches(self) -> int:
        """How often a search has ended."""
        return self._loop.searches

    @property
    def busy(self) -> bool:
        """Whether a search is under way."""
        return self._thread is not None and self._thread.is_alive()

    def offer(self, frozen: Analyser) -> None:
        """Begin a search of a copy of the analyser, if one is due and none is under way."""
        state = frozen.state
        if state is None or self.busy or self._closed:
            return
        if self._stretch_due(state):
            return
        if self._info is None or self._info.configuration != state.info.configuration:
            self._loop = LiveLoop(self._first_s, nominal_hz=state.info.nominal_hz or None)
            self._info, self._due_s = state.info, self._first_s
        if state.samples < self._due_s * state.info.nominal_hz:
            return
        given = loop_input(state)
        if not self._loop.due(given.record):
            return
        self._due_s = 1.9 * given.length_s  # a little early: the true rate may be a little lower
        # What was found before is not asked for again, and is the larger part.
        self._begin(replace(self._loop, explanation=None), given)

    def _stretch_due(self, state: StreamState) -> bool:
        """Begin a search of the rows about an event that was found a while ago, if there is one."""
        hz = state.info.nominal_hz or 1.0
        onset = state.watch.unsearched(self._searched, round(SETTLED_S * hz))
        if onset is None:
            return False
        self._searched = onset.found
        before_s = max((onset.found - onset.onset) / hz, BEFORE_S)
        given = loop_input(state).since(onset.onset / hz - before_s)
        if len(given.record.values) < FEWEST_STRETCH:
            return False
        words = f"about the event at {duration(onset.onset / hz)}"
        self._begin(LiveLoop(0.0, nominal_hz=given.nominal_hz), given, words)
        return True

    def _begin(self, loop: LiveLoop, given: LoopInput, stretch: str = "") -> None:
        """Begin a search in the background."""
        self._request = loop, given
        self._thread = threading.Thread(
            target=self._search_in_background, args=(stretch,), name="search", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Give up a search that is under way: the run has ended, and is now searched in full."""
        self._closed = True
        if (worker := self._worker) is not None:
            worker.close()
        if self._thread is not None:
            self._thread.join(timeout=5.0)

    def _search_in_background(self, stretch: str) -> None:
        loop = self._loop
        answer: LiveLoop | tuple[Finding, ...] | None = None
        try:
            with WorkerProcess("allanscope.explain.loop", LOW_PRIORITY) as self._worker:
                assert self._request is not None
                self._worker.ask(_searched, *self._request, bool(stretch))
                self._request = None  # tens of megabytes, not held until the end
                answer = self._worker.answer()
        except Exception as error:  # no process, no memory: the end of the run searches in full
            self.trouble = str(error)
        self._worker = None
        if answer is None:
            if not self._closed:
                self._fail(f"the search for effects during the run failed: {self.trouble}")
        elif isinstance(answer, tuple):
            found = "; ".join(one.words for one in answer) or "no effects beyond the noise model"
            self._report(f"search {stretch}: {found}")
        elif loop is self._loop:
            self._loop, self.trouble = answer, ""


def _searched(loop: LiveLoop, given: LoopInput, is_stretch: bool) -> LiveLoop | tuple[Finding, ...]:
    """Search in the worker process: return the loop, or what it found."""
    loop.update(given.record, rate_fit=given.rate_fit, densities=given.densities or None)
    if is_stretch:
        return loop.findings
    if (found := loop.explanation) is not None:
        # What is as long as the record is held for hours, and is of no use to a result.
        held = found.held.in_single_precision()
        fits = {axis: fit.without_ordinates() for axis, fit in found.fits.items()}
        loop.explanation = replace(found, cleaned={}, signals={}, fits=fits, held=held)
    return loop
