"""Progress of jobs that take longer than a second: rate and time left, on standard error.

Rich, which draws the bar, is loaded only where there is one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from typing import TextIO

from allanscope.quantities import duration, number
from allanscope.sanitize import one_line

__all__ = ["is_notebook", "progress", "speed_text"]

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
        from allanscope.view.terminal_bar import TerminalBar

        with TerminalBar(total, description, unit, stream, _SILENT_FOR_S) as bar:
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
        words = f"{self._description} {speed_text(speed, left, self._unit)}"
        return f"{escape(words)} <progress{share}></progress>"


class _Lines:
    """A line now and then, for log files."""

    def __init__(self, total: float | None, description: str, unit: str, stream: TextIO) -> None:
        self._total, self._unit = total, unit
        self._description = one_line(description)
        self._stream = stream
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
        from allanscope.view.console import SteadyConsole

        console = SteadyConsole(self._stream, soft_wrap=True)
        console.print(f"{self._description}: {share}{speed_text(speed, left, self._unit)}")


def speed_text(speed: float | None, left: float | None, unit: str) -> str:
    """Return a rate and the time that is left, in s, as far as they are known.

    >>> speed_text(1.2e6, 90.0, "B")
    '1.20 MB/s, 1 min 30 s left'
    """
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
