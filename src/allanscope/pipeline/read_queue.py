"""Reads on their way from the reader to the session, taken together.

A port at its fastest is read fifty times a second. Decoding, summing up and showing a read each
cost some calls whatever it holds, so the session waits until the first read is a moment old and
takes all that have come by then as one. A replay at full speed puts thousands there in that moment.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Iterable, Iterator

import numpy as np

from allanscope.recording import Buffer
from allanscope.sources import Chunk

__all__ = ["TOGETHER_S", "UNWATCHED_READ_S", "ReadQueue", "joined"]

REPLAY_ROOM, LIVE_ROOM = 8 << 20, 256 << 20
"""Bytes that may wait to be decoded. A replay can wait; a port is read for three quarters of an
hour at its fastest while the past of a resumed session is taken up."""

_OVERHEAD = 200
"""Bytes that a read takes beside what it brings."""

TOGETHER_S = 0.08
"""How old a read may grow here: a third of what it may take from the port to the chart."""

UNWATCHED_READ_S = 1.0
"""The same where there is no chart and no screen. What happens to the link is never held back."""


class ReadQueue:
    """A queue of reads with room for so many bytes; the reader waits when it is full.

    What has an event, such as a port that is back, is passed on at once.

    Parameters
    ----------
    room : int
        Bytes that may wait.
    together_s : float
        How long to wait for more reads after the first one; may be changed between two takes.
    live : bool
        Whether reads carry the present time: then the time that the first one took to get here is
        a part of this.
    """

    def __init__(
        self, room: int = REPLAY_ROOM, together_s: float = TOGETHER_S, live: bool = False
    ) -> None:
        self._queue: queue.SimpleQueue[Chunk] = queue.SimpleQueue()
        self._taken = threading.Condition()
        self._left: float = room
        self.together_s = together_s
        self._live = live
        self._at_once = threading.Event()

    def put(self, chunk: Chunk) -> None:
        """Add a read; waits for room."""
        with self._taken:
            self._taken.wait_for(lambda: self._left > 0)
            self._left -= len(chunk.data) + _OVERHEAD
        self._queue.put(chunk)
        if chunk.event:  # a board that is back may wait for a word
            self._at_once.set()

    def end(self) -> None:
        """Say that nothing follows; never waits."""
        self._queue.put(Chunk(0, event="end"))
        self._at_once.set()

    def release_reader(self) -> None:
        """Release a reader that waits for room: the queue is not read any more."""
        self._free(math.inf)

    def get_all(self) -> list[Chunk]:
        """Wait for a read, and return all that have come a moment later, in order."""
        taken = [self._queue.get()]
        if not taken[0].event:
            self._wait_for_more(taken[0].host_ns)
        self._at_once.clear()  # before the rest is taken: what comes now sets it again
        while taken[-1].event != "end":
            try:
                taken.append(self._queue.get_nowait())
            except queue.Empty:
                break
        self._free(sum(len(chunk.data) + _OVERHEAD for chunk in taken))
        return taken

    def _wait_for_more(self, read_ns: int) -> None:
        age_s = 1e-9 * (time.monotonic_ns() - read_ns) if self._live else 0.0
        wait_s = min(self.together_s - age_s, self.together_s)
        if wait_s > 0.0:
            self._at_once.wait(wait_s)

    def _free(self, size: float) -> None:
        with self._taken:
            self._left += size
            self._taken.notify_all()


def joined(chunks: Iterable[Chunk]) -> Iterator[Chunk | Buffer]:
    """Yield reads that only bring bytes as one Buffer, and everything else as it is.

    Examples
    --------
    >>> reads = [Chunk(1, b"a"), Chunk(2, b"bc"), Chunk(3, event="stalled"), Chunk(4, b"d")]
    >>> [one.data for one in joined(reads)]
    [b'abc', b'', b'd']
    """
    plain: list[Chunk] = []
    for chunk in chunks:
        if chunk.data and not chunk.event:
            plain.append(chunk)
            continue
        if plain:
            yield _buffer(plain)
            plain = []
        yield chunk
    if plain:
        yield _buffer(plain)


def _buffer(chunks: list[Chunk]) -> Buffer:
    lengths = np.array([len(chunk.data) for chunk in chunks], np.int64)
    return Buffer(
        b"".join([chunk.data for chunk in chunks]),
        np.cumsum(lengths) - lengths,
        np.array([chunk.host_ns for chunk in chunks], np.int64),
    )
