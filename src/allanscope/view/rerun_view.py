"""The Rerun view: a listener that draws what happens, in a thread of its own.

::

    session thread   samples ──▶ Decimator ─┐
                     gap, notice ───────────┤ tasks (bounded, dropped when full)
    refresh thread   snapshot ──▶ LogSpacing ─────┘
                                            ▼
    worker thread                        ChartSink ──▶ server on the loopback ──▶ viewer process
                                         ChartFile ──▶ session.rrd

No method blocks, whatever the viewer does. Rerun takes more than a second and 90 MB to import, so
that is left to `start`, or to `load_rerun` where something must not wait for it later. Where there
is only a file to write, and Rerun is not loaded yet, the worker thread loads it after the first
result, which comes sooner so; what is to be drawn waits there.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING

from allanscope.analysis import Analysis
from allanscope.quantities import duration, number
from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.view.change_log import GapThrottle, Level
from allanscope.view.chart_sink import ChartFile, ChartSink, expected_bytes, largest_part, refusal
from allanscope.view.decimator import Decimator, Rows
from allanscope.view.viewer_process import (
    DATA_PORT_AFTER_PAGE,
    ViewerSupervisor,
    ViewMode,
)
from allanscope.view.worker import Worker

if TYPE_CHECKING:
    from allanscope.view.rerun_recording import Canvas

__all__ = ["RerunView", "ViewMode", "load_rerun", "require_rerun"]

_QUICK_ROWS, _CALM_ROWS, _CALM_AFTER_S = 1, 10, 1800.0
"""Rows of the series that travel together: a tenth of a second; a second after half an hour, and
without a viewer."""

_ROWS_WAITING = 4096
_STATUS_EVERY_S = 5.0
_NIGHT_S = 12 * 3600.0

_COUNTS_UP = ("produced", "sent", "uptime_s")
"""Fields of a status that say nothing but that time passes."""

_PREFIX: Mapping[str, tuple[str, Level]] = {
    "mark": ("mark: ", "warn"),
    "error": ("device error: ", "error"),
    "event": ("", "warn"),
}


_DRAWING = "allanscope.view.rerun_recording"

_LATEST_LOAD_S = 10.0
"""Rerun is loaded by then, though there is no result yet."""


def load_rerun() -> None:
    """Import Rerun, which would log to the terminal if it were not told before.

    Arrow is told to use the memory of all others: a pool of its own keeps what is free.
    """
    os.environ.setdefault("RUST_LOG", "off")
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    import_module(_DRAWING)


def require_rerun() -> None:
    """Raise what `load_rerun` raises where Rerun is not installed, and import nothing."""
    if find_spec("rerun") is None:
        raise ModuleNotFoundError("No module named 'rerun'", name="rerun")


class RerunView:
    """Show a session in the Rerun viewer, and keep what was shown.

    Parameters
    ----------
    out_dir : Path or None
        Folder that gets ``session.rrd``; None to keep nothing.
    mode : {'auto', 'window', 'web', 'none'}
        ``auto`` is a window where there is a display, else the web viewer.
    session : mapping, optional
        What is known of the session, shown as it is. ``name`` becomes the name of the recording;
        ``started_unix_s``, the wall-clock time of the start, adds the timeline ``clock``.
    say : callable, optional
        Called with a line for the user, e.g. the address of the web viewer.
    port : int, optional
        Of the page of the web viewer; the data are served at the one after it.

    Attributes
    ----------
    address : str
        Address from which any Rerun viewer on this machine can fetch the data:
        ``allanscope open ADDRESS``. Empty when nothing is served.
    failure : str
        Why what was drawn is not all, known when it is closed; empty if it is.
    viewer : ViewerSupervisor or None
        The viewer that was started; ``viewer.process.address`` is that of the web viewer's page.

    Raises
    ------
    ValueError
        For a mode that does not exist.
    """

    def __init__(
        self,
        out_dir: Path | None,
        mode: ViewMode = "auto",
        session: Mapping[str, object] | None = None,
        say: Callable[[str], None] | None = None,
        port: int | None = None,
    ) -> None:
        if mode not in ("window", "web", "none", "auto"):
            raise ValueError(f"no view {mode!r}; choose one of auto window web none")
        self.address = ""
        self.failure = ""
        self.viewer: ViewerSupervisor | None = None
        self._mode, self._port = mode, port
        self._file = None if out_dir is None else Path(out_dir) / "session.rrd"
        self._session = dict(session or {})
        self._say = say or (lambda line: None)
        self._worker: Worker | None = None
        self._sinks: list[ChartSink] = []
        self._decimator = Decimator()
        self._rows: deque[tuple[tuple[str, ...], Rows]] = deque(maxlen=_ROWS_WAITING)
        self._rows_lost = 0
        self._latest: Analysis | None = None
        self._streaming = False
        self._status_at_s = -_STATUS_EVERY_S
        self._gaps = GapThrottle()
        self._may_load = threading.Event()

    def start(self, canvas: Canvas | None = None) -> None:
        """Open the file, the server and the viewer, and say where to look.

        Parameters
        ----------
        canvas : Canvas, optional
            Where to draw instead, as for a viewer that reads this program's output.
        """
        if canvas is not None:
            self._sinks, self._worker = [ChartSink(lambda: canvas)], Worker("rerun-view")
            return
        if self._mode == "none" and self._file is None:
            return
        serve = self._mode != "none"
        if serve:
            load_rerun()
            from allanscope.view.rerun_recording import Canvas

            data = None if self._port is None else self._port + DATA_PORT_AFTER_PAGE
            served, self.address = Canvas.serve(self._session, data)
            self._sinks.append(ChartSink(lambda: served))
        if self._file is not None:
            self._start_file(self._file)
        self._worker = Worker("rerun-view")
        if _DRAWING not in sys.modules:
            self._worker.submit(self._wait_for_result)
        if serve:
            self.viewer = ViewerSupervisor(self.address, self._mode, self._say, self._port)

    def size_notice(self, axes: Sequence[str], duration_s: float | None) -> str:
        """Return a line that says how large the file becomes; empty where none is kept.

        Parameters
        ----------
        axes : sequence of str
            That there will be.
        duration_s : float or None
            Of the run; None where unknown.
        """
        if self._file is None or self.failure:
            return ""
        free = shutil.disk_usage(self._file.parent).free
        lasts_s = _NIGHT_S if duration_s is None else duration_s
        size = max(1e-6 * expected_bytes(lasts_s, axes), 1.0)
        return (
            f"{self._file.name}: about {number(size, 2)} MB in {duration(lasts_s)}, "
            f"at most {number(1e-6 * largest_part(free), 2)} MB"
        )

    def _start_file(self, file: Path) -> None:
        """Begin the file if the disk has room for it."""
        self.failure = refusal(file)
        if self.failure:
            self._say(self.failure)
        else:
            self._sinks.append(ChartFile(partial(_canvas, self._session, file), file, self._say))

    @property
    def dropped(self) -> int:
        """Updates that were not drawn because the machine could not keep up."""
        return self._rows_lost + (0 if self._worker is None else self._worker.dropped)

    @property
    def serves_page(self) -> bool:
        """Whether the page of the web viewer is there to be looked at."""
        return self.viewer is not None and self.viewer.is_web

    def info(self, info: StreamInfo) -> None:
        """Take what the samples that follow mean."""
        self._decimator.restart()
        axes = info.axes
        self._task(lambda canvas: canvas.describe(axes))

    def samples(self, info: StreamInfo, block: Block) -> None:
        """Take a run of samples, of any size; costs a few microseconds."""
        if self._worker is None:
            return
        if not self._streaming:
            self._streaming = True
            self._state("streaming")
        calm = self._mode == "none" or self._decimator.elapsed_s > _CALM_AFTER_S
        rows = self._decimator.update(info, block, _CALM_ROWS if calm else _QUICK_ROWS)
        if rows is not None:
            self._rows_lost += len(self._rows) == _ROWS_WAITING
            self._rows.append((info.axes, rows))
            self._submit(self._draw_rows, once="rows")

    def gap(self, gap: Gap) -> None:
        """Take a gap. Gaps within a second of each other are reported as one."""
        if self._worker is None:
            return
        text = self._gaps.update(gap, self._decimator.elapsed_s)
        if text is not None:
            self._remark(text, "warn")
            self._state("restarted" if gap.reason == "restarted" else "gap")
            self._streaming = False
        self._decimator.gap(gap)

    def notice(self, notice: Notice | str, level: Level = "info") -> None:
        """Take a remark: of the device, of the user, or of whoever calls, with its level."""
        if isinstance(notice, str):
            self._remark(notice, level)
            return
        if notice.kind == "status":
            self._status(notice.fields)
        else:
            prefix, of_kind = _PREFIX.get(notice.kind, ("", level))
            self._remark(("" if "host" in notice.fields else prefix) + notice.text, of_kind)

    def health(self, numbers: Mapping[str, object]) -> None:
        """Take counters of any name, to be plotted."""
        elapsed_s, known = self._decimator.elapsed_s, dict(numbers)
        self._task(lambda canvas: canvas.health(elapsed_s, known))

    def snapshot(self, analysis: Analysis) -> None:
        """Take the result so far; it is drawn when the run has grown enough since the last one."""
        if self._worker is None:
            return
        if self.viewer is not None:
            self.viewer.watch()
        self._decimator.rate(analysis.rate.best_hz, analysis.duration_s)
        self._latest = analysis
        self._may_load.set()
        due = [sink.due(analysis.duration_s) for sink in self._sinks]
        if any(due):
            self._submit(self._draw_latest, once="result")

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Pass everything so far to the server and to the file; see `settle`."""
        self._task(lambda canvas: canvas.flush())
        return self.settle(timeout_s)

    def settle(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything so far is drawn; return False when that takes longer."""
        self._may_load.set()
        return self._worker is None or self._worker.settle(timeout_s)

    def close(
        self,
        final: Analysis | None = None,
        timeout_s: float = 10.0,
        stay: Callable[[], None] | None = None,
    ) -> None:
        """Draw the last result in full, end the recording, make its file small.

        A window stays open; the page of the web viewer, once loaded, keeps what it shows.

        Parameters
        ----------
        final : Analysis, optional
            The result at the end, where it is more than the last snapshot.
        timeout_s : float
            Longest wait for what is still to be drawn.
        stay : callable, optional
            Called when all is drawn, before the page of a web viewer ends.
        """
        stay = stay or (lambda: None)
        worker, self._worker = self._worker, None
        if worker is None:
            stay()
            return
        self._latest = final or self._latest
        self._may_load.set()
        page = self.serves_page
        ended = worker.close(partial(self._finish, keep_served=page), timeout_s)
        kept = [sink for sink in self._sinks if isinstance(sink, ChartFile)]
        try:
            stay()
        finally:
            if page and ended:
                for sink in self._sinks:
                    if sink not in kept:
                        sink.close()
            if self.viewer is not None:
                self.viewer.close()
        if worker.error is not None:
            self.failure = (
                f"the charts are incomplete: {type(worker.error).__name__}: {worker.error}"
            )
        for one in kept:
            self.failure = one.ended if one.failed else self.failure
            if ended:
                one.wait()

    # --- in the worker's thread -----------------------------------------------------------------

    def _wait_for_result(self) -> None:
        """Wait until Rerun may be loaded."""
        self._may_load.wait(_LATEST_LOAD_S)

    def _draw_rows(self) -> None:
        """Draw all rows that have come; in a fast replay they are many at once."""
        waiting = [self._rows.popleft() for _ in range(len(self._rows))]
        while waiting:
            axes = waiting[0][0]
            same = Rows.joined([rows for of, rows in waiting if of == axes])
            self._for_each_sink(methodcaller("rows", axes, same))
            waiting = [entry for entry in waiting if entry[0] != axes]

    def _draw_latest(self) -> None:
        latest = self._latest
        if latest is not None:
            self._for_each_sink(lambda sink: sink.result(latest))

    def _finish(self, keep_served: bool) -> None:
        self._draw_rows()
        # The file first: it is made smaller beside what viewers are still shown.
        self._sinks.sort(key=lambda sink: not isinstance(sink, ChartFile))
        self._for_each_sink(
            lambda sink: sink.finish(
                self._latest, close=isinstance(sink, ChartFile) or not keep_served
            )
        )

    def _for_each_sink(self, task: Callable[[ChartSink], None]) -> None:
        """Do it for each sink, whatever fails in another."""
        failed: Exception | None = None
        for sink in self._sinks:
            try:
                task(sink)
            except Exception as error:
                failed = failed or error
        if failed is not None:
            raise failed

    # --- tasks ----------------------------------------------------------------------------------

    def _status(self, fields: Mapping[str, int | float | str]) -> None:
        """Plot what a status says, now and then: devices send one a second, all night."""
        elapsed_s = self._decimator.elapsed_s
        if elapsed_s - self._status_at_s >= _STATUS_EVERY_S:
            self._status_at_s = elapsed_s
            self.health({k: v for k, v in fields.items() if k not in _COUNTS_UP})

    def _state(self, state: str) -> None:
        elapsed_s = self._decimator.elapsed_s
        self._task(lambda canvas: canvas.state(elapsed_s, state))

    def _remark(self, text: str, level: Level) -> None:
        elapsed_s = self._decimator.elapsed_s
        self._task(lambda canvas: canvas.remark(elapsed_s, text, level))

    def _task(self, task: Callable[[Canvas], None]) -> None:
        self._submit(lambda: self._for_each_sink(lambda sink: sink.draw(task)))

    def _submit(self, task: Callable[[], None], once: str = "") -> None:
        if self._worker is not None and self._sinks:
            self._worker.submit(task, once)


def _canvas(session: Mapping[str, object], file: Path) -> Canvas:
    """Return what draws into a file."""
    load_rerun()
    from allanscope.view.rerun_recording import Canvas

    return Canvas.to_file(session, file)
