"""How a source is to be opened."""

from __future__ import annotations

import math
from dataclasses import dataclass

from allanscope.errors import UsageError

__all__ = ["SourceSettings"]


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
    speed : float
        Multiple of real time at which a recording is replayed; infinity for as fast as possible.

    Raises
    ------
    UsageError
        If a value makes no sense.
    """

    baud: int = 115200
    stall_s: float = 3.0
    give_up_s: float = math.inf
    speed: float = math.inf

    def __post_init__(self) -> None:
        for name in ("baud", "stall_s", "give_up_s", "speed"):
            if not getattr(self, name) > 0:
                raise UsageError(f"{name} must be positive, not {getattr(self, name)}")
