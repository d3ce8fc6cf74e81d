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
    folder: Path, decoding: Decoding, write: Callable[[bytes], None]
) -> Iterator[Event]:
    """Return the events of the files that a session has now; then `decoding` goes on live.

    Raises
    ------
    InputError
        When the folder holds no session; while iterating, when its wire format is unknown.
    """
    recording = Recording(folder)  # now: files that the session gets later are not of the past

    def events() -> Iterator[Event]:
        for buffer in recording.buffers():
            yield from decoding.take_buffer(buffer)
        decoding.resume(write)

    return events()


def set_view_aside(folder: Path) -> None:
    """Keep what was shown before under a name of its own: ``session.rrd`` is the newest part."""
    shown = folder / "session.rrd"
    if shown.exists():
        number = 1
        while (aside := folder / f"session-before-{number:03d}.rrd").exists():
            number += 1
        shown.rename(aside)
