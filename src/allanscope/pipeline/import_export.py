"""Other people's data in; samples and coefficients out.

Coefficients are taken from the ``result.json`` of a session while that is up to date.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from allanscope import __version__
from allanscope.atomic_write import require_writable, write_text
from allanscope.clock import Clock
from allanscope.errors import InputError, UsageError
from allanscope.noise import Coefficient
from allanscope.pipeline.analyse_file import analyse_input, settings_of
from allanscope.pipeline.columns import text_of_columns, with_guesses, with_units
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.replaying import InputLength, events_of
from allanscope.pipeline.settings import DeviceSettings
from allanscope.pipeline.table_files import is_table_file, table_of_file
from allanscope.quantities import counted, duration
from allanscope.recording import (
    Chunk,
    Recording,
    export_csv,
    export_parquet,
    is_recording,
    write_recording,
)
from allanscope.samples import Block, Event, Gap, StreamInfo
from allanscope.sources import FileSource
from allanscope.view import progress

if TYPE_CHECKING:
    from allanscope.pipeline.exports import UpperLimits

__all__ = ["StoredResult", "export_recording", "import_capture", "stored_result"]


@dataclass(frozen=True, slots=True)
class StoredResult:
    """What an export needs of a result.

    Attributes
    ----------
    coefficients : mapping
        Axis name to coefficient name to coefficient.
    rate_hz : float
        Measured sample rate, else the nominal one.
    part : str
        Empty if it is not known.
    duration_s : float
        Length of the run.
    """

    coefficients: Mapping[str, Mapping[str, Coefficient]]
    rate_hz: float
    part: str
    duration_s: float


def stored_result(folder: Path) -> StoredResult | None:
    """Return what the result in a session folder says; None where a new analysis is needed.

    It is used only if this version of allanscope wrote it, after the last byte of every recording
    in the folder.
    """
    path = folder / "result.json"
    try:
        written = path.stat().st_mtime_ns
        if any(one.stat().st_mtime_ns > written for one in folder.glob("*.mcap")):
            return None
        result = json.loads(path.read_text("utf-8"))
        if result["allanscope"] != __version__:
            return None
        fields = ("value", "lower", "upper", "unit", "detected", "wait_s")
        rate = result["rate"]
        return StoredResult(
            {
                name: {
                    letter: Coefficient(*(one[field] for field in fields))
                    for letter, one in axis["coefficients"].items()
                }
                for name, axis in result["axes"].items()
            },
            float(rate["measured_hz"] or rate["nominal_hz"]),
            result["part"],
            float(result["duration_s"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


_ROWS = 1 << 12
"""Of a table that are written at a time."""

Configuration = tuple[tuple[str, ...], tuple[float, ...], float]
"""As `StreamInfo.configuration` has it."""


def import_capture(source: Path, out: Path, device: DeviceSettings, quiet: bool) -> Path:
    """Keep a text file or a raw capture as a recording, with what the user knows; return its file.

    The bytes are kept as they are: a better reader of tomorrow can read them again. Arrays and
    bags of ROS 2 become rows of text, which `replay`, `fleet` and `export` read.

    Raises
    ------
    InputError
        When it contains no samples that could be read, or is a recording already.
    """
    if is_table_file(source):
        return _import_table(source, out, device, quiet)
    if is_recording(source):
        Recording(source)  # a damaged one says so itself
        raise InputError(f"{source} is a recording already; analyse and export take it as it is")
    device = device.of_file(source)
    decoding = Decoding(device.for_wire(), device.wire)
    for _ in events_of(source, decoding, quiet, "reading"):
        pass
    if not decoding.stats.samples:
        raise InputError(f"{source} contains no samples; nothing to import")
    facts = {**device.metadata(), "name": source.name, "wire": decoding.wire}
    file = FileSource(source)
    length = InputLength.of(file)
    with progress(length.total, "writing", unit=length.unit, quiet=quiet) as advance:

        def chunks() -> Iterator[Chunk]:
            while (chunk := file.read()).event != "end":
                advance(len(chunk.data))
                yield Chunk(0, chunk.data)

        return write_recording(out, chunks(), facts)


def _import_table(source: Path, out: Path, device: DeviceSettings, quiet: bool) -> Path:
    """Keep a file of arrays as a recording of text."""
    found = table_of_file(source, device.stream)
    try:
        columns = with_guesses(with_units(found.columns, dict(device.units)))
    except UsageError:
        raise
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None
    device = replace(
        device, part=device.part or found.part, rate_hz=device.rate_hz or found.rate_hz, wire="text"
    )
    if not device.rate_hz and columns.time_s is None:
        raise UsageError(f"{source} has no times that tell its sample rate; give --rate HZ")
    header, rows = text_of_columns(columns)
    size = len(next(iter(columns.axes.values())))

    def chunks() -> Iterator[Chunk]:
        yield Chunk(0, header)
        with progress(size, "writing", unit="B", quiet=quiet) as advance:
            for start in range(0, size, _ROWS):
                yield Chunk(0, rows(slice(start, start + _ROWS)))
                advance(min(_ROWS, size - start))

    facts = {**device.metadata(), "name": source.name, "came_from": found.kind}
    return write_recording(out, chunks(), facts)


def export_recording(
    source: Path,
    out: Path,
    device: DeviceSettings,
    quiet: bool,
    layout: str | None = None,
    upper_limits: UpperLimits | None = None,
    bound: bool = False,
) -> None:
    """Write samples as CSV or Parquet, or coefficients for Kalibr, ROS, VINS or MATLAB.

    The times of samples are at the measured rate: whoever reads the table takes them for true.

    Parameters
    ----------
    layout : {'kalibr', 'openvins', 'orb-slam3', 'vins', 'ros', 'axes'}, optional
        Whose .yaml, Kalibr's by default; a .m is MATLAB's.
    upper_limits : {'refuse', 'include', 'zero'}, optional
        What is written for a coefficient that was not detected; refused by default.
    bound : bool
        A model above the measured curves instead of the coefficients, as .yaml.

    Raises
    ------
    UsageError
        When the ending of `out` is none of .csv, .parquet, .yaml and .m; of a bound, not .yaml;
        or when the file has nothing to which a choice applies.
    InputError
        When there are no samples, a sensor is missing whose coefficients are asked for, or one
        would be written of which only an upper limit is known.
    """
    if bound and out.suffix != ".yaml":
        raise UsageError(f"{out}: a bound is written as .yaml")
    writers = {".csv": export_csv, ".parquet": export_parquet}
    if out.suffix not in (*writers, ".yaml", ".m"):
        raise UsageError(f"{out}: name a file that ends in .csv, .parquet, .yaml or .m")
    if layout and (bound or out.suffix != ".yaml"):
        raise UsageError(f"{out}: --layout {layout} is a format of coefficients in a .yaml")
    if upper_limits and (bound or out.suffix in writers):
        what = "a bound" if bound else "samples"
        raise UsageError(f"{out}: --upper-limits is for coefficients, and this file has {what}")
    if out.suffix not in writers:
        layout = "bound" if bound else "matlab" if out.suffix == ".m" else layout or "kalibr"
        _export_coefficients(source, out, device, quiet, layout, upper_limits or "refuse")
        return
    device = settings_of(source, device)
    decoding = Decoding(device.for_wire(), device.wire)
    rates = measured_rates(events_of(source, decoding, quiet, "measuring the rate"))
    if not decoding.stats.samples:
        raise InputError(f"{source} contains no samples; nothing to export")
    again = Decoding(device.for_wire(), decoding.wire)
    events = at_rates(events_of(source, again, quiet, "exporting"), rates)
    written = writers[out.suffix](events, out)
    if not quiet and out.is_file():
        print(written)


def _export_coefficients(
    source: Path,
    out: Path,
    device: DeviceSettings,
    quiet: bool,
    layout: str,
    upper_limits: UpperLimits,
) -> None:
    from allanscope.pipeline.exports import (
        CONTENTS,
        NotDetected,
        bound_yaml,
        coefficients_file,
    )

    require_writable(out)
    curves = {}
    stored = stored_result(source) if layout != "bound" and device == DeviceSettings() else None
    origin = source / "result.json" if stored else source
    if stored is None:
        analysis = analyse_input(source, device, quiet)
        curves = {k: axis.curves["oadev"] for k, axis in analysis.axes.items() if axis.curves}
        stored = StoredResult(
            {name: axis.coefficients for name, axis in analysis.axes.items()},
            analysis.rate.best_hz,
            analysis.part,
            analysis.duration_s,
        )
    part = f", {stored.part}" if stored.part else ""
    facts = f"{source.name}{part}, {duration(stored.duration_s)}"
    try:
        if layout == "bound":
            text = bound_yaml(curves, source=facts)
        else:
            text = coefficients_file(
                layout,
                stored.coefficients,
                stored.rate_hz,
                source=facts,
                upper_limits=upper_limits,
            )
    except NotDetected as error:
        raise InputError(
            f"{source}: {error}; record longer, or write {out.name} with --upper-limits include "
            "(the limits) or --upper-limits zero"
        ) from None
    except ValueError as error:
        raise InputError(f"{source}: {error}; nothing to write for {layout}") from None
    write_text(out, text)
    if not quiet and out.is_file():
        axes = counted(len(stored.coefficients), "axis", "axes")
        print(f"Saved: {out}: {CONTENTS[layout]}; {axes}, from {origin}")


def measured_rates(events: Iterable[Event]) -> dict[Configuration, float]:
    """Return the rate in Hz of each configuration of a stream whose times tell it.

    Parameters
    ----------
    events : iterable of Event
        The whole stream.

    Examples
    --------
    Blocks of a device that claims 100 Hz and stamps its samples 96 times a second:

    >>> import numpy as np
    >>> from allanscope.samples import Ticks
    >>> info = StreamInfo(("gx",), (1.0,), nominal_hz=100.0, device_clock=True)
    >>> row, unknown = np.arange(1000), np.full(1000, np.nan)
    >>> block = Block(0, np.zeros((1000, 1), np.int16), Ticks(row, row / 96.0, unknown, unknown))
    >>> rates = measured_rates([info, block])
    >>> [round(told.nominal_hz, 3) for told in at_rates([info], rates)]
    [96.0]
    """
    clocks: dict[Configuration, Clock] = {}
    clock: Clock | None = None
    for event in events:
        if isinstance(event, StreamInfo):
            clock = clocks.setdefault(event.configuration, Clock.of(event))
        elif isinstance(event, Gap) and clock is not None:
            clock.gap(event)
        elif isinstance(event, Block) and clock is not None:
            clock.update(event.index, event.ticks)
    fits = {configuration: clock.rate() for configuration, clock in clocks.items()}
    return {configuration: fit.hz for configuration, fit in fits.items() if fit.is_measured}


def at_rates(events: Iterable[Event], rates: Mapping[Configuration, float]) -> Iterator[Event]:
    """Yield the same stream with the measured rate, where there is one, marked as not nominal."""
    for event in events:
        if isinstance(event, StreamInfo) and event.configuration in rates:
            yield replace(event, nominal_hz=rates[event.configuration], rate_claimed=False)
        else:
            yield event
