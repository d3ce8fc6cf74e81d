"""Many reads at once: how a recording is replayed without a call for each of them.

A night at 6.66 kHz is nine million reads. A decoder that can take them together (the native one
does) is given megabytes at a time and still says when each byte arrived.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Event
from allanscope.wire.base import Decoder

__all__ = ["feed_chunks"]


@runtime_checkable
class _TakesChunks(Protocol):
    def feed_chunks(
        self, data: bytes, ends: NDArray[np.int64], host_s: NDArray[np.float64]
    ) -> list[Event]: ...


def feed_chunks(
    decoder: Decoder, data: bytes, ends: NDArray[np.int64], host_s: NDArray[np.float64]
) -> list[Event]:
    """Feed a decoder several chunks that arrived one after another.

    The events are those of ``decoder.feed`` called for each chunk, but that contiguous Blocks may
    come as one.

    Parameters
    ----------
    decoder : Decoder
    data : bytes
        The chunks, one after another.
    ends : ndarray of int64, shape (c,)
        Where each chunk ends in `data`, ascending; the last one is its length.
    host_s : ndarray of float64, shape (c,)
        When each chunk arrived.
    """
    if isinstance(decoder, _TakesChunks):
        return decoder.feed_chunks(data, ends, host_s)
    events: list[Event] = []
    start = 0
    for end, time in zip(ends.tolist(), host_s.tolist(), strict=True):
        events += decoder.feed(data[start:end], time)
        start = end
    return events
