"""A recording as a source: the chunks of that night again, at any speed."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from pathlib import Path

from allanscope.recording.chunk import Chunk
from allanscope.recording.reader import Recording

__all__ = ["RecordedSource"]

WAIT_S = 0.05


class RecordedSource:
    """Replays a recording; times are those that were recorded, whatever the speed.

    Parameters
    ----------
    path : Path
        A recording or the folder of a session.
    speed : float
        Multiple of real time; infinity for as fast as possible.
    clock : callable
        Seconds that pass while replaying.

    Raises
    ------
    InputError
        If it is no recording.
    """

    def __init__(
        self,
        path: Path,
        speed: float = math.inf,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.recording = Recording(path)
        self._speed = speed
        self._clock = clock
        self._chunks = self.recording.chunks()
        self._next: Chunk | None = next(self._chunks, None)
        self._anchor: tuple[float, int] | None = None
        self._last_ns = self._next.host_ns if self._next else 0
        self._closing = threading.Event()

    @property
    def name(self) -> str:
        """The file or folder."""
        return str(self.recording.path)

    @property
    def identity(self) -> dict[str, str]:
        """What the recording says about the device and itself."""
        return self.recording.metadata

    def read(self) -> Chunk:
        """Return the next chunk when its time has come, else an empty one after 50 ms."""
        chunk = self._next
        if chunk is None or self._closing.is_set():
            return Chunk(self._last_ns, event="end")
        wait_s = self._wait_s(chunk)
        if wait_s > 0.0:
            self._closing.wait(min(wait_s, WAIT_S))
            wait_s = self._wait_s(chunk)
            if wait_s > 0.0:
                return Chunk(max(chunk.host_ns - int(wait_s * self._speed * 1e9), self._last_ns))
        self._next = next(self._chunks, None)
        self._last_ns = chunk.host_ns
        return chunk

    def write(self, data: bytes) -> None:
        """Do nothing: a recording does not listen."""

    def close(self) -> None:
        """Stop."""
        self._closing.set()

    def _wait_s(self, chunk: Chunk) -> float:
        if math.isinf(self._speed):
            return 0.0
        # Behind a hole the clock may be another: a resumed session, perhaps after a reboot.
        if self._anchor is None or chunk.event == "hole" or chunk.host_ns < self._anchor[1]:
            self._anchor = self._clock(), chunk.host_ns
        began_s, began_ns = self._anchor
        return began_s + (chunk.host_ns - began_ns) * 1e-9 / self._speed - self._clock()
