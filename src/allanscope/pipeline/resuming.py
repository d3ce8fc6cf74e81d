"""Going on with a session that was cut off: what it held is taken again, then the device.

The recording is the checkpoint. Replayed through a decoder and an analyser it leaves both exactly
as they were, and both then go on with the device itself; `docs/decisions/0005` says why. The device
is read and recorded meanwhile, so the time that a replay takes costs no sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from allanscope.pipeline.decoding import Decoding
from allanscope.recording import Recording
from allanscope.samples import Event

__all__ = ["earlier_events", "set_view_aside"]


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
        yield from decoding.take_buffer(buffer)
    decoding.resume(write)


def set_view_aside(folder: Path) -> None:
    """Keep what was shown before under a name of its own: ``session.rrd`` is the newest part."""
    shown = folder / "session.rrd"
    if shown.exists():
        number = 1
        while (aside := folder / f"session-before-{number:03d}.rrd").exists():
            number += 1
        shown.rename(aside)
