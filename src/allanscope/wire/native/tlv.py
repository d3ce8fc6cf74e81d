"""Tag, length, value: how a descriptor and a `set` command are written."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping

import numpy as np

__all__ = ["float32", "pack", "read_float32", "unpack"]


def pack(entries: Iterable[tuple[int, bytes]]) -> bytes:
    """Return the entries one after another, each as tag, length and value."""
    return b"".join(bytes((tag, len(value))) + value for tag, value in entries)


def unpack(data: bytes) -> Mapping[int, bytes] | None:
    """Return the entries by tag, the last one where a tag repeats; None when one is cut short."""
    entries: dict[int, bytes] = {}
    here = 0
    while here < len(data):
        if here + 2 > len(data) or here + 2 + data[here + 1] > len(data):
            return None
        start = here + 2
        here = start + data[here + 1]
        entries[data[start - 2]] = data[start:here]
    return entries


def float32(value: float) -> bytes:
    """Return a number as a little-endian IEEE 754 binary32."""
    return struct.pack("<f", value)


def read_float32(data: bytes | None) -> float | None:
    """Return the shortest decimal that this binary32 stands for; None when absent or not finite.

    A sensitivity of 8.75 mdps must not become 8.750000037 mdps because it travelled in 32 bits.

    >>> read_float32(float32(0.00875))
    0.00875
    """
    if data is None or len(data) != 4:
        return None
    value = float(str(np.frombuffer(data, "<f4")[0]))
    return value if math.isfinite(value) else None
