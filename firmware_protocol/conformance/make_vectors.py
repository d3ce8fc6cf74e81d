"""Write vectors.json: streams beyond the happy path, and what a host must tell of each.

    python make_vectors.py > vectors.json

The frames are built here from the words of PROTOCOL.md, and what is to be told is written beside
each, by hand. A data frame has samples (index, -index, 0, 1, 2, 3), so that each one shows which it
is.
"""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Iterable, Sequence
from typing import Any
from zlib import crc32

EPOCH = 0x1234
AXES = ("gx", "gy", "gz", "ax", "ay", "az")
SCALE = {"g": 0.00875, "a": 6.1e-05}
GYRO, ACCEL, OVERRUN, DROPPED = 1, 2, 4, 8
BOTH = GYRO | ACCEL


def sealed(
    kind: int,
    seq: int,
    body: bytes,
    *,
    epoch: int = EPOCH,
    version: int = 0x12,
    flags: int = 0,
    n: int | None = None,
) -> bytes:
    """Return a frame on the wire: header, body, CRC, COBS, zero."""
    n = len(body) if n is None else n
    frame = struct.pack("<BBHHBB", kind, version, seq & 0xFFFF, epoch, flags, n) + body
    frame += struct.pack("<I", crc32(frame))
    return b"".join(bytes((len(run) + 1,)) + run for run in frame.split(b"\0")) + b"\0"


def descriptor(
    seq: int,
    *,
    epoch: int = EPOCH,
    rate: float = 416.0,
    channels: int = 0x3F,
    clock: int = 1,
    scales: bool = True,
    more: bytes = b"",
) -> bytes:
    """Return a descriptor frame."""
    entries = [(0x0C, bytes((channels,))), (0x0A, struct.pack("<f", rate)), (0x0D, bytes((clock,)))]
    if scales:
        entries += [(0x06, struct.pack("<f", SCALE["g"])), (0x08, struct.pack("<f", SCALE["a"]))]
    body = b"\1" + b"".join(bytes((tag, len(value))) + value for tag, value in entries) + more
    return sealed(0x02, seq, body, epoch=epoch)


def data(
    seq: int,
    index: int,
    n: int = 2,
    *,
    flags: int = BOTH,
    epoch: int = EPOCH,
    us: int | None = None,
    ticks: int = 0xFFFFFFFF,
    **header: int,
) -> bytes:
    """Return a data frame; its time is its index in ms unless given."""
    us = (index % (1 << 32)) * 1000 if us is None else us
    body = struct.pack("<IQIh", index % (1 << 32), us, ticks, -32768)
    body += b"".join(struct.pack("<6h", *row(index + i)) for i in range(n))
    return sealed(0x01, seq, body, flags=flags, epoch=epoch, **{"n": n, **header})


COUNTERS = ("produced", "sent", "dropped", "overruns", "commands", "bad_commands")


def status(
    seq: int, us: int = 0, counters: Sequence[int] = (0,) * 6, more: bytes = b"", **header: int
) -> bytes:
    """Return a status."""
    return sealed(0x03, seq, struct.pack("<Q6I", us, *counters) + more, **header)


def event(seq: int, us: int, level: int, text: bytes, **header: int) -> bytes:
    """Return an event."""
    return sealed(0x04, seq, struct.pack("<QB", us, level) + text, **header)


def reply(
    seq: int, to: int, command: int, result: int = 0, more: bytes = b"", **header: int
) -> bytes:
    """Return the reply to a command of that seq and type."""
    return sealed(0x06, seq, struct.pack("<HBB", to, command, result) + more, **header)


def row(index: int) -> tuple[int, ...]:
    """Return the counts of a sample."""
    low = (index + 0x8000) % 0x10000 - 0x8000
    return (low, -low if low > -0x8000 else low, 0, 1, 2, 3)


def info(epoch: int = EPOCH, rate: float = 416.0, axes: Iterable[str] = AXES) -> dict[str, Any]:
    """Return what a host tells of a descriptor."""
    axes = list(axes)
    scale = [SCALE[axis[0]] for axis in axes]
    return {"epoch": epoch, "axes": axes, "scale": scale, "rate": rate}


def run(
    index: int,
    samples: int,
    per_frame: int = 2,
    columns: slice = slice(6),
    times: list[float | None] | None = None,
) -> dict[str, Any]:
    """Return what a host tells of contiguous samples."""
    counts = [list(row(index + i)[columns]) for i in range(samples)]
    starts = range(index, index + samples, per_frame)
    usual = [(one % (1 << 32)) * 1000 / 1e6 for one in starts]
    return {"index": index, "counts": counts, "times": usual if times is None else times}


def gap(lost: int | None, reason: str) -> dict[str, Any]:
    """Return what a host tells of a loss."""
    return {"lost": lost, "reason": reason}


def says(time: float = 0.0, counters: Sequence[int] = (0,) * 6) -> dict[str, Any]:
    """Return what a host tells of a status."""
    return {"status": {"time": time, **dict(zip(COUNTERS, counters, strict=True))}}


def remark(time: float, level: int, text: str) -> dict[str, Any]:
    """Return what a host tells of an event."""
    return {"event": {"time": time, "level": level, "text": text}}


def answer(seq: int, command: int, result: int = 0, time: float | None = None) -> dict[str, Any]:
    """Return what a host tells of a reply; its time is that of the reply to a ping."""
    return {"reply": {"seq": seq, "command": command, "result": result, "time": time}}


HEAD = b"\0" + descriptor(0)
START, STOP, DESCRIBE, SET, PING = range(0x81, 0x86)
LONG = b"\x55" * 300


def vectors() -> Iterable[tuple[str, bytes, list[dict[str, Any]], int, int]]:
    """Yield name, wire, what is told, chunks that were damaged or repeated, and unknown frames."""
    yield (
        "plain",
        HEAD + data(1, 0) + status(2) + data(3, 2),
        [info(), run(0, 2), says(), run(2, 2)],
        0,
        0,
    )
    yield (
        "joined in the middle of a frame, zeros between frames",
        data(9, 40)[11:] + b"\0\0\0" + HEAD + b"\0" + data(1, 0),
        [info(), run(0, 2)],
        1,
        0,
    )
    yield "first index above 0", HEAD + data(1, 500), [info(), run(500, 2)], 0, 0
    yield (
        "seq wraps",
        b"\0" + descriptor(65534) + data(65535, 0) + data(0, 2) + data(1, 4),
        [info(), run(0, 6)],
        0,
        0,
    )
    end = (1 << 32) - 2
    yield (
        "index wraps",
        HEAD + data(1, end) + data(2, end + 2) + data(3, end + 4),
        [info(), run(end, 6)],
        0,
        0,
    )
    yield (
        "65536 frames lost at once: seq goes on, so they are booked to the device",
        HEAD + data(1, 0) + data(2, 131074),
        [info(), run(0, 2), gap(131072, "device"), run(131074, 2)],
        0,
        0,
    )
    yield (
        "a jump of 2^31 - 1 samples is ahead",
        HEAD + data(1, 0) + data(2, (1 << 31) + 1),
        [info(), run(0, 2), gap((1 << 31) - 1, "device"), run((1 << 31) + 1, 2)],
        0,
        0,
    )
    yield (
        "a jump of 2^31 samples is back",
        HEAD + data(1, 0) + data(2, (1 << 31) + 2),
        [info(), run(0, 2), gap(None, "restarted"), run((1 << 31) + 2, 2)],
        0,
        0,
    )
    yield (
        "a frame comes twice",
        HEAD + data(1, 0) + data(1, 0) + data(2, 2),
        [info(), run(0, 4)],
        1,
        0,
    )
    yield (
        "frames whose CRC is right and whose length is not: they take their seq",
        HEAD
        + data(1, 0)
        + sealed(1, 2, bytes(18), n=0)
        + sealed(1, 3, bytes(18 + 12), n=2)
        + sealed(1, 4, bytes(18 + 12 * 18), n=19)
        + data(5, 8),
        [info(), run(0, 2), gap(6, "device"), run(8, 2)],
        0,
        3,
    )
    yield (
        "flags that disagree with the descriptor",
        HEAD + data(1, 0) + data(2, 2, flags=GYRO) + data(3, 4),
        [info(), run(0, 2), gap(2, "device"), run(4, 2)],
        0,
        0,
    )
    yield (
        "unknown types are skipped, and their seq counts",
        HEAD + data(1, 0) + sealed(0x20, 2, b"new") + sealed(0x05, 3, b"") + data(4, 2),
        [info(), run(0, 4)],
        0,
        2,
    )
    yield (
        "a command that comes back has a seq of its own direction",
        HEAD + data(1, 0) + sealed(0x85, 999, b"") + data(2, 2),
        [info(), run(0, 4)],
        0,
        1,
    )
    yield (
        "another major version is not read, nor is its seq",
        HEAD + data(1, 0) + data(2, 2, version=0x21) + data(3, 4),
        [info(), run(0, 2), gap(2, "link"), run(4, 2)],
        0,
        1,
    )
    yield (
        "a later minor version: fields appended to a status, tags unknown",
        b"\0"
        + descriptor(0, more=b"\x7f\x03abc")
        + status(1, more=b"more", version=0x19)
        + data(2, 0, version=0x19),
        [info(), says(), run(0, 2)],
        0,
        0,
    )
    yield (
        "a status too short",
        HEAD + sealed(3, 1, bytes(31)) + data(2, 0),
        [info(), run(0, 2)],
        0,
        1,
    )
    numbers = (1 << 32) - 1, 416, 16, 2, 3, 1
    yield (
        "a status with numbers, before any descriptor",
        b"\0" + status(0, 6_000_000, numbers) + descriptor(1),
        [says(6.0, numbers), info()],
        0,
        0,
    )
    yield (
        "a status that is lost costs no sample",
        HEAD + data(1, 0) + data(3, 2),
        [info(), run(0, 4)],
        0,
        0,
    )
    yield (
        "events of each level, one without text, one in UTF-8, and one too short",
        b"\0"
        + event(0, 1_000_000, 0, b"answers again")
        + event(1, 2_000_000, 1, b"")
        + event(2, 3_500_000, 2, "no answer at 41 °C".encode())
        + sealed(4, 3, bytes(8)),
        [
            remark(1.0, 0, "answers again"),
            remark(2.0, 1, ""),
            remark(3.5, 2, "no answer at 41 °C"),
        ],
        0,
        1,
    )
    yield (
        "an event comes twice: it is told twice, and its seq stands still",
        HEAD + data(1, 0) + event(2, 0, 0, b"x") + event(2, 0, 0, b"x") + data(3, 6),
        [info(), run(0, 2), remark(0.0, 0, "x"), remark(0.0, 0, "x"), gap(4, "link"), run(6, 2)],
        0,
        0,
    )
    yield (
        "replies with each result, to types and with results that are not known, and one too short",
        b"\0"
        + b"".join(reply(i, 40 + i, one, i) for i, one in enumerate((START, STOP, 0x9F, SET, 0x84)))
        + reply(5, 65535, DESCRIBE, 200)
        + sealed(6, 6, bytes(3)),
        [
            *(answer(40 + i, one, i) for i, one in enumerate((START, STOP, 0x9F, SET, 0x84))),
            answer(65535, DESCRIBE, 200),
        ],
        0,
        1,
    )
    clock = struct.pack("<Q", 6_200_000)
    yield (
        "replies to pings: with the time behind what was sent, without, and of version 1.1",
        b"\0"
        + reply(0, 1, PING, more=b"\0\1\0" + clock)
        + reply(1, 2, PING, more=clock)
        + reply(2, 3, PING, more=b"1234567")
        + reply(3, 4, PING, more=b"\0\1\0" + clock, version=0x11)
        + reply(4, 5, SET, more=clock),
        [
            answer(1, PING, time=6.2),
            answer(2, PING, time=6.2),
            answer(3, PING),
            answer(4, PING),
            answer(5, SET),
        ],
        0,
        0,
    )
    yield (
        "status, event and reply whose n is not their length",
        b"\0" + status(0, n=31) + event(1, 0, 0, b"x", n=9) + reply(2, 1, START, n=5),
        [],
        0,
        3,
    )
    yield (
        "the descriptor comes late",
        b"\0" + data(0, 0) + data(1, 2) + data(3, 6) + descriptor(4),
        [info(), run(0, 4), gap(2, "link"), run(6, 2)],
        0,
        0,
    )
    yield (
        "1027 frames wait, and there is room for 1024: the oldest make room",
        b"\0" + b"".join(data(i, i, 1) for i in range(1027)) + descriptor(1027),
        [info(), run(3, 1024, 1)],
        0,
        0,
    )
    yield (
        "frames of an epoch that was never described are dropped with the next descriptor",
        b"\0" + data(0, 0, epoch=0x1111) + data(1, 2, epoch=0x1111) + descriptor(2) + data(3, 0),
        [info(), run(0, 2)],
        0,
        0,
    )
    yield (
        "another descriptor within an epoch: what follows is another stream",
        HEAD + data(1, 0) + descriptor(2, rate=208.0) + data(3, 2),
        [info(), run(0, 2), info(rate=208.0), gap(None, "restarted"), run(2, 2)],
        0,
        0,
    )
    yield (
        "the same descriptor again",
        HEAD + data(1, 0) + descriptor(2) + data(3, 2),
        [info(), run(0, 4)],
        0,
        0,
    )
    yield (
        "a new epoch",
        HEAD + data(1, 8) + descriptor(2, epoch=0x1235) + data(3, 0, epoch=0x1235),
        [info(), run(8, 2), info(0x1235), gap(None, "restarted"), run(0, 2)],
        0,
        0,
    )
    yield (
        "an old epoch after a new one is not scaled by it",
        HEAD + descriptor(1, epoch=0x1235) + data(2, 0) + data(3, 0, epoch=0x1235),
        [info(), info(0x1235), run(0, 2)],
        0,
        0,
    )
    yield (
        "a descriptor that says no sensitivity is none",
        b"\0" + descriptor(0, scales=False) + data(1, 0) + descriptor(2),
        [info(), run(0, 2)],
        0,
        1,
    )
    yield (
        "a descriptor with a torn entry is none",
        b"\0" + descriptor(0, more=b"\x7f\x09abc") + data(1, 0) + descriptor(2),
        [info(), run(0, 2)],
        0,
        1,
    )
    yield (
        "gyroscope alone",
        b"\0" + descriptor(0, channels=0x07) + data(1, 0, flags=GYRO),
        [info(axes=AXES[:3]), run(0, 2, columns=slice(3))],
        0,
        0,
    )
    flipped = bytearray(data(2, 2))
    flipped[30] ^= 4
    yield (
        "one bit wrong",
        HEAD + data(1, 0) + bytes(flipped) + data(3, 4),
        [info(), run(0, 2), gap(2, "link"), run(4, 2)],
        1,
        0,
    )
    yield (
        "a missing zero joins two frames, and both are lost",
        HEAD + data(1, 0) + data(2, 2)[:-1] + data(3, 4) + data(4, 6),
        [info(), run(0, 2), gap(4, "link"), run(6, 2)],
        1,
        0,
    )
    yield (
        "a chunk that is too long",
        HEAD + data(1, 0) + LONG + data(2, 2) + data(3, 4),
        [info(), run(0, 2), gap(2, "link"), run(4, 2)],
        1,
        0,
    )
    yield (
        "the sensor's FIFO overran; then the device dropped",
        HEAD + data(1, 0) + data(2, 5, flags=BOTH | OVERRUN) + data(3, 17, flags=BOTH | DROPPED),
        [info(), run(0, 2), gap(3, "sensor"), run(5, 2), gap(10, "device"), run(17, 2)],
        0,
        0,
    )
    yield (
        "lost on the link and by the device between the same two frames: the sum, to the link",
        HEAD + data(1, 0) + data(4, 30, flags=BOTH | DROPPED),
        [info(), run(0, 2), gap(28, "link"), run(30, 2)],
        0,
        0,
    )
    top = (1 << 32) - 100
    yield (
        "without a clock sensor_time is the time, and it wraps; one frame has none",
        b"\0" + descriptor(0, clock=0) + data(1, 0, ticks=top) + data(2, 2) + data(3, 4, ticks=100),
        [info(), run(0, 6, times=[top * 25e-6, None, (top + 200) * 25e-6])],
        0,
        0,
    )
    yield "half a frame at the end", HEAD + data(1, 0) + data(2, 2)[:20], [info(), run(0, 2)], 0, 0


def main() -> None:
    """Print the vectors."""
    out = [
        {"name": name, "wire": wire.hex(), "events": events, "damaged": damaged, "unknown": unknown}
        for name, wire, events, damaged, unknown in vectors()
    ]
    json.dump(out, sys.stdout, separators=(",", ":"))
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
