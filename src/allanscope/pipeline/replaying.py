"""To the end, without a viewer: a file's chunks through decoder and analyser in large pieces."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from allanscope.analysis.analyser import Analyser
from allanscope.pipeline.decoding import Decoding
from allanscope.samples import Event
from allanscope.sources import open_source
from allanscope.view.progress import progress

__all__ = ["analysed", "events_of"]


def events_of(path: Path, decoding: Decoding, quiet: bool, doing: str) -> Iterator[Event]:
    """Yield the events of a recording or a capture, in order.

    Raises
    ------
    InputError
        When the file cannot be read or no wire format fits it.
    """
    source = open_source(str(path))
    try:
        with progress(None, doing, unit="B", quiet=quiet) as advance:
            while (chunk := source.read()).event != "end":
                yield from decoding.take(chunk)
                advance(len(chunk.data))
        yield from decoding.finish()
    finally:
        source.close()


def analysed(
    path: Path, decoding: Decoding, analyser: Analyser, quiet: bool, doing: str = "analysing"
) -> Analyser:
    """Take a whole file into an analyser and return it."""
    for event in events_of(path, decoding, quiet, doing):
        analyser.take(event)
    return analyser
