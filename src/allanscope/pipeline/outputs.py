"""What a run leaves behind: the result as JSON, the report as HTML, and charts to open again.

Each file is written whole or not at all.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
import threading
import time
import webbrowser
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from allanscope.atomic_write import require_writable, write_text
from allanscope.errors import DeviceError, InputError, UsageError
from allanscope.pipeline.process import stopped_by_signals, usable_processes
from allanscope.pipeline.settings import ViewMode
from allanscope.view import ViewerProcess, has_display
from allanscope.worker_process import WorkerError, WorkerProcess

if TYPE_CHECKING:
    from allanscope.allan import CurveChoices
    from allanscope.analysis import Analysis
    from allanscope.pipeline.settings import DeviceSettings
    from allanscope.report import Picture

__all__ = [
    "REPORT",
    "ReportProcess",
    "ResultFiles",
    "charts_of",
    "discard_session",
    "made_folder",
    "new_session_folder",
    "open_charts",
    "report_sessions",
    "session_folder",
    "write_json",
    "write_report",
    "write_results",
    "write_table",
]

_LOOK_EVERY_S = 0.2

REPORT = "allanscope.report.ahead"
"""Module that a process which draws a report loads before."""


def write_json(analysis: Analysis, path: Path) -> None:
    """Write the result in the schema ``allanscope/1``."""
    write_text(path, json.dumps(analysis.to_dict(), indent=1, allow_nan=False) + "\n")


def write_table(analysis: Analysis, path: Path) -> None:
    """Write every curve as delimited text: a row for each axis, estimator and averaging time.

    With variances asked for, value and limits are those of the variance, under DT0064's names.
    """
    from allanscope.allan import variance_name

    squared = analysis.choices.variance
    head = ["axis", "estimator", "tau_s", "m", "value", "lower", "upper"]
    head += ["simple_lower", "simple_upper"] * analysis.choices.simple_limits
    rows = [",".join([*head, "edf", "terms", "noise", "trusted"])]
    for axis, one in analysis.axes.items():
        for kind, curve in one.curves.items():
            columns = [curve.deviation, curve.lower, curve.upper]
            columns += curve.simple_limits() if analysis.choices.simple_limits else ()
            name = variance_name(kind) if squared else kind.upper()
            for i, (tau, m) in enumerate(zip(curve.tau, curve.m, strict=True)):
                values = [column[i] ** 2 if squared else column[i] for column in columns]
                cells = [axis, name, f"{tau:.9g}", str(m), *(f"{x:.9g}" for x in values)]
                cells += [f"{curve.edf[i]:.4g}", str(curve.terms[i]), str(curve.noise[i])]
                rows.append(",".join([*cells, str(int(curve.trusted[i]))]))
    write_text(path, "\n".join(rows) + "\n")


def write_report(
    analysis: Analysis,
    path: Path | None,
    figures: Path | None = None,
    *,
    title: str = "",
    operator: str = "",
    full: bool = False,
) -> None:
    """Write the report of one session as one HTML file, and its pictures into a folder.

    Parameters
    ----------
    analysis : Analysis
        A full result.
    path : Path or None
        The page; None for none.
    figures : Path, optional
        Folder that gets every picture as SVG and as PNG.
    title, operator : str
        Title of the page, and name of the operator.
    full : bool
        Open what is folded otherwise, so that it is printed as well.
    """
    from allanscope.report import pictures, render

    drawn = pictures(analysis)
    if path is not None:
        write_text(path, render(analysis, drawn, title=title, operator=operator, full=full))
    if figures is not None:
        _save(drawn, figures)


class ReportProcess:
    """Draws the report in another process, while this one finishes what else is to be done.

    The process takes a second to get ready: it is started when the end is in sight.

    Parameters
    ----------
    worker : WorkerProcess, optional
        One that has loaded `REPORT`, and is free when the report is begun.
    """

    def __init__(self, worker: WorkerProcess | None = None) -> None:
        self._worker = worker or WorkerProcess(REPORT)
        self._analysis: Analysis | None = None
        self._page = ""

    def begin(self, analysis: Analysis) -> None:
        """Begin to draw the report of a full result."""
        self._analysis, self._page = analysis, ""
        with suppress(WorkerError):  # says so again when it is asked for the page
            self._worker.ask(_drawn, analysis, usable_processes() > 1)

    def write(self, path: Path) -> None:
        """Write the report that was begun, when it is drawn.

        Raises
        ------
        UsageError
            When it cannot be written there.
        """
        assert self._analysis is not None
        if not self._page:
            try:
                self._page = self._worker.answer()
            except WorkerError:  # killed, or no memory for it: it is drawn here
                self._page = _drawn(self._analysis)
        write_text(path, self._page)

    def close(self) -> None:
        """End the process."""
        self._worker.close()


def _drawn(analysis: Analysis, forked: bool = False) -> str:
    from allanscope.report import render

    return render(analysis, forked=forked)


class ResultFiles:
    """Writes the files of a result, each by itself, into the folder of a session.

    What the folder does not take goes to a new folder among the temporary ones.

    Attributes
    ----------
    places : dict of str to Path
        Folder of each file that was written.
    failures : list of str
        A line for each that is not where it belongs.
    """

    def __init__(self, folder: Path) -> None:
        self.places: dict[str, Path] = {}
        self.failures: list[str] = []
        self._folder = folder
        self._spare: Path | None = None

    def write(self, name: str, write: Callable[[Path], object]) -> None:
        """Write one file; drawing a report may fail with an internal error as well."""
        try:
            try:
                write(self._folder / name)
                self.places[name] = self._folder
            except UsageError as error:
                spare = self._spare = self._spare or Path(tempfile.mkdtemp(prefix="allanscope-"))
                write(spare / name)
                self.places[name] = spare
                why = str(error).partition("; choose")[0]
                self.failures.append(f"{why}; {name} is in {spare}")
        except Exception as error:
            self.failures.append(f"{name} is lost: {error}")

    def close(self) -> None:
        """Remove the temporary folder if it took nothing."""
        if self._spare is not None:
            with suppress(OSError):  # where something is in it
                self._spare.rmdir()


def write_results(analysis: Analysis, folder: Path) -> ResultFiles:
    """Write ``result.json``, then ``report.html`` into the folder of a session."""
    files = ResultFiles(folder)
    files.write("result.json", partial(write_json, analysis))
    files.write("report.html", partial(write_report, analysis))
    files.close()
    return files


def _save(drawn: Mapping[str, Picture], folder: Path) -> None:
    from allanscope.report import save_pictures

    try:
        save_pictures(drawn, folder)
    except OSError as error:
        raise UsageError(
            f"cannot write figures to {folder}: {error.strerror}; choose another folder"
        ) from None


def new_session_folder(device: str) -> Path:
    """Return a folder named after time and device that does not exist yet."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", device).strip("-")[-24:] or "device"
    return Path(time.strftime(f"session-%Y%m%d-%H%M%S-{plain}"))


def session_folder(path: Path) -> Path:
    """Make the folder of a session.

    Raises
    ------
    UsageError
        When it cannot be made or already contains a session: nothing is ever overwritten.
    """
    if any(path.glob("session*.mcap")):
        raise UsageError(
            f"{path} already contains a session; choose another folder, or --resume {path}"
        )
    return made_folder(path)


def made_folder(path: Path) -> Path:
    """Make a folder where there is none yet.

    Raises
    ------
    UsageError
        When it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot make the folder {path}: {error.strerror}") from None
    return path


def discard_session(path: Path) -> None:
    """Remove what a session that received no byte has left, and its folder if empty."""
    with suppress(OSError):
        for name in ("session.mcap", "session.rrd"):
            (path / name).unlink(missing_ok=True)
        path.rmdir()


def report_sessions(
    paths: list[Path],
    out: Path,
    device: DeviceSettings,
    quiet: bool = True,
    figures: Path | None = None,
    curves: CurveChoices | None = None,
    *,
    title: str = "",
    operator: str = "",
    full: bool = False,
) -> Path:
    """Write the report of one session, or one that compares several; return its path."""
    from allanscope.pipeline.analyse_file import analyse_input

    require_writable(out)
    sessions = {
        name: analyse_input(path, device, quiet, curves)
        for name, path in zip(short_names(paths), paths, strict=True)
    }
    if len(sessions) == 1:
        (one,) = sessions.values()
        write_report(one, out, figures, title=title, operator=operator, full=full)
        return out
    from allanscope.report import comparing_pictures, render_comparison

    drawn = comparing_pictures(sessions)
    write_text(out, render_comparison(sessions, drawn))
    if figures is not None:
        _save(drawn, figures)
    return out


def short_names(paths: list[Path]) -> list[str]:
    """Return the paths without the folder that they share, each once."""
    whole = [path.absolute() for path in paths]
    if len(set(whole)) < len(whole):
        raise UsageError("the same session is named twice; a comparison needs different ones")
    if len(whole) == 1:
        return [str(paths[0])]
    shared = Path(os.path.commonpath(whole))
    return [str(path.relative_to(shared)) for path in whole]


def open_charts(
    source: str, view: ViewMode, port: int | None, report: Callable[[str], None]
) -> None:
    """Show what a session has drawn, until the window is closed or Ctrl-C ends the page.

    Parameters
    ----------
    source : str
        The folder of a session, a ``.rrd``, or the address of a session that runs on this machine.
    view : {'auto', 'window', 'web'}
        ``auto`` is a window where there is a display, else the web viewer.
    port : int or None
        Of the page, with the data at the one after it; None for any free ones.
    report : callable
        Called with a line for the user.

    Raises
    ------
    InputError
        When there are no charts to open.
    UsageError
        When an address is not of this machine, or the port is taken.
    DeviceError
        When no window can be opened, or the viewer is not installed.
    """
    charts = charts_of(source)
    web = view == "web" or (view == "auto" and not has_display())
    stopped = threading.Event()
    with stopped_by_signals(stopped.set):
        if not web:
            if not _shown(ViewerProcess(charts, web=False, port=port), stopped):
                return
            if view == "window":
                raise DeviceError("no window can be opened here; use --view web")
            report("no window can be opened here")
        viewer = ViewerProcess(charts, web=True, port=port)
        report(f"charts: {viewer.address}  (Ctrl-C ends)")
        if has_display():
            webbrowser.open(viewer.address)
        if _shown(viewer, stopped):
            raise DeviceError(f"the viewer could not show {charts}")


def charts_of(source: str) -> str:
    """Return what the viewer is to open: a file, or an address on the loopback interface."""
    if "://" in source:
        address = urlsplit(source)
        if address.scheme != "rerun+http" or address.hostname not in ("127.0.0.1", "localhost"):
            raise UsageError(
                f"{source} is not an address of this machine; write "
                "rerun+http://127.0.0.1:PORT/proxy, "
                "or the folder of a session"
            )
        return source
    path = Path(source)
    if path.is_dir():
        path /= "session.rrd"
    if not path.exists():
        raise InputError(
            f"{path} does not exist; allanscope replay draws the charts of a recording"
        )
    if path.suffix != ".rrd":
        raise InputError(
            f"{path} is not an .rrd file; allanscope replay draws the charts of a recording"
        )
    return str(path)


def _shown(viewer: ViewerProcess, stopped: threading.Event) -> bool:
    """Wait until the viewer ends or is to end; return whether it failed."""
    try:
        while not stopped.is_set():
            if viewer.wait(_LOOK_EVERY_S):
                return viewer.failed()
        return False
    finally:
        viewer.stop()
