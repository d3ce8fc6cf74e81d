"""Everything that is written into one Rerun recording, by one thread, and where that goes.

Data go to a server on the loopback interface, from which viewers fetch them, and to a file. The
other way round, connecting to a viewer, an absent or stalled viewer would sooner or later block the
log calls for ever, and stop the file as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import rerun as rr

from allanscope.allan import KINDS
from allanscope.analysis import Analysis
from allanscope.errors import DeviceError
from allanscope.sanitize import one_line
from allanscope.view.change_log import ChangeLog, Level
from allanscope.view.chart_builder import DEFAULT_ESTIMATOR, ChartBuilder
from allanscope.view.rerun_blueprint import layout
from allanscope.view.rerun_drawing import DrawingWriter
from allanscope.view.rerun_series import SENSORS, Series
from allanscope.view.tables import (
    axis_table,
    coefficients_table,
    findings_table,
    loop_table,
    run_table,
    verdict_text,
)
from allanscope.view.viewer_process import LOOPBACK, free_port, require_free_port

__all__ = [
    "APPLICATION",
    "SERVER_MEMORY",
    "Canvas",
    "open_file",
    "open_output",
    "open_server",
]

_LEVELS: Mapping[Level, str] = {"info": "INFO", "warn": "WARN", "error": "ERROR"}
_FLUSH_S = 3.0

APPLICATION = "allanscope"
SERVER_MEMORY = "96MiB"
"""What the server keeps for viewers that join late; beyond it the oldest data are dropped."""

_ATTEMPTS = 5
_FIRST_FLUSH_S = 5.0


class Canvas:
    """Draws results, series and remarks; lays out the viewer.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Where everything goes.
    session : mapping
        What is known of the session; see `RerunView`.
    estimators : sequence of str
        Those that have a place in the layout from the beginning; others get theirs with their first
        curve, in a layout that is sent anew.

    Attributes
    ----------
    series : Series
        What is plotted against the time of the run.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        session: Mapping[str, object],
        estimators: Sequence[str] = (),
    ) -> None:
        started = session.get("started_unix_s")
        self._recording = recording
        self._session = {k: v for k, v in session.items() if k != "started_unix_s"}
        self.series = Series(recording, started if isinstance(started, float) else None)
        self._ink = DrawingWriter(recording)
        self._painter = ChartBuilder(self._ink.log)
        self._changes = ChangeLog()
        self._tables: dict[str, str] = {}
        self._kinds = dict.fromkeys([DEFAULT_ESTIMATOR, *estimators])
        self._layout: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())

    @classmethod
    def serve(cls, session: Mapping[str, object], port: int | None = None) -> tuple[Canvas, str]:
        """Return a canvas, and the address from which viewers can fetch it."""
        recording, address = open_server(one_line(session.get("name", "allanscope")), port)
        return cls(recording, session), address

    @classmethod
    def to_file(cls, session: Mapping[str, object], file: Path) -> Canvas:
        """Return a canvas that writes to a file, with the layout of the last result at once.

        A layout is 1 MB, and takes as long as a result.
        """
        return cls(open_file(one_line(session.get("name", "allanscope")), file), session, KINDS)

    @classmethod
    def to_output(cls, session: Mapping[str, object], application: str, recording: str) -> Canvas:
        """Return a canvas that writes to standard output, for the viewer that started us."""
        name = one_line(session.get("name", "allanscope"))
        return cls(open_output(name, application, recording), session)

    def describe(self, axes: tuple[str, ...]) -> None:
        """Lay out the viewer for these axes and say how their series look."""
        self.series.style(axes)
        self._lay_out(axes, tuple(self._kinds))

    def result(self, analysis: Analysis, everything: bool) -> None:
        """Draw a result; see `ChartBuilder.paint` for `everything`."""
        self._lay_out(tuple(analysis.axes), self._estimators(analysis))
        self.series.now(analysis.duration_s)
        if everything:
            self.series.style(tuple(analysis.axes))
            self._tables.clear()
            self._ink.forget()
        self._painter.paint(analysis, everything)
        self.series.result(analysis)
        self._write_tables(analysis, everything)
        for level, line in self._changes.update(analysis):
            self._log(line, level)

    def remark(self, elapsed_s: float, text: str, level: Level) -> None:
        """Add a line to the log, at a whole second: the log's column has no room for more."""
        self.series.now(float(round(elapsed_s)))
        self._log(text, level)

    def state(self, elapsed_s: float, state: str) -> None:
        """Note what the link does from now on."""
        self.series.now(elapsed_s)
        self.series.state(state)

    def health(self, elapsed_s: float, numbers: Mapping[str, object]) -> None:
        """Plot counters of the link."""
        self.series.now(elapsed_s)
        self.series.health(numbers)

    def flush(self) -> None:
        """Hand everything to the server and the file; once more where it takes too long.

        A process that was stopped meanwhile, or a machine that slept, has failed to do nothing.
        """
        try:
            self._recording.flush(timeout_sec=_FLUSH_S)
        except Exception:
            self._recording.flush(timeout_sec=_FLUSH_S)

    def close(self) -> None:
        """Hand everything over and end."""
        try:
            self.flush()
        finally:
            self._recording.disconnect()

    def _estimators(self, analysis: Analysis) -> tuple[str, ...]:
        """Return all estimators that ever came, the default one first."""
        for axis in analysis.axes.values():
            self._kinds |= dict.fromkeys(axis.curves)
        return tuple(self._kinds)

    def _lay_out(self, axes: tuple[str, ...], estimators: tuple[str, ...]) -> None:
        """Send the layout if it is new. It replaces what the user arranged, hence seldom."""
        if (axes, estimators) != self._layout and axes:
            self._layout = (axes, estimators)
            self._recording.send_blueprint(layout(axes, estimators))

    def _write_tables(self, analysis: Analysis, everything: bool) -> None:
        self._table("verdict", verdict_text(analysis))
        self._table("coefficients", coefficients_table(analysis))
        self._table("findings", findings_table(analysis))
        for unit, sensor in SENSORS.items():
            self._table(f"loop_{sensor}", loop_table(analysis, unit))
        if everything:
            self._table("run", run_table(analysis, self._session))
        for name, axis in analysis.axes.items():
            self._table(name, axis_table(name, axis))

    def _table(self, name: str, text: str) -> None:
        if self._tables.get(name) != text:
            self._tables[name] = text
            document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
            self._recording.log(f"/tables/{name}", document)

    def _log(self, text: str, level: Level) -> None:
        self._recording.log("/log", rr.TextLog(one_line(text), level=_LEVELS[level]))


def open_server(name: str, port: int | None = None) -> tuple[rr.RecordingStream, str]:
    """Return a recording that is served to viewers, and the address of its server.

    Parameters
    ----------
    name : str
        Of the recording, shown to people.
    port : int, optional
        Where it is served; any free port if not given.

    Raises
    ------
    DeviceError
        When no port of the loopback interface can be had.
    UsageError
        When the port that was given is taken.
    """
    if port is not None:
        require_free_port(port)
    for _ in range(_ATTEMPTS):
        recording = _recording(name)
        server = _server(port or free_port())
        recording.set_sinks(server)
        try:
            # Rerun reports that a port is taken, by whoever was faster, only when flushing.
            recording.flush(timeout_sec=_FIRST_FLUSH_S)
        except Exception:
            recording.disconnect()
        else:
            return recording, str(server.uri)
    raise DeviceError("the viewer finds no free port on 127.0.0.1; use --view none")


def open_file(name: str, file: Path) -> rr.RecordingStream:
    """Return a recording that goes to a file.

    Parameters
    ----------
    name : str
        Of the recording, shown to people.
    file : Path
        It gets no footer, whose index would grow in memory all night.
    """
    recording = _recording(name)
    recording.set_sinks(rr.FileSink(str(file), write_footer=False))
    return recording


def open_output(name: str, application: str = "", identity: str = "") -> rr.RecordingStream:
    """Return a recording that goes to standard output.

    Parameters
    ----------
    name : str
        Of the recording, shown to people.
    application, identity : str
        Names under which the reading viewer wants it; empty for our own.
    """
    recording = _recording(name, application or APPLICATION, identity)
    recording.stdout()
    return recording


def _recording(name: str, application: str = APPLICATION, identity: str = "") -> rr.RecordingStream:
    """Return a recording that goes nowhere yet; what is logged waits until it does."""
    recording = rr.RecordingStream(application, recording_id=identity or None)
    recording.set_log_time_enabled(False)
    recording.send_recording_name(name)
    return recording


def _server(port: int) -> rr.GrpcServerSink:
    return rr.GrpcServerSink(bind_ip=LOOPBACK, port=port, server_memory_limit=SERVER_MEMORY)
