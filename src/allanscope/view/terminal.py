"""The terminal view: one screen on a terminal, a line a minute when piped.

A terminal may take nothing for hours (Ctrl-S, a connection that hangs), and whoever writes to it
then waits. So standard output is written to by a thread of its own: what comes while it waits is
dropped, but for the newest screen, and the measurement knows nothing of it.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable
from typing import Literal, TextIO

from rich.control import Control
from rich.live import Live
from rich.segment import ControlType
from rich.text import Text

from allanscope.analysis import Analysis, simulation_notice
from allanscope.quantities import duration
from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.sanitize import one_line
from allanscope.view.change_log import ChangeLog, GapThrottle, Level, Trends
from allanscope.view.console import Keys, SteadyConsole
from allanscope.view.terminal_screen import Curves, Screen, status_line, summary_lines
from allanscope.view.worker import Task, Worker

__all__ = ["TerminalMode", "TerminalView", "summary_lines"]

TerminalMode = Literal["auto", "live", "plain", "quiet"]

_STATUS_EVERY_S = 60.0
_ALIVE_EVERY_S = 1.0
"""So often a screen that waits for the next result says what has come by now."""

_TENTHS_S = 9.95
"""So long the column of the time has a decimal."""

_PATIENCE_S = 2.0
"""So long the end of a run waits for a terminal that takes nothing."""

_KEYS = "m mark   c curves   q end and report   ? help   ↑ ↓ changed, = stable"
_CURVES: tuple[Curves, ...] = ("both", "gyroscope", "accelerometer", "none")
_STYLES: dict[Level, str] = {"info": "", "warn": "bold", "error": "bold red"}


class TerminalView:
    """Show a session in the terminal.

    Parameters
    ----------
    mode : {'auto', 'live', 'plain', 'quiet'}
        ``live`` redraws one screen; ``plain`` writes a status line a minute and every event;
        ``quiet`` writes nothing; ``auto`` is live on a terminal and plain elsewhere.
    on_mark : callable, optional
        Called with a text when m is pressed, from another thread.
    on_quit : callable, optional
        Called when q is pressed, from another thread.
    stream : text file, optional
        Where to write, at once; by default standard output, by a thread that may wait for it.
    clock : callable
        Time in seconds, for tests.
    whole_s : float, optional
        Length of the recording that is replayed; then the screen says how much is left.
    """

    def __init__(
        self,
        mode: TerminalMode = "auto",
        on_mark: Callable[[str], None] | None = None,
        on_quit: Callable[[], None] | None = None,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
        whole_s: float | None = None,
    ) -> None:
        is_standard = stream is None
        stream = stream or sys.stdout
        if mode == "auto":
            mode = "live" if stream.isatty() and os.environ.get("TERM") != "dumb" else "plain"
        self._mode = mode
        self._worker = Worker("terminal") if is_standard and mode != "quiet" else None
        self._clock = clock
        self._whole_s = whole_s
        self._began = clock()
        self._status_s = -_STATUS_EVERY_S
        self._logged_s = 0.0
        self._changes, self._trends, self._gaps = ChangeLog(), Trends(), GapThrottle()
        self._latest: Analysis | None = None
        self._received, self._before = 0, 0
        self._drawn_at = self._began
        self._marks = 0
        self._on_mark, self._on_quit = on_mark, on_quit
        self._console = SteadyConsole(stream, soft_wrap=mode != "live")
        self._size = self._console.size
        self._live: Live | None = None
        self._screen: Screen | None = None
        self._curves: Curves = "both"
        self._explain_keys = False
        self._closed = False
        self._keys: Keys | None = None
        if mode == "live":
            self._start_live_display()

    # --- what a session sends to its views ------------------------------------------------------

    def info(self, info: StreamInfo) -> None:
        """Take what the samples that follow mean."""
        rate = f"{info.nominal_hz:g} Hz" if info.nominal_hz else "rate unknown"
        facts = (info.part, info.wire, rate, " ".join(info.axes))
        self.line(f"receiving: {', '.join(fact for fact in facts if fact)}")
        simulated = simulation_notice(info.origin)
        if simulated is not None:
            self.line(": ".join(simulated), "error")

    def samples(self, info: StreamInfo, block: Block) -> None:
        """Count samples: results may be far apart, and it must be seen that the run goes on."""
        self._received += len(block)
        if self._live is None or self._latest is None or self._whole_s:
            return
        if self._clock() - self._drawn_at >= _ALIVE_EVERY_S:
            self._draw(self._latest)

    def gap(self, gap: Gap) -> None:
        """Take a gap."""
        text = self._gaps.update(gap, self._clock())
        if text is not None:
            self.line(text, "warn")

    def notice(self, notice: Notice) -> None:
        """Take a remark of the device or a mark of the user."""
        if notice.kind == "mark":
            self.line(f"mark: {notice.text}")
        elif notice.kind == "event":
            self.line(notice.text, "warn" if notice.fields.get("news") == "found" else "info")
        elif notice.kind in ("error", "text"):
            whose = "" if "host" in notice.fields else "device: "
            self.line(f"{whose}{notice.text}", "error" if notice.kind == "error" else "info")

    def snapshot(self, analysis: Analysis) -> None:
        """Take the result so far."""
        self._latest = analysis
        self._trends.update(analysis)
        for level, text in self._changes.update(analysis):
            if self._mode == "plain" or level != "info":
                self.line(text, level)
        # What a session held before it was cut off is in the result, and was not shown.
        self._before = max(self._before, analysis.samples - self._received)
        if self._live is not None:
            self._draw(analysis)
        elif self._mode == "plain" and self._clock() - self._status_s >= _STATUS_EVERY_S:
            self._status_s = self._clock()
            self._write(
                f"{self._time(analysis.duration_s)}{status_line(analysis)}{self._left(analysis)}"
            )

    def line(self, text: str, level: Level = "info") -> None:
        """Write one line, with the time of the run, above the screen."""
        self._write(f"{self._time(self._elapsed_s())}{one_line(text)}", _STYLES[level])

    def close(self) -> None:
        """Leave the last screen standing, or a summary, and the terminal as it was.

        May be called twice.
        """
        if self._closed:
            return
        self._closed = True
        taken = True
        if self._worker is None:
            self._show_last()
        else:
            taken = self._worker.close(self._show_last, _PATIENCE_S)
        if self._keys is not None:
            self._keys.close(drain=taken)
        if not taken:
            # What Python writes at its end would wait as well.
            sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        self._mode = "quiet"

    def _show_last(self) -> None:
        live, self._live = self._live, None
        if live is not None:
            with contextlib.suppress(OSError, ValueError):
                if self._latest is not None:
                    last = Screen(self._latest, self._trends, curves=self._curves, is_final=True)
                    live.update(last)
                live.stop()
        elif self._mode == "plain" and self._latest is not None:
            for row in ("", *summary_lines(self._latest)):
                self._print(Text(row))

    def _time(self, now_s: float) -> str:
        """Return the column of the time, which never runs backwards.

        Before the first result it is the time that passes, and then the one that is recorded.
        """
        self._logged_s = max(self._logged_s, now_s)
        text = f"{self._logged_s:.1f} s" if self._logged_s < _TENTHS_S else duration(self._logged_s)
        return f"{text:>11}  "

    def _elapsed_s(self) -> float:
        """Return the time of the run: results may be far apart, what happens between is not."""
        if self._latest is None:
            return self._clock() - self._began
        return self._recorded(self._latest)[0]

    def _recorded(self, analysis: Analysis) -> tuple[float, int]:
        """Return time and samples of all that has come, since the result too."""
        samples = max(self._before + self._received, analysis.samples)
        rate_hz = analysis.rate.best_hz
        newer_s = (samples - analysis.samples) / rate_hz if rate_hz else 0.0
        return analysis.duration_s + newer_s, samples

    def _of_whole(self, analysis: Analysis) -> str:
        """Return how long a recording is in all, and how long the rest of it takes."""
        if not self._whole_s or not analysis.duration_s:
            return ""
        return f" of {duration(self._whole_s)}{self._left(analysis)}"

    def _left(self, analysis: Analysis) -> str:
        """Return how long the rest of a recording takes; nothing at its end."""
        if not self._whole_s or not analysis.duration_s:
            return ""
        took_s = self._clock() - self._began
        left_s = took_s * (self._whole_s / analysis.duration_s - 1.0)
        return f", {duration(left_s)} left" if left_s >= 0.1 else ""

    def _start_live_display(self) -> None:
        self._start_screen()
        if self._on_mark is not None or self._on_quit is not None:
            keys = {"m": self._mark, "q": self._quit, "c": self._next_curves, "?": self._help}
            self._keys = Keys(keys)

    def _start_screen(self) -> None:
        self._live = Live(
            Text("waiting for samples ..."),
            console=self._console,
            auto_refresh=False,
            redirect_stdout=False,
            redirect_stderr=False,
            vertical_overflow="crop",
        )
        self._live.start(refresh=True)

    def _clear_page(self) -> None:
        """Begin on an empty page: in a narrower terminal, lines that stand are folded or cut."""
        if self._live is not None:
            self._live.transient = True
            self._live.stop()
        above = self._console.size.height - 1
        self._console.print("\n" * above, end="")
        self._console.control(Control((ControlType.CURSOR_UP, above)))
        self._start_screen()

    def _draw(self, analysis: Analysis) -> None:
        self._drawn_at = self._clock()
        keys = _KEYS if self._keys is not None and self._keys.active else ""
        self._screen = Screen(
            analysis,
            self._trends,
            keys,
            self._of_whole(analysis),
            self._recorded(analysis),
            self._curves,
            self._explain_keys,
        )
        self._submit(self._refresh, once="screen")

    def _refresh(self) -> None:
        try:
            now, before = self._console.size, self._size
            if now.width < before.width or now.height < before.height:
                self._clear_page()
            self._size = now
            if self._live is not None and self._screen is not None:
                self._live.update(self._screen, refresh=True)
        except (OSError, ValueError):  # ValueError: the stream is closed
            self._stop_output()

    def _write(self, text: str, style: str = "") -> None:
        line = Text(text, style=style)
        self._submit(lambda: self._print(line))

    def _print(self, line: Text) -> None:
        try:
            if self._mode != "quiet":
                self._console.print(line)
        except (OSError, ValueError):  # ValueError: the stream is closed
            self._stop_output()

    def _submit(self, task: Task, once: str = "") -> None:
        if self._worker is None:
            task()
        else:
            self._worker.submit(task, once)

    def _stop_output(self) -> None:
        """Say no more: the terminal is gone, as when a connection drops."""
        self._mode = "quiet"
        self._console.quiet = True

    def _mark(self) -> None:
        earlier = len(self._latest.marks) if self._latest is not None else 0
        self._marks = max(self._marks, earlier) + 1  # a session that was taken up has some already
        if self._on_mark is not None:
            self._on_mark(f"mark {self._marks}")

    def _next_curves(self) -> None:
        self._curves = _CURVES[(_CURVES.index(self._curves) + 1) % len(_CURVES)]
        self._redraw()

    def _help(self) -> None:
        self._explain_keys = not self._explain_keys
        self._redraw()

    def _redraw(self) -> None:
        if self._live is not None and self._latest is not None:
            self._draw(self._latest)

    def _quit(self) -> None:
        if self._on_quit is not None:
            self._on_quit()
