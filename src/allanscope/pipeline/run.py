"""A session with its listeners: live from a device, or replayed from a recording.

A session that was cut off goes on: what it held is taken again, then the device. The recording is
the checkpoint. Replayed through a decoder and an analyser it leaves both exactly as they were, and
both then go on with the device itself; `docs/decisions/0005` says why. The device is read and
recorded meanwhile, so the time that a replay takes costs no sample.
"""

from __future__ import annotations

import gc
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

from allanscope.allan import CurveChoices
from allanscope.analysis import (
    Analyser,
    AnalyserSettings,
    Analysis,
    search_processes,
    with_comparison,
)
from allanscope.errors import AllanscopeError, DeviceError, InputError, UsageError
from allanscope.pipeline.analyse_file import analyse_input, recorded_facts, recorded_settings
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.event_hook import EventHook
from allanscope.pipeline.import_export import import_capture
from allanscope.pipeline.outputs import (
    REPORT,
    ReportProcess,
    ResultFiles,
    discard_session,
    made_folder,
    new_session_folder,
    session_folder,
    write_json,
)
from allanscope.pipeline.process import (
    configure_malloc,
    reuse_memory,
    stopped_by_signals,
    usable_processes,
)
from allanscope.pipeline.refreshing import IN_TERMINAL, IN_VIEWER, UNWATCHED, RefreshPolicy
from allanscope.pipeline.session import NoticeQueue, Session
from allanscope.pipeline.settings import DeviceSettings, SessionSettings, SimulatedSettings
from allanscope.pipeline.stream import device_source, no_samples_error
from allanscope.pipeline.table_files import is_table_file
from allanscope.recording import Recorder, Recording
from allanscope.samples import AXES, Event, Notice
from allanscope.sanitize import print_error
from allanscope.sources import RecordedSource, Source, require_port
from allanscope.view import RerunView, TerminalView, load_rerun, require_rerun
from allanscope.worker_process import WorkerProcess

__all__ = ["OpenSession", "close_recorder", "open_session", "run_live", "run_replay"]

_LOOK_EVERY_S = 0.2

_READY_S = 10.0
"""Before the end of a run, where it is known: then the processes load that its result needs."""


def run_live(
    port: str,
    device: DeviceSettings,
    settings: SessionSettings,
    simulated: SimulatedSettings,
    resume: Path | None = None,
) -> Analysis:
    """Watch a device until it is told to stop; return the result.

    Leaves ``session.mcap``, ``session.rrd``, ``result.json`` and ``report.html`` in the session's
    folder.

    Raises
    ------
    DeviceError
        When the port cannot be opened or nothing was ever received.
    InputError
        When what was received is in none of the known formats.
    """
    past = None if resume is None else Recording(resume)  # before it gets another file
    if past is not None:
        device = recorded_settings(past, device)
        port = _recorded_port(past) if port == "auto" else port
    require_port(port)
    configure_malloc()
    if port == "sim" and settings.view == "none":
        require_rerun()  # a simulated board waits, and the first curve comes sooner
    else:
        load_rerun()  # before the port is opened: a board does not wait
    opened = open_session(port, device, settings, simulated, _policy(settings), past, resume)
    gc.freeze()  # what is loaded stays; to look for garbage in it would hold up the first result
    try:
        analysis = _run(opened.session, settings, opened.folder, opened.facts, opened.recorder)
        if not analysis.samples:
            raise no_samples_error(opened.session.source)
    except AllanscopeError:
        if resume is None and not opened.session.decoding.stats.bytes:
            discard_session(opened.folder)
        raise
    return analysis


def _recorded_port(past: Recording) -> str:
    """Return where a session had its device; ``auto`` where there is no such port any more."""
    name, port = past.metadata.get("name", ""), past.metadata.get("port", "")
    if name == "sim":
        return name
    return port if port and Path(port).exists() else "auto"


class OpenSession(NamedTuple):
    """A session that is about to run, and who records it where."""

    session: Session
    recorder: Recorder
    folder: Path
    facts: dict[str, str]


def open_session(
    port: str,
    device: DeviceSettings,
    settings: SessionSettings,
    simulated: SimulatedSettings,
    policy: RefreshPolicy,
    past: Recording | None = None,
    resume: Path | None = None,
) -> OpenSession:
    """Open a device and its recording; nothing is read yet.

    Raises
    ------
    DeviceError
        When the port cannot be opened.
    """
    if port == "sim":
        device = replace(device, origin="synthetic")
    source = device_source(port, device, simulated)
    notices = NoticeQueue()
    try:
        folder = _folder(source, settings, resume)
        recorder = Recorder(
            folder,
            _metadata(source, device),
            resume=resume is not None,
            on_alarm=lambda line: _report_alarm(line, notices, settings.quiet),
        )
    except BaseException:
        source.close()
        raise
    decoding = Decoding(device.for_wire(), device.wire)
    facts = {"name": source.name, "path": str(folder), **source.identity}
    session = Session(
        source,
        decoding,
        Analyser(_analyser_settings(device, settings)),
        recorder=recorder,
        duration_s=settings.duration_s,
        input_facts=lambda: {**facts, "reader": source.reader},
        notices=notices,
        earlier=earlier_events(past, decoding, _recorded_write(source, recorder)),
        policy=policy,
    )
    return OpenSession(session, recorder, folder, facts)


def _folder(source: Source, settings: SessionSettings, resume: Path | None) -> Path:
    """Return the folder of the session: a new one, or the one that goes on."""
    if resume is None:
        return session_folder(settings.out or settings.folder / new_session_folder(source.name))
    rename_earlier_view(resume)
    return resume


def _recorded_write(source: Source, recorder: Recorder) -> Callable[[bytes], None]:
    """Return what sends bytes to the device, and to the recording: a replay shows who said what."""

    def write(data: bytes) -> None:
        recorder.tx(data, time.monotonic_ns())
        with suppress(DeviceError):
            source.write(data)

    return write


def run_replay(
    path: Path,
    speed: float,
    device: DeviceSettings,
    settings: SessionSettings,
    done: Callable[[Analysis], object] = lambda _: None,
) -> Analysis:
    """Run a recording through the same path as a live device; return the result.

    The page of the web viewer then stays until it is ended by Ctrl-C, where it was asked for or
    somebody sits at a terminal; a script that did not ask for it is not held up.

    Parameters
    ----------
    path : Path
        A recording, the folder of a session, or a file or folder that `import` makes one of.
    speed : float
        A multiple of real time; infinity for as fast as it can be read.
    device : DeviceSettings
        What the recording does not say by itself.
    settings : SessionSettings
        How it is shown and kept.
    done : callable
        Called with the result as soon as it is there, before the page stays.

    Raises
    ------
    InputError
        When there is no recording, or it contains no samples.
    """
    if is_table_file(path):
        with TemporaryDirectory(prefix="allanscope-") as temporary:
            imported = Path(temporary) / f"{path.resolve().name}.mcap"
            import_capture(path, imported, device, settings.quiet)
            return run_replay(imported, speed, device, settings, done)
    no_hook = not settings.on_event and settings.events_to is None
    if math.isinf(speed) and settings.view == "none" and settings.out is None and no_hook:
        final = _replay_without_view(path, device, settings)
        done(final)
        return final
    recording = Recording(path)
    device = recorded_settings(recording, device)
    source = RecordedSource(path, speed)
    load_rerun()  # before there is a folder
    decoding = Decoding(device.for_wire(), device.wire)
    analyser = Analyser(_analyser_settings(device, settings))
    folder = None
    if settings.out is not None:
        folder = made_folder(settings.out)
    facts = {"name": path.name, "path": str(path), **_identity(recording)}
    session = Session(
        source,
        decoding,
        analyser,
        input_facts=lambda: facts,
        policy=_policy(settings),
    )

    def finished(analysis: Analysis) -> None:
        if not analysis.samples:
            raise InputError(f"{path} contains no samples; nothing to replay")
        done(analysis)

    stays = settings.view == "web" or sys.stdout.isatty()
    whole_s = recording.duration_s
    return _run(session, settings, folder, facts, None, whole_s, finished, stays)


def _identity(recording: Recording) -> dict[str, str]:
    """Return what identifies a recording."""
    return {"sha256": recording.sha256(), **recorded_facts(recording)}


class _RecordedIdentity:
    """What identifies the recording of a session that has ended: it is read once more for that.

    Of a night that takes as long as the final analysis, beside which it is found.

    Parameters
    ----------
    folder : Path or None
        Of the session; None where nothing was recorded.
    """

    def __init__(self, folder: Path | None) -> None:
        self._found: dict[str, str] = {}
        # Whoever has had enough of waiting does not wait for this either.
        self._thread = threading.Thread(
            target=self._identify, args=(folder,), name="fingerprint", daemon=True
        )
        self._thread.start()

    def with_identity(self, analysis: Analysis) -> Analysis:
        """Return a result with it, once it is known."""
        self._thread.join()
        return replace(analysis, input={**analysis.input, **self._found})

    def _identify(self, folder: Path | None) -> None:
        if folder is not None:
            with suppress(InputError):
                self._found = _identity(Recording(folder))


def _policy(settings: SessionSettings) -> RefreshPolicy:
    """Return how often the result is computed for those who look."""
    if settings.view != "none":
        return IN_VIEWER
    return IN_TERMINAL if sys.stdout.isatty() and not settings.quiet else UNWATCHED


def _analyser_settings(device: DeviceSettings, settings: SessionSettings) -> AnalyserSettings:
    return AnalyserSettings(
        part=device.part,
        processes=usable_processes(),
        curves=CurveChoices(window_s=settings.window_s),
        references=settings.references,
        full_scales=device.full_scales,
    )


def _replay_without_view(path: Path, device: DeviceSettings, settings: SessionSettings) -> Analysis:
    """Return the result of a recording, without a screen: the fast way, on two cores."""
    curves = CurveChoices(window_s=settings.window_s)
    final = with_comparison(
        analyse_input(path, device, settings.quiet, curves), settings.references
    )
    terminal = TerminalView("quiet" if settings.quiet else "plain")
    terminal.snapshot(final)
    terminal.close()
    return final


class _ResultOutput:
    """Leaves the result in the folder of a session: the numbers at once, the report meanwhile.

    Without a folder it does nothing.

    Attributes
    ----------
    workers : list of WorkerProcess
        They search beside this process, once it is prepared; then the first one draws the report.
    """

    def __init__(self, folder: Path | None, recorded: bool, terminal: TerminalView) -> None:
        self._folder, self._recorded, self._terminal = folder, recorded, terminal
        self._report: ReportProcess | None = None
        self._lock = threading.Lock()
        self.workers: list[WorkerProcess] = []

    def prepare(self, analyser: Analyser) -> None:
        """Start the processes that take part; they take a second to load."""
        with self._lock:
            if self._report is None and self._folder is not None:
                self.workers = search_processes(analyser, REPORT)
                self._report = ReportProcess(*self.workers[:1])

    def begin(self, final: Analysis) -> None:
        """Begin to draw the report, and write the numbers meanwhile: the search is over."""
        for worker in self.workers[1:]:
            worker.close()
        if self._folder is not None and self._report is not None and final.samples:
            self._report.begin(final)
            self._files = ResultFiles(self._folder)
            self._files.write("result.json", partial(write_json, final))

    def finish(self, final: Analysis) -> Analysis:
        """Wait for the report, say what is there, and return the result with what failed."""
        folder = self._folder
        if folder is None or self._report is None or not final.samples:
            return final
        files = self._files
        files.write("report.html", self._report.write)
        files.close()
        final = replace(final, failures=(*final.failures, *files.failures))
        for line in files.failures:
            self._terminal.line(line, "error")
        if files.failures and "result.json" in files.places:
            with suppress(UsageError):  # once more, with what has just failed
                write_json(final, files.places["result.json"] / "result.json")
        here = [name for name, place in files.places.items() if place == folder]
        drawn = (folder / "session.rrd").exists()
        saved = [*reversed(here), *(["session.mcap"] if self._recorded else [])]
        saved += ["session.rrd"] if drawn else []
        beside = f"; beside it {', '.join(saved[1:])}" if saved[1:] else ""
        self._terminal.line(f"Saved: {folder / saved[0]}{beside}")
        if drawn:
            self._terminal.line(f"To see the charts again: allanscope open {folder}")
        return final

    def close(self) -> None:
        """End the processes that are left."""
        with self._lock:
            for process in (self._report, *self.workers):
                if process is not None:
                    process.close()


def _report_alarm(line: str, notices: NoticeQueue, quiet: bool) -> None:
    """Report an alarm of the recorder at once; called in its thread."""
    if quiet and line:
        print_error(line)
    kind: Literal["error", "text"] = "error" if line else "text"
    notices.put(Notice(kind, line or "recording to disk continues", {"host": 1}))


def _metadata(source: Source, device: DeviceSettings) -> dict[str, str]:
    """Return what a replay needs to know, all as text."""
    return {"name": source.name, **source.identity, **device.metadata()}


def _run(
    session: Session,
    settings: SessionSettings,
    folder: Path | None,
    facts: dict[str, str],
    recorder: Recorder | None = None,
    whole_s: float | None = None,
    done: Callable[[Analysis], None] = lambda _: None,
    stays: bool = False,
) -> Analysis:
    """Run one session with its listeners, and leave its result in the folder.

    The result is handed to `done`; then the page of the web viewer may stay until it is ended.
    """
    mode: Literal["quiet", "auto"] = "quiet" if settings.quiet else "auto"
    stopped = threading.Event()

    def stop() -> None:
        stopped.set()
        session.stop()

    hook = EventHook(settings.on_event, settings.events_to, session.fail)
    terminal = TerminalView(mode, session.mark, stop, whole_s=whole_s)
    named = {**facts, "name": facts["name"]}
    viewer = RerunView(folder, settings.view, named, terminal.line, settings.view_port)
    session.listeners = (terminal, viewer, hook)
    final: Analysis | None = None
    output = _ResultOutput(folder, recorder is not None, terminal)

    def stay() -> None:
        nonlocal final
        if final is None:
            return
        final = output.finish(final)
        if stays and viewer.serves_page and not stopped.is_set():
            terminal.line("the charts stay available until Ctrl-C")
        terminal.close()
        done(final)
        while stays and viewer.serves_page and not stopped.wait(_LOOK_EVERY_S):
            pass

    with stopped_by_signals(stop):
        try:
            try:
                _open(viewer, terminal, recorder, settings.duration_s)
                with _prepared(output, session.analyser, settings.duration_s):
                    session.run()
            finally:
                _end_input(session, hook, recorder)
            recorded = _RecordedIdentity(None if recorder is None else folder)
            ended = "Recording stopped" if whole_s is None else "Replay finished"
            terminal.line(f"{ended}; running the final analysis")
            output.prepare(session.analyser)
            reuse_memory()
            result = recorded.with_identity(session.result("full", output.workers))
            terminal.snapshot(result)
            output.begin(result)
            final = result
        finally:
            viewer.close(final, stay=stay)
            terminal.close()
            output.close()
    return (
        final if not viewer.failure else replace(final, failures=(*final.failures, viewer.failure))
    )


@contextmanager
def _prepared(
    output: _ResultOutput, analyser: Analyser, duration_s: float | None
) -> Iterator[None]:
    """Prepare the end of a run, if it is known when that is, some seconds before it comes."""
    if duration_s is None:
        yield
        return
    due_s = max(duration_s - _READY_S, duration_s / 2.0)
    timer = threading.Timer(due_s, output.prepare, [analyser])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _end_input(session: Session, hook: EventHook, recorder: Recorder | None) -> None:
    """End what comes in, and its recording, first: the result takes a while, and is of it."""
    session.source.close()
    hook.close()
    if recorder is not None:
        close_recorder(recorder, session)
    session.emit_notices(time.monotonic_ns())


def close_recorder(recorder: Recorder, session: Session) -> None:
    """End the recording of a session, and report to it what is missing."""
    recorder.describe(wire=session.decoding.wire)
    recorder.close()
    if recorder.failure:
        session.fail(recorder.failure)


def _open(
    viewer: RerunView, terminal: TerminalView, recorder: Recorder | None, duration_s: float | None
) -> None:
    """Open the charts, and say how large their file becomes beside a recording."""
    viewer.start()
    notice = viewer.size_notice(AXES, duration_s)
    if recorder is not None and notice:
        terminal.line(notice)


def earlier_events(
    past: Recording | None, decoding: Decoding, write: Callable[[bytes], None]
) -> Iterator[Event]:
    """Yield the events that a session held before, if it goes on; then `decoding` goes on live.

    Raises
    ------
    InputError
        When the wire format of the past is unknown.
    """
    for buffer in past.buffers() if past is not None else ():
        yield from decoding.feed_buffer(buffer)
    decoding.resume(write)


def rename_earlier_view(folder: Path) -> None:
    """Keep what was shown before under a name of its own: ``session.rrd`` is the newest part."""
    shown = folder / "session.rrd"
    if shown.exists():
        number = 1
        while (aside := folder / f"session-before-{number:03d}.rrd").exists():
            number += 1
        shown.rename(aside)
