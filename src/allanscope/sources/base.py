"""What every source provides: chunks of bytes with the time at which they arrived."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

__all__ = ["Chunk", "LinkEvent", "Source"]

LinkEvent = Literal["", "disconnected", "reconnected", "stalled", "resumed", "end"]


@dataclass(frozen=True, slots=True)
class Chunk:
    """What one read brought.

    Attributes
    ----------
    host_ns : int
        Host monotonic time of the read, in nanoseconds; a recording gives back what it stored.
    data : bytes
        The bytes; empty when the read timed out or when only `event` matters.
    event : str
        What happened to the link before these bytes, or empty. ``end`` means that nothing will
        ever follow.
    """

    host_ns: int
    data: bytes = b""
    event: LinkEvent = ""


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
