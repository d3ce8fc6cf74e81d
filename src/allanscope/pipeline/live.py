"""A session with an audience: live from a device, or replayed from a recording."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path

from allanscope.analysis.analyser import Analyser, AnalyserSettings
from allanscope.analysis.result import Analysis
from allanscope.errors import DeviceError, InputError
from allanscope.pipeline.analyse import recorded_settings
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.outputs import (
    new_session_folder,
    session_folder,
    write_json,
    write_report,
)
from allanscope.pipeline.replaying import analysed
from allanscope.pipeline.session import Session
from allanscope.pipeline.settings import DeviceSettings, SessionSettings, SimulatedSettings
from allanscope.pipeline.simulate import simulator
from allanscope.recording import Recorder, Recording
from allanscope.samples import Gap
from allanscope.sources import RecordedSource, Source, open_source
from allanscope.view import RerunView, TerminalView

__all__ = ["run_live", "run_replay"]


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
        When the port cannot be opened or nothing was ever heard.
    InputError
        When what was heard is in none of the known formats.
    """
    if resume is not None:
        device = recorded_settings(Recording(resume), device)
    source = _source(port, device, simulated)
    try:
        folder = resume or session_folder(settings.out or new_session_folder(source.name))
        analyser = _resumed(resume, device, settings.quiet)
        recorder = Recorder(folder, _metadata(source, device), resume=resume is not None)
    except BaseException:
        source.close()
        raise

    def write(data: bytes) -> None:
        # What is sent belongs to the recording: a replay shows who said what, and when.
        recorder.tx(data, time.monotonic_ns())
        with suppress(DeviceError):
            source.write(data)

    decoding = Decoding(device.for_wire(), device.wire, write)
    facts = {"name": source.name, "path": str(folder), **source.identity}
    try:
        analysis = _run(source, decoding, analyser, settings, folder, facts, recorder)
    finally:
        recorder.describe(wire=decoding.wire)
        recorder.close()
    if not analysis.samples:
        raise DeviceError(f"{source.name}: nothing was heard that holds samples; is it streaming?")
    return analysis


def run_replay(
    path: Path, speed: float, device: DeviceSettings, settings: SessionSettings
) -> Analysis:
    """Run a recording through the same path as a live device; return the result.

    Raises
    ------
    InputError
        When there is no recording, or it holds no samples.
    """
    recording = Recording(path)
    device = recorded_settings(recording, device)
    source = RecordedSource(path, speed)
    decoding = Decoding(device.for_wire(), device.wire)
    analyser = Analyser(AnalyserSettings(part=device.part))
    folder = None
    if settings.out is not None:
        folder = settings.out
        folder.mkdir(parents=True, exist_ok=True)
    facts = {"name": path.name, "path": str(path), "sha256": recording.sha256()}
    analysis = _run(source, decoding, analyser, settings, folder, facts, None)
    if not analysis.samples:
        raise InputError(f"{path} holds no samples; nothing to replay")
    return analysis


def _source(port: str, device: DeviceSettings, simulated: SimulatedSettings) -> Source:
    if port != "sim":
        return open_source(port)
    from allanscope.sources.simulated import SimulatedSource

    return SimulatedSource(
        device.wire or "native",
        sensor=simulator(device, simulated),
        faults=simulated.faults,
        seed=simulated.seed,
    )


def _resumed(folder: Path | None, device: DeviceSettings, quiet: bool) -> Analyser:
    """Return an analyser as it was when the session was cut off, with a gap at its end."""
    analyser = Analyser(AnalyserSettings(part=device.part))
    if folder is not None:
        decoding = Decoding(device.for_wire(), device.wire)
        analysed(folder, decoding, analyser, quiet, doing="resuming")
        analyser.take(Gap("resumed", None))
    return analyser


def _metadata(source: Source, device: DeviceSettings) -> dict[str, str]:
    """Return what a replay needs to know, all as text; empty entries are left out."""
    facts = {
        "name": source.name,
        **source.identity,
        "part": device.part,
        "rate_hz": "" if device.rate_hz is None else repr(device.rate_hz),
        "gyro_fs": "" if device.gyro_fs is None else repr(device.gyro_fs),
        "accel_fs": "" if device.accel_fs is None else repr(device.accel_fs),
        "wire": device.wire,
        "units": " ".join(f"{sensor}={unit}" for sensor, unit in device.units),
    }
    return {name: text for name, text in facts.items() if text}


def _run(
    source: Source,
    decoding: Decoding,
    analyser: Analyser,
    settings: SessionSettings,
    folder: Path | None,
    facts: dict[str, str],
    recorder: Recorder | None,
) -> Analysis:
    """Run one session with its audience, and leave its result in the folder."""
    if decoding.wire in ("", "native"):
        # Compiled code is loaded before the first byte comes, not when it does.
        import_module("allanscope.wire.native.kernel")
    session: Session | None = None

    def quit_() -> None:
        if session is not None:
            session.stop()

    def mark(text: str) -> None:
        if session is not None:
            session.mark(text)

    terminal = TerminalView("quiet" if settings.quiet else "auto", mark, quit_)
    viewer = RerunView(folder, settings.view, {**facts, "name": facts["name"]}, terminal.line)
    final: Analysis | None = None
    try:
        viewer.start()
        session = Session(
            source,
            decoding,
            analyser,
            audience=(terminal, viewer),
            ledger=recorder,
            duration_s=settings.duration_s,
            input_facts=lambda: facts,
        )
        with _stopped_by_signals(session):
            session.run()
        final = session.result("full")
        terminal.snapshot(final)
        if folder is not None and final.samples:
            write_json(final, folder / "result.json")
            write_report(final, folder / "report.html")
    finally:
        viewer.close(final)
        terminal.close()
    return final


@contextmanager
def _stopped_by_signals(session: Session) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end the session as if its time were over; a second Ctrl-C insists."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, _: object) -> None:
        session.stop()
        signal.signal(number, signal.default_int_handler)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
