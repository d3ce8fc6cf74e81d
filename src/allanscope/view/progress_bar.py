"""Progress of jobs that take longer than a second: rate and time left, on standard error."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from typing import TextIO

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from allanscope.quantities import duration, number
from allanscope.sanitize import one_line
from allanscope.view.console import SteadyConsole

__all__ = ["is_notebook", "progress"]

_SILENT_FOR_S = 1.0
_LINE_EVERY_S = 30.0
_NOTEBOOK_EVERY_S = 0.3


@contextmanager
def progress(
    total: float | None,
    description: str,
    unit: str = "",
    quiet: bool = False,
    stream: TextIO | None = None,
) -> Iterator[Callable[[float], None]]:
    """Show how far a job is; gives a function that is told how much more was done.

    Parameters
    ----------
    total : float or None
        All there is to do; None when that is not known.
    description : str
        What is being done, e.g. ``replaying``.
    unit : str
        What is counted, e.g. ``samples`` or ``B``; ``s`` for the time of a recording, whose rate is
        a multiple of real time. Empty where nothing is: then the bar only shows life.
    quiet : bool
        Show nothing.
    stream : text file, optional
        Where to; standard error by default. A bar on a terminal or, by default, in a notebook; else
        a line every half minute.

    Examples
    --------
    >>> with progress(100.0, "reading", quiet=True) as advance:
    ...     advance(50.0)
    """
    if quiet:
        yield lambda amount: None
        return
    if stream is None and is_notebook():
        with _NotebookBar(total, description, unit) as bar_of_page:
            yield bar_of_page.advance
        return
    stream = stream or sys.stderr
    if stream.isatty():
        with _Bar(total, description, unit, stream) as bar:
            yield bar.advance
    else:
        yield _Lines(total, description, unit, stream).advance


def is_notebook() -> bool:
    """Return whether this runs in the kernel of a notebook, which shows HTML."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


class _NotebookBar:
    """A bar of HTML in the output of a cell, which is empty afterwards."""

    def __init__(self, total: float | None, description: str, unit: str) -> None:
        self._total, self._unit = total, unit
        self._description = one_line(description)
        self._done = 0.0
        self._began = self._shown = time.monotonic()

    def __enter__(self) -> _NotebookBar:
        page = import_module("IPython.display")  # there in a notebook, and not required elsewhere
        self._as_html = page.HTML
        self._output = page.display(page.HTML(self._text()), display_id=True)
        return self

    def __exit__(self, *_: object) -> None:
        self._output.update(self._as_html(""))

    def advance(self, amount: float) -> None:
        """Add what was done."""
        self._done += amount
        if (now := time.monotonic()) - self._shown >= _NOTEBOOK_EVERY_S:
            self._shown = now
            self._output.update(self._as_html(self._text()))

    def _text(self) -> str:
        passed_s = time.monotonic() - self._began
        speed = self._done / passed_s if self._done and passed_s else None
        left = (self._total - self._done) / speed if self._total and speed else None
        share = f' max="{self._total:g}" value="{self._done:g}"' if self._total else ""
        words = f"{self._description} {_speed_text(speed, left, self._unit)}"
        return f"{escape(words)} <progress{share}></progress>"


class _Bar:
    """A bar that appears after a second and leaves no trace."""

    def __init__(self, total: float | None, description: str, unit: str, stream: TextIO) -> None:
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
        self._timer = threading.Timer(_SILENT_FOR_S, self._progress.start)
        self._timer.daemon = True

    def __enter__(self) -> _Bar:
        self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()
        self._timer.join()
        self._progress.stop()

    def advance(self, amount: float) -> None:
        """Add what was done."""
        self._progress.advance(self._task, amount)


class _Lines:
    """A line now and then, for log files."""

    def __init__(self, total: float | None, description: str, unit: str, stream: TextIO) -> None:
        self._total, self._unit = total, unit
        self._description = one_line(description)
        self._console = SteadyConsole(stream, soft_wrap=True)
        self._done = 0.0
        self._began = self._said = time.monotonic()

    def advance(self, amount: float) -> None:
        """Add what was done."""
        self._done += amount
        now = time.monotonic()
        if now - self._said < _LINE_EVERY_S:
            return
        self._said = now
        share = f"{100.0 * self._done / self._total:.0f} %, " if self._total else ""
        speed = self._done / (now - self._began)
        left = (self._total - self._done) / speed if self._total and speed else None
        self._console.print(f"{self._description}: {share}{_speed_text(speed, left, self._unit)}")


class _SpeedColumn(ProgressColumn):
    """Rate and time left."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """Return them as a text: of the whole job so far, which may come in few large pieces."""
        speed = task.completed / task.elapsed if task.elapsed and task.completed else None
        left = (task.total - task.completed) / speed if task.total and speed else None
        return Text(_speed_text(speed, left, self._unit))


def _speed_text(speed: float | None, left: float | None, unit: str) -> str:
    if speed is None or not unit:
        parts = []
    elif unit == "s":
        parts = [f"{number(speed)} times real time"]
    else:
        parts = [f"{_prefixed(speed)}{unit}/s"]
    if left is not None:
        parts.append(f"{duration(left)} left")
    return ", ".join(parts)


def _prefixed(value: float) -> str:
    """Return a number with a decimal prefix: 12.3 M, 456 k."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"{number(value / factor)} {prefix}"
    return f"{number(value)} "
