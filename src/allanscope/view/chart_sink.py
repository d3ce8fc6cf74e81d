"""Where charts go: to viewers, or to the file of the session, which is never in the way.

Both are given the same; the file is given less of it as time passes, and ends before the disk does.
All of it is done by the one thread that draws, but `due`.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from allanscope.analysis import Analysis
from allanscope.lazy import once
from allanscope.view.decimator import LogSpacing, Rows, RowThinner
from allanscope.view.viewer_process import optimise

if TYPE_CHECKING:
    from allanscope.view.rerun_recording import Canvas

__all__ = ["ChartFile", "ChartSink", "expected_bytes", "largest_part", "refusal"]

_RARELY = 5.0
"""Grids, and estimators other than the default one, are drawn so many times less often."""

FILE_SHARE = 0.02
"""Of the run, between two results in the file; a viewer is given them at least each minute."""

MOST_BYTES = 512 << 20
"""The file ends at this size, whatever there is to draw."""

LEAST_FREE_BYTES = 32 << 20
"""What a disk must have left for the recording; with less, no charts are kept."""

LARGEST_SHARE = 4
"""The file ends when it is larger than this part of what is free: then the recording has the rest.
"""

RESULT_BYTES, ROW_BYTES = 55e3, 60.0
"""Of the file, per axis: of a result, estimators that are drawn rarely included, and of a row."""

_LOOK_EVERY_S = 0.5
_LARGE_FILE = 50e6


class ChartSink:
    """Charts on their way to viewers: everything, as it comes.

    Parameters
    ----------
    make : callable
        Returns the canvas that draws, when something is to be drawn for the first time.
    spacing : LogSpacing, optional
        Which results are drawn.
    """

    def __init__(self, make: Callable[[], Canvas], spacing: LogSpacing | None = None) -> None:
        self._make = make
        self._spacing = spacing or LogSpacing()
        self._rare_spacing = replace(self._spacing, stretch=_RARELY)
        self._waits = self._everything = False

    @once
    def canvas(self) -> Canvas:
        """What draws."""
        return self._make()

    def due(self, duration_s: float) -> bool:
        """Return whether the result after this much of the run is to be drawn; called by others."""
        if not self._spacing.due(duration_s):
            return False
        self._everything |= self._rare_spacing.due(duration_s)
        self._waits = True
        return True

    def draw(self, task: Callable[[Canvas], None]) -> None:
        """Draw what is neither a result nor rows."""
        task(self.canvas)

    def rows(self, axes: tuple[str, ...], rows: Rows) -> None:
        """Draw rows of the time series."""
        self.canvas.series.samples(axes, rows)

    def result(self, latest: Analysis) -> None:
        """Draw a result if one was due."""
        everything, self._everything = self._everything, False
        waits, self._waits = self._waits, False
        if waits:
            self.draw(lambda canvas: canvas.result(latest, everything))

    def finish(self, latest: Analysis | None, close: bool = True) -> None:
        """Draw the last result in full, and end unless the page of a viewer is to stay."""
        if latest is not None:
            self.draw(lambda canvas: canvas.result(latest, True))
        self.close() if close else self.canvas.flush()

    def close(self) -> None:
        """Hand everything over and end."""
        self.canvas.close()


class ChartFile(ChartSink):
    """Charts on their way to ``session.rrd``, as long as the recording has room beside it.

    Rerun's writer ends at the first error and says so when it is flushed; to disconnect it would
    then wait for ever, and so would the end of the program.

    Parameters
    ----------
    make : callable
        Returns the canvas that draws into the file; called by the thread that draws.
    path : Path
        The file.
    say : callable
        Called with a line when the file ends early.
    free_bytes : callable
        Free space of the disk that holds a folder.

    Attributes
    ----------
    ended : str
        Why the file ended before the run did; empty while it has not.
    failed : bool
        Whether that is a fault: the room was taken, or a write failed.
    """

    def __init__(
        self,
        make: Callable[[], Canvas],
        path: Path,
        say: Callable[[str], None],
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        super().__init__(make, LogSpacing(share=FILE_SHARE, longest_s=float("inf")))
        self.path = path
        self.ended = ""
        self.failed = False
        self._say = say
        self._free_bytes = free_bytes
        self._thinner = RowThinner()
        self._axes: tuple[str, ...] = ()
        self._looked_s = -float("inf")
        self._rewriting: threading.Thread | None = None

    def draw(self, task: Callable[[Canvas], None]) -> None:
        """Draw, if there is room."""
        if not self.ended and time.monotonic() - self._looked_s >= _LOOK_EVERY_S:
            self._flush()
            self._looked_s = time.monotonic()
        if not self.ended:
            task(self.canvas)

    def rows(self, axes: tuple[str, ...], rows: Rows) -> None:
        """Draw rows of the time series, fewer of them the longer the run is."""
        if axes != self._axes:
            self._draw_rows(self._thinner.flush())
            self._axes = axes
        self._draw_rows(self._thinner.update(rows))

    def finish(self, latest: Analysis | None, close: bool = True) -> None:
        """Draw what is left, and end the file."""
        self._draw_rows(self._thinner.flush())
        self._looked_s = -float("inf")
        super().finish(latest, close)

    def close(self) -> None:
        """End the file if it has not ended, and begin to make it smaller."""
        if not self.ended:
            self._flush()
        if not self.ended:
            self.canvas.close()
            self._begin_rewriting()

    def wait(self) -> None:
        """Wait until the file is as small as it becomes."""
        if self._rewriting is not None:
            self._rewriting.join()

    def _begin_rewriting(self) -> None:
        """Rewrite the file beside what else is done, if the disk has room for a second copy."""
        try:
            size, free = self.path.stat().st_size, self._free_bytes(self.path.parent)
        except OSError:
            return
        if free - size <= LEAST_FREE_BYTES:
            return
        if size > _LARGE_FILE:
            self._say(f"compacting {self.path.name} ...")
        self._rewriting = threading.Thread(target=optimise, args=(self.path,), name="rewrite-rrd")
        self._rewriting.start()

    def _draw_rows(self, rows: Rows | None) -> None:
        if rows is not None:
            self.draw(lambda canvas: canvas.series.samples(self._axes, rows))

    def _flush(self) -> None:
        """Hand over what waits, and end the file if that fails or takes the recording's room."""
        name = self.path.name
        try:
            self.canvas.flush()
            size, free = self.path.stat().st_size, self._free_bytes(self.path.parent)
        except Exception as error:
            self._end(f"{name} could not be written ({error})")
            return
        if size > MOST_BYTES:
            self._end(f"{name} has reached {MOST_BYTES >> 20} MB", failed=False)
        elif free < LEAST_FREE_BYTES or size > free / LARGEST_SHARE:
            self._end(f"{name} stops to spare the recording: {free / 1e6:.0f} MB are free")
        else:
            return
        with suppress(Exception):
            self.canvas.close()

    def _end(self, why: str, failed: bool = True) -> None:
        self.ended, self.failed = f"{why}; charts are no longer saved", failed
        self._say(f"{self.ended}; allanscope replay draws them from the recording")


def refusal(file: Path) -> str:
    """Return why a disk gets no file of charts at all; empty where it does."""
    free = shutil.disk_usage(file.parent).free
    if free >= LEAST_FREE_BYTES:
        return ""
    return f"charts are not saved: the last {free / 1e6:.0f} MB are reserved for the recording"


def expected_bytes(seconds: float, axes: Sequence[str]) -> float:
    """Return about how large the file of a run becomes, before it is made smaller at the end.

    Examples
    --------
    >>> night, month = (expected_bytes(hours * 3600.0, "abcdef") for hours in (12.0, 720.0))
    >>> round(night / 1e6, -1), month < 2.0 * night
    (160.0, True)
    """
    return len(axes) * (
        RESULT_BYTES * LogSpacing.expected(seconds, FILE_SHARE)
        + ROW_BYTES * RowThinner.expected(seconds)
    )


def largest_part(free: int) -> int:
    """Return how large the file may become on a disk with so much free space."""
    return max(min(MOST_BYTES, free // (LARGEST_SHARE + 1)), 0)
