"""What one read of a source brought: the unit in which bytes travel, are kept and are replayed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Chunk", "LinkEvent"]

LinkEvent = Literal[
    "", "disconnected", "reconnected", "stalled", "resumed", "overrun", "hole", "mark", "end"
]
"""What can happen to a link, or beside it.

disconnected, reconnected
    The port disconnected; the same device came back.
stalled, resumed
    A streaming device sent nothing although the port is open; it sends again.
overrun
    Bytes may be missing here: the buffer of the port was full when it was opened, or the process
    that read it was killed.
hole
    Bytes are missing here: they were never written (disk full), or the file is damaged.
mark
    The user set a mark; only a recording brings one.
end
    Nothing will ever follow.
"""


@dataclass(frozen=True, slots=True)
class Chunk:
    """What one read brought.

    Attributes
    ----------
    host_ns : int
        Host monotonic time of the read, in nanoseconds; a recording gives back what it stored.
        0 when there never was one: a plain file.
    data : bytes
        The bytes; empty when the read timed out or when only `event` matters.
    event : str
        What happened to the link before these bytes, or empty; see `LinkEvent`.
    text : str
        Of a mark.
    """

    host_ns: int
    data: bytes = b""
    event: LinkEvent = ""
    text: str = ""
