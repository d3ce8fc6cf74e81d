"""What runs on a worker: one recording from its bytes to its result, in one process and one thread.

The recording is read in pieces of a few megabytes; the sums, and not the samples, stay in memory.
Nothing that is wrong with a file is an exception here: it is an `Outcome` with one line, so that
Dask never takes a bad file for a fault of the worker and tries it again elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from allanscope.analysis import Analyser, Analysis, summarise
from allanscope.errors import AllanscopeError, InputError
from allanscope.fleet.inputs import RecordingInput
from allanscope.fleet.outcome import Outcome, compressed_result
from allanscope.pipeline import (
    Decoding,
    DeviceSettings,
    full_settings,
    import_capture,
    is_table_file,
    joined,
    recorded_settings,
    require_rate,
)
from allanscope.recording import Fingerprint, Recording, is_recording
from allanscope.samples import Event

__all__ = [
    "PIECE_BYTES",
    "analyse_recording",
    "failure",
    "fingerprint_recording",
    "new_analyser",
    "outcome_of",
    "recorded_events",
]

PIECE_BYTES = 1 << 18
"""Read at a time: so much is summed up in one thread, and other workers have the other cores."""
JOINED_ROWS = 1 << 13
"""Rows up to which contiguous Blocks are joined: as many as an analyser sums up at a time."""


def analyse_recording(item: RecordingInput, device: DeviceSettings) -> Outcome:
    """Return what one recording comes to; the task of the fleet."""
    try:
        with _opened(item, device) as recording:
            settings = recorded_settings(recording, device)
            decoding = Decoding(settings.for_wire(), settings.wire)
            analyser = new_analyser(settings)
            fingerprint = Fingerprint()
            for event in recorded_events(recording, decoding, fingerprint=fingerprint):
                analyser.feed(event)
            return outcome_of(item, recording, fingerprint.hexdigest(), analyser, decoding)
    except Exception as error:
        return failure(item, error)


def recorded_events(
    recording: Recording,
    decoding: Decoding,
    after: int = 0,
    *,
    last: bool = True,
    fingerprint: Fingerprint | None = None,
) -> Iterator[Event]:
    """Return the events of a recording or a part of one, contiguous Blocks joined.

    Parameters
    ----------
    after : int
        Number that the first read should have: of a part, that behind the last of the part before.
    last : bool
        Whether it is the last part, behind which comes what the end completes.
    fingerprint : Fingerprint, optional
        Takes every piece that is read.
    """

    def events() -> Iterator[Event]:
        for buffer in recording.buffers(PIECE_BYTES, after):
            if fingerprint is not None:
                fingerprint.add(buffer)
            yield from decoding.feed_buffer(buffer)
        if last:
            yield from decoding.finish()

    return joined(events(), JOINED_ROWS)


@contextmanager
def _opened(item: RecordingInput, device: DeviceSettings) -> Iterator[Recording]:
    """Give a recording; one is made of what only `import` reads."""
    path = item.open_path()
    if not isinstance(path, Path) or not _is_imported(path):
        yield Recording(path)
        return
    with TemporaryDirectory(prefix="allanscope-") as folder:
        imported = Path(folder) / f"{item.name}.mcap"
        import_capture(path, imported, device, quiet=True)
        yield Recording(imported)


def _is_imported(path: Path) -> bool:
    """Return whether a file of this machine is no recording, damaged or not, but has samples."""
    if is_table_file(path):
        return True
    return path.is_file() and path.suffix != ".mcap" and not is_recording(path)


def fingerprint_recording(item: RecordingInput, device: DeviceSettings) -> Outcome:
    """Return the fingerprint alone, to see whether a recording is known under another name."""
    try:
        with _opened(item, device) as recording:
            files = tuple(file.name for file in recording.files)
            return Outcome(item.url, recording.sha256(), files)
    except Exception as error:
        return failure(item, error)


def new_analyser(settings: DeviceSettings) -> Analyser:
    """Return the analyser of a single run, on one core: the other workers have the others."""
    return Analyser(full_settings(settings.part, one_thread=True))


def outcome_of(
    item: RecordingInput, recording: Recording, sha256: str, analyser: Analyser, decoding: Decoding
) -> Outcome:
    """Sum up a recording that has been read to its end.

    Raises
    ------
    InputError
        If it held no samples, or too few for a curve.
    UsageError
        If nothing tells its sample rate.
    """
    if analyser.state is None or not analyser.state.samples:
        raise InputError(f"{item.url} contains no samples; nothing to analyse")
    require_rate(item.url, analyser)
    facts = {"name": item.name, "path": item.url, "wire": decoding.wire, "sha256": sha256}
    analysis = summarise(analyser, decoding.stats, "full", facts, decoding.reconnects)
    circumstances = _circumstances(recording, analyser, analysis)
    return Outcome(
        item.url,
        sha256,
        tuple(file.name for file in recording.files),
        compressed_result({"circumstances": circumstances, "analysis": analysis.to_dict()}),
    )


def _circumstances(recording: Recording, analyser: Analyser, analysis: Analysis) -> dict[str, Any]:
    """Return what the lot needs to know and a single result does not say: which unit, and when."""
    metadata = recording.metadata
    details = analyser.configurations[-1].info.details
    return {
        "unit": metadata.get("unit", ""),
        "unique_id": details.get("unique_id", ""),
        "serial_number": metadata.get("serial_number", ""),
        "started": metadata.get("started", ""),
        "firmware": details.get("firmware", ""),
        "damaged_places": len(recording.damage),
        "samples": analysis.samples,
    }


def failure(item: RecordingInput, error: Exception) -> Outcome:
    """Return the outcome of a recording that cannot be analysed."""
    known = isinstance(error, AllanscopeError)
    text = str(error) if known else f"{item.url}: {type(error).__name__}: {error}"
    return Outcome(item.url, error=" ".join(text.split()))
