"""Streams that are nearly right: real bytes of every format, for damaging."""

from __future__ import annotations

import functools

import numpy as np

from allanscope.simulator import Simulator, start_messages
from allanscope.wire import format_named, formats

FORMATS = tuple(formats())


@functools.cache
def real_stream(name: str) -> bytes:
    """Return a second of what a device of this format sends."""
    encoder = format_named(name).encoder()
    sensor = Simulator(rate=104.0, seed=2)
    data = start_messages(format_named(name), encoder, sensor.info)
    data += b"".join(encoder.encode(sensor.read(8)) for _ in range(13))
    return data + encoder.status(104, 104, 0, 1.0)


def damaged(data: bytes, seed: int, hits: int) -> bytes:
    """Return a stream with bytes flipped, lost, doubled and moved."""
    source = np.random.default_rng(seed)
    out = bytearray(data)
    for _ in range(hits):
        at, other = (int(x) for x in source.integers(0, len(out), 2))
        match int(source.integers(5)):
            case 0:
                out[at] ^= 1 << int(source.integers(8))
            case 1:
                del out[at : at + int(source.integers(1, 20))]
            case 2:
                out[at:at] = out[other : other + 40]
            case 3:
                out[at:at] = source.bytes(int(source.integers(1, 40)))
            case _:
                out[at] = int(source.integers(256))
        out = out or bytearray(b"\0")
    return bytes(out)
