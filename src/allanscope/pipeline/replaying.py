"""To the end, without a viewer: a file through decoder and analyser in megabytes, on two cores.

::

    thread "ahead"   unpack ──▶ decode ──▶ events of 4 MB of bytes
    caller           spectrum, history, clock            ◀──┘
    thread "sums"    deviations                          ◀──┘

The second thread decodes the next piece while the last one is summed up. Everything that takes
long is compiled code that lets go of the interpreter. The result is that of taking the same reads
one by one, to the last bit: see `allanscope.analysis.rows`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from allanscope.analysis import Analyser
from allanscope.errors import InputError
from allanscope.pipeline.ahead import ahead
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.extent import Extent
from allanscope.recording import Buffer
from allanscope.samples import Event, Notice
from allanscope.sources import RecordedSource, Source, open_file
from allanscope.view import progress

__all__ = ["analysed", "buffers_of", "events_of"]


def buffers_of(source: Source) -> Iterator[Buffer]:
    """Yield all that a recording, a capture or a text holds, in pieces of megabytes.

    Raises
    ------
    InputError
        When the file cannot be read.
    """
    if isinstance(source, RecordedSource):
        yield from source.recording.buffers()
        return
    first = np.zeros(1, np.int64)
    while (chunk := source.read()).event != "end":
        yield Buffer(chunk.data, first, np.array([chunk.host_ns]), chunk.event, chunk.host_ns)


def events_of(
    path: Path,
    decoding: Decoding,
    quiet: bool,
    doing: str,
    seen: Callable[[Buffer], None] | None = None,
) -> Iterator[Event]:
    """Yield the events of a recording or a capture, in order, to its end.

    `seen` is shown every piece of the file, in another thread.

    Raises
    ------
    InputError
        When the file cannot be read or no wire format fits it.
    """
    source = open_file(path)
    extent = Extent.of(source, path)

    def decoded(buffers: Iterable[Buffer]) -> Iterator[tuple[float, list[Event]]]:
        for buffer in buffers:
            if seen is not None:
                seen(buffer)
            yield extent.of_buffer(buffer), decoding.take_buffer(buffer)
        yield 0.0, [*decoding.finish(), *_damage_of(source)]

    try:
        with progress(extent.total, doing, unit=extent.unit, quiet=quiet) as advance:
            for size, events in ahead(decoded(buffers_of(source))):
                yield from events
                advance(size)
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"{path}: {error}") from None
    finally:
        source.close()


def _damage_of(source: Source) -> list[Event]:
    """Return what of a recording could not be read, once it has been read: the largest part."""
    if not isinstance(source, RecordedSource):
        return []
    found = [damage for damage in source.recording.damage if damage.length]
    if not found:
        return []
    worst = max(found, key=lambda damage: damage.length)
    text = f"part of the recording cannot be read: {worst}"
    if len(found) > 1:
        text += f", and {len(found) - 1} more places; allanscope recover names them"
    return [Notice("error", text, {"host": 1})]


def analysed(
    path: Path,
    decoding: Decoding,
    analyser: Analyser,
    quiet: bool,
    doing: str = "analysing",
    seen: Callable[[Buffer], None] | None = None,
) -> Analyser:
    """Take a whole file into an analyser and return it."""
    for event in events_of(path, decoding, quiet, doing, seen):
        analyser.take(event)
    return analyser
