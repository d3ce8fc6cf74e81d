"""What every source provides: chunks of bytes with the time at which they arrived."""

from __future__ import annotations

from typing import Protocol

from allanscope.recording.chunk import Chunk, LinkEvent

__all__ = ["Chunk", "LinkEvent", "Source"]


class Source(Protocol):
    """A place that bytes come from. One thread reads it; any thread may write or close it."""

    @property
    def name(self) -> str:
        """The port, the file, or ``sim``: shown to people."""

    @property
    def identity(self) -> dict[str, str]:
        """What is known of the device: vendor, product, serial number, path."""

    def read(self) -> Chunk:
        """Return the next chunk, with empty data after at most about 50 ms of silence."""

    def write(self, data: bytes) -> None:
        """Send bytes to the device; does nothing where there is none."""

    def close(self) -> None:
        """Stop; a read in another thread returns soon with the event ``end``."""
