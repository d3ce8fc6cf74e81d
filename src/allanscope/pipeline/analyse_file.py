"""Analyse a recording, a raw capture or delimited text to the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from allanscope.allan import CurveChoices
from allanscope.analysis import Analyser, AnalyserSettings
from allanscope.errors import InputError, UsageError
from allanscope.pipeline.columns import with_units
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.process import search_process, usable_processes
from allanscope.pipeline.replaying import feed_analyser
from allanscope.pipeline.settings import DeviceSettings
from allanscope.pipeline.table_files import is_table_file, table_of_file
from allanscope.quantities import counted
from allanscope.recording import Fingerprint, Recording, is_recording
from allanscope.view import progress
from allanscope.worker_process import WorkerProcess

if TYPE_CHECKING:
    from allanscope.analysis import Analysis

__all__ = [
    "analyse_input",
    "full_settings",
    "recorded_facts",
    "recorded_settings",
    "require_rate",
    "settings_of",
]

FULL_ROWS = 1 << 21
"""Rows of history that an analysis to the end keeps: 5.6 h at 104 Hz sample by sample."""

FEWEST = 5
"""Samples that two averaging times take."""

FULL_BUFFERED = 1 << 17
"""Rows that it sums up at a time: 20 ms of work for each of two cores."""


def analyse_input(
    path: Path,
    device: DeviceSettings,
    quiet: bool = False,
    curves: CurveChoices | None = None,
    workers: Sequence[WorkerProcess] | None = None,
) -> Analysis:
    """Return the full result of a file.

    Parameters
    ----------
    path : Path
        A recording, the folder of a session, a raw capture or delimited text.
    device : DeviceSettings
        What the file does not say by itself.
    quiet : bool
        Show no progress.
    curves : CurveChoices, optional
        How the curves are made.
    workers : sequence of WorkerProcess, optional
        They search beside this process; from `search_process` if not given.

    Raises
    ------
    InputError
        When it cannot be read, or contains no samples, or too few for any curve.
    UsageError
        When its sample rate cannot be known from it and was not given.
    """
    if workers is None:
        with search_process(path) as started:
            return analyse_input(path, device, quiet, curves, started)
    facts = {"name": path.name, "path": str(path)}
    if is_table_file(path):
        return _analyse_table(path, device, facts, quiet, curves, workers)
    fingerprint = None
    if path.is_dir() or is_recording(path):
        fingerprint, recording = Fingerprint(), Recording(path)
        facts |= recorded_facts(recording)
        device = recorded_settings(recording, device)
    else:
        device = device.of_file(path)
    decoding = Decoding(device.for_wire(), device.wire)
    settings = replace(full_settings(device.part, curves=curves), full_scales=device.full_scales)
    analyser = Analyser(settings)
    feed_analyser(
        path, decoding, analyser, quiet, on_buffer=fingerprint.add if fingerprint else None
    )
    if analyser.state is None or not analyser.state.samples:
        why = analyser.errors[0] if analyser.errors else "nothing to analyse"
        raise InputError(f"{path} contains no samples; {why}")
    require_rate(path, analyser)
    facts["wire"] = decoding.wire
    if fingerprint is not None:
        facts["sha256"] = fingerprint.hexdigest()
    from allanscope.analysis import summarise  # half of all that is loaded

    with progress(None, "searching for effects", quiet=quiet):
        analysis = summarise(
            analyser, decoding.stats, "full", facts, decoding.reconnects, workers=workers
        )
    return _require_curve(path, analysis)


def _require_curve(path: Path, analysis: Analysis) -> Analysis:
    """Return a result if it has a curve on any axis.

    One averaging time is no curve: two of them take five samples without a gap between.
    """
    curves = [axis.curves["oadev"] for axis in analysis.axes.values() if "oadev" in axis.curves]
    if not any(len(curve.tau) > 1 for curve in curves):
        raise InputError(f"{path}: {_too_few(analysis.samples, analysis.segments)}")
    return analysis


def _too_few(samples: int, segments: int) -> str:
    pieces = f" in {segments} pieces" if segments > 1 else ""
    known = f"{counted(samples, 'sample')}{pieces} {'are' if samples != 1 else 'is'}"
    return f"{known} too few for any curve; record for longer"


def full_settings(
    part: str, one_thread: bool = False, curves: CurveChoices | None = None
) -> AnalyserSettings:
    """Return how an analysis to the end is made, whatever its samples come from.

    Parameters
    ----------
    part : str
        The part, when the user named one.
    one_thread : bool
        Stay on one core, for whoever has other work for the others; the result is the same.
    curves : CurveChoices, optional
        How the curves are made.
    """
    if one_thread:
        return AnalyserSettings(part, history_rows=FULL_ROWS, over_time=False)
    chosen = curves or CurveChoices()
    return AnalyserSettings(
        part,
        per_octave=chosen.times_in_each_octave,
        history_rows=FULL_ROWS,
        buffered_rows=FULL_BUFFERED,
        processes=usable_processes(),
        curves=chosen,
    )


def _analyse_table(
    path: Path,
    device: DeviceSettings,
    facts: dict[str, str],
    quiet: bool,
    curves: CurveChoices | None,
    workers: Sequence[WorkerProcess],
) -> Analysis:
    """Return the result of a file of arrays."""
    from allanscope.pipeline.analyse_arrays import analyse_columns

    found = table_of_file(path, device.stream)
    device = replace(
        device, part=device.part or found.part, rate_hz=device.rate_hz or found.rate_hz
    )
    if not device.rate_hz and found.columns.time_s is None:
        raise UsageError(f"{path} has no times that tell its sample rate; give --rate HZ")
    try:
        columns = with_units(found.columns, dict(device.units))
        with progress(None, "searching for effects", quiet=quiet):
            facts["wire"] = found.kind
            analysis = analyse_columns(columns, device, facts, curves, workers)
    except UsageError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return _require_curve(path, analysis)


def require_rate(path: Path | str, analyser: Analyser) -> None:
    """Refuse samples without times or a rate: tau would be unknown.

    Raises
    ------
    UsageError
        If there is no rate.
    InputError
        If there are too few samples for any curve.
    """
    state = max(analyser.configurations, key=lambda one: one.samples)
    if state.samples < FEWEST:
        raise InputError(f"{path}: {_too_few(state.samples, state.segments)}")
    if not state.info.nominal_hz and not state.clock.rate().is_measured:
        raise UsageError(
            f"{path} has no times that tell its sample rate (or none that go up); give --rate HZ"
        )


def recorded_facts(recording: Recording) -> dict[str, str]:
    """Return what a recording says of its circumstances: when it was made, and of which unit."""
    known = recording.metadata
    named = {"started": known.get("started"), "serial_number": known.get("serial_number")}
    return {name: text for name, text in named.items() if text}


def settings_of(source: Path, device: DeviceSettings) -> DeviceSettings:
    """Return the settings with what a recording, or else the name of a file, says of them."""
    if source.is_dir() or is_recording(source):
        return recorded_settings(Recording(source), device)
    return device.of_file(source)


def recorded_settings(recording: Recording, device: DeviceSettings) -> DeviceSettings:
    """Return the settings a session was made with, where the user says nothing else."""
    known = recording.metadata

    def number(name: str) -> float | None:
        return float(known[name]) if known.get(name) else None

    units = tuple(tuple(one.split("=", 1)) for one in known.get("units", "").split() if "=" in one)
    try:
        return DeviceSettings(
            part=device.part or known.get("part", ""),
            rate_hz=device.rate_hz or number("rate_hz"),
            gyro_fs=device.gyro_fs or number("gyro_fs"),
            accel_fs=device.accel_fs or number("accel_fs"),
            wire=device.wire or known.get("wire", ""),
            units=device.units or units,  # type: ignore[arg-type]
            origin="synthetic" if known.get("origin") == "synthetic" else device.origin,
            sensor=known.get("sensor", ""),
        )
    except ValueError:
        raise InputError("the recording's own settings are damaged; give them again") from None
