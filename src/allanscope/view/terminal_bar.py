"""The bar of a long job on a terminal."""

from __future__ import annotations

import threading
from typing import TextIO

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from allanscope.sanitize import one_line
from allanscope.view.console import SteadyConsole
from allanscope.view.progress_bar import speed_text

__all__ = ["TerminalBar"]


class TerminalBar:
    """A bar that appears after a while and leaves no trace.

    Parameters
    ----------
    total, description, unit, stream
        As of `progress`; a stream is needed.
    silent_for_s : float
        When it appears.
    """

    def __init__(
        self,
        total: float | None,
        description: str,
        unit: str,
        stream: TextIO,
        silent_for_s: float,
    ) -> None:
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=None),
            TextColumn("{task.percentage:>3.0f} %" if total else "", markup=False),
            _SpeedColumn(unit),
            console=SteadyConsole(stream),
            transient=True,
            expand=True,
            refresh_per_second=4,
        )
        self._task = self._progress.add_task(one_line(description), total=total)
        self._timer = threading.Timer(silent_for_s, self._progress.start)
        self._timer.daemon = True

    def __enter__(self) -> TerminalBar:
        self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()
        self._timer.join()
        self._progress.stop()

    def advance(self, amount: float) -> None:
        """Add what was done."""
        self._progress.advance(self._task, amount)


class _SpeedColumn(ProgressColumn):
    """Rate and time left."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """Return them as a text: of the whole job so far, which may come in few large pieces."""
        speed = task.completed / task.elapsed if task.elapsed and task.completed else None
        left = (task.total - task.completed) / speed if task.total and speed else None
        return Text(speed_text(speed, left, self._unit))
