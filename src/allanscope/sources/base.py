"""What every source provides, chunks of bytes with the time at which they came, and settings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from allanscope.errors import UsageError
from allanscope.recording import Chunk, LinkEvent

__all__ = ["Chunk", "LinkEvent", "Source", "SourceSettings"]


class Source(Protocol):
    """A place that bytes come from. One thread reads it; any thread may write or close it."""

    @property
    def name(self) -> str:
        """The port, the file, or ``sim``: shown to people."""

    @property
    def identity(self) -> dict[str, str]:
        """What is known of the device: vendor, product, serial number, path."""

    @property
    def reader(self) -> str:
        """Who reads a port, and at which priority; empty where nothing can come too fast."""

    def read(self) -> Chunk:
        """Return the next chunk, with empty data after about a tenth of a second of silence."""

    def write(self, data: bytes) -> None:
        """Send bytes to the device; does nothing where there is none."""

    def close(self) -> None:
        """Stop; a read in another thread returns soon with the event ``end``."""


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """Settings of all kinds of sources; each takes what concerns it.

    Attributes
    ----------
    baud : int
        Line rate of a UART. A USB CDC device ignores it.
    stall_s : float
        A device that has streamed and then says nothing for this long has stalled.
    give_up_s : float
        A device that has gone is waited for this long; for ever, if not given.
    own_process : bool
        Whether a port is read by a process of its own, where the system allows it (Linux).
    speed : float
        Multiple of real time at which a recording is replayed; infinity for as fast as possible.

    Raises
    ------
    UsageError
        If a value is not possible.
    """

    baud: int = 115200
    stall_s: float = 3.0
    give_up_s: float = math.inf
    speed: float = math.inf
    own_process: bool = True

    def __post_init__(self) -> None:
        for name in ("baud", "stall_s", "give_up_s", "speed"):
            if not getattr(self, name) > 0:
                raise UsageError(f"{name} must be positive, not {getattr(self, name)}")
