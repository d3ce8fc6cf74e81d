"""From patterns to a lot report: what is not done yet is handed out, what comes back is kept.

The scheduler never holds more than a few tasks for each worker, and the client no result but the
one it is writing: a hundred thousand recordings need no more memory than a hundred.
"""

from __future__ import annotations

import sys
import threading
from collections import Counter, deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from allanscope.errors import DeviceError
from allanscope.fleet.cluster import (
    MOST_ORPHANED,
    WorkerPool,
    connected,
    dashboard_line,
    require_extra,
)
from allanscope.fleet.inputs import RecordingInput, find_inputs
from allanscope.fleet.lot_files import UnitNames
from allanscope.fleet.outcome import Outcome
from allanscope.fleet.store import Store
from allanscope.fleet.work_queue import FleetResult, WorkQueue
from allanscope.pipeline import DeviceSettings, read_limits, stopped_by_signals
from allanscope.sanitize import print_error

if TYPE_CHECKING:
    from collections.abc import Callable

    from distributed import Future

__all__ = ["FleetResult", "FleetSettings", "run_fleet"]

TASKS_PER_WORKER = 3
"""One that runs and two that wait: a worker is never idle for want of a message."""

LOOK_AGAIN_S = 0.5

_WORKERS_DIED = "its worker died repeatedly, perhaps for lack of memory"


@dataclass(frozen=True, slots=True)
class FleetSettings:
    """Which recordings, where the results go, and who does the work.

    Attributes
    ----------
    patterns : tuple of str
        Files, folders or globs, on this machine or at a URL of fsspec.
    out : Path or str
        Folder of the results, or text that is its URL; a folder with results is gone on with.
    scheduler : str
        Address of a Dask scheduler; empty for a cluster on this machine.
    workers : int or None
        Processes of that cluster; one for each core if not given.
    unit_pattern : str
        Regular expression whose first group, found in the path, names the unit; empty to go by
        the identity of the device, then by the folder.
    limits : Path or None
        Specification with acceptance limits, as of ``allanscope check``.
    compare : str
        Folder of another fleet's results, or its table, to compare the lot with.
    partition : tuple of str
        Columns by which the table is parted into files.
    quiet : bool
        Say nothing but errors.
    """

    patterns: tuple[str, ...]
    out: Path | str
    scheduler: str = ""
    workers: int | None = None
    unit_pattern: str = ""
    limits: Path | None = None
    compare: str = ""
    partition: tuple[str, ...] = ()
    quiet: bool = False


def run_fleet(settings: FleetSettings, device: DeviceSettings) -> FleetResult:
    """Analyse all recordings that have no result yet; write the table and the report of all.

    Ctrl-C ends the run in order: what is done stays, the same call goes on with the rest.

    Raises
    ------
    UsageError
        If nothing matches, the folder cannot be written to, the scheduler does not answer, the
        pattern of units is none, or the extra is not installed.
    DeviceError
        If the scheduler is lost on the way; table and report are of what was done until then.
    """
    require_extra()
    from allanscope.fleet.lot_files import find_lot, write_lot

    # What is asked for is refused now, not when a night's work is done.
    UnitNames((), settings.unit_pattern)
    limits = read_limits(settings.limits) if settings.limits is not None else {}
    find_lot(settings.compare)
    items = find_inputs(settings.patterns)
    store = Store(settings.out, device)
    try:
        queue = WorkQueue(store, items)
        if queue.todo:
            _process_queue(queue, settings, device)
        result = queue.result
        result.left = len(queue.todo)
        write_lot(result, store, settings, limits)
    finally:
        store.close()
    if queue.is_deserted:
        raise DeviceError(
            f"the Dask scheduler disconnected; {len(result.keys)} done, {result.left} left: "
            "repeat the command to continue"
        )
    return result


def _process_queue(queue: WorkQueue, settings: FleetSettings, device: DeviceSettings) -> None:
    from allanscope.view import progress

    stopped = threading.Event()
    with (
        stopped_by_signals(stopped.set),
        connected(settings.scheduler, settings.workers) as client,
        client.as_current(),
    ):
        _log(settings, dashboard_line(client))
        with progress(
            float(len(queue.todo)), "fleet", unit="recordings", quiet=settings.quiet
        ) as advance:
            _dispatch(queue, WorkerPool(client, print_error), device, advance, stopped)


def _dispatch(
    queue: WorkQueue,
    pool: WorkerPool,
    device: DeviceSettings,
    advance: Callable[[float], None],
    stopped: threading.Event,
) -> None:
    """Keep the workers busy until everything is done or the run is stopped.

    Dask blames the death of a worker on all that waited there, too. So recordings whose workers
    died are done again at the end, each while nothing else is: then it was that one.
    """
    from distributed.client import FuturesCancelledError

    running: dict[Future, RecordingInput] = {}
    orphaned: Counter[str] = Counter()
    suspects: deque[RecordingInput] = deque()
    alone: RecordingInput | None = None
    try:
        while (queue.todo or running or suspects) and not stopped.is_set():
            pool.refresh()
            _requeue_orphaned(queue, pool, running, orphaned)
            if not running:
                alone = suspects.popleft() if suspects and not queue.todo else None
                queue.todo.extendleft([alone] if alone else [])
            if alone is None or not running:
                _submit_waiting(queue, pool, device, running, 1 if alone else None)
            for future, item in _finished(running):
                del running[future]
                outcome = _outcome(future, item)
                if outcome.error.endswith(_WORKERS_DIED) and item is not alone:
                    suspects.append(item)
                else:
                    advance(float(queue.record(item, outcome)))
                future.release()
        for future in running:
            future.cancel()
    except (FuturesCancelledError, OSError):
        queue.is_deserted = True
    queue.todo.extend([*running.values(), *suspects])


def _requeue_orphaned(
    queue: WorkQueue,
    pool: WorkerPool,
    running: dict[Future, RecordingInput],
    orphaned: Counter[str],
) -> None:
    """Take back what was given to workers that are gone; one that outlives none has failed."""
    for future in pool.without_worker(running):
        item = running.pop(future)
        future.cancel()
        orphaned[item.url] += 1
        if orphaned[item.url] > MOST_ORPHANED:
            queue.record(item, Outcome(item.url, error=f"{item.url}: {_WORKERS_DIED}"))
        else:
            queue.todo.append(item)


def _submit_waiting(
    queue: WorkQueue,
    pool: WorkerPool,
    device: DeviceSettings,
    running: dict[Future, RecordingInput],
    most: int | None = None,
) -> None:
    """Hand out as much as keeps every worker busy until the next look, or at most so many."""
    while queue.todo and len(running) < (most or max(TASKS_PER_WORKER * pool.threads, 1)):
        item = queue.todo.popleft()
        running[queue.submit(pool, item, device, idle=pool.threads - len(running))] = item


def _finished(running: dict[Future, RecordingInput]) -> list[tuple[Future, RecordingInput]]:
    """Wait a moment and return what has come back."""
    from distributed import wait

    try:
        done = wait(list(running), LOOK_AGAIN_S, "FIRST_COMPLETED").done
    except TimeoutError:
        return []
    return [(future, running[future]) for future in done]


def _outcome(future: Future, item: RecordingInput) -> Outcome:
    """Return what a task came to, also when it was the task itself that failed."""
    try:
        outcome: Any = future.result()
    except Exception as error:
        died = type(error).__name__ == "KilledWorker"
        text = _WORKERS_DIED if died else f"{type(error).__name__}: {error}"
        return Outcome(item.url, error=f"{item.url}: {' '.join(text.split())}")
    assert isinstance(outcome, Outcome)
    return outcome


def _log(settings: FleetSettings, line: str) -> None:
    if not settings.quiet:
        print(line, file=sys.stderr, flush=True)
