"""What the tests of all formats share."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from itertools import pairwise
from zlib import crc32

import numpy as np
import pytest

from allanscope.samples import AXES, Block, Event, Gap, Notice, StreamInfo, Ticks
from allanscope.wire import Decoder

Joined = Callable[[Iterable[Event]], list[Event]]


def _append(one: Block, other: Block) -> Block:
    return Block(
        one.index,
        np.concatenate([one.counts, other.counts]),
        Ticks(
            np.concatenate([one.ticks.offset, other.ticks.offset + len(one)]),
            np.concatenate([one.ticks.device_s, other.ticks.device_s]),
            np.concatenate([one.ticks.host_s, other.ticks.host_s]),
            np.concatenate([one.ticks.temperature_c, other.ticks.temperature_c]),
        ),
    )


@pytest.fixture(scope="session")
def joined() -> Joined:
    """Merge Blocks with only Notices between them, and put those after: splits must not matter."""

    def join(events: Iterable[Event]) -> list[Event]:
        merged: list[Event] = []
        notices: list[Event] = []
        for event in events:
            if isinstance(event, Notice):
                notices.append(event)
            elif isinstance(event, Block) and merged and isinstance(merged[-1], Block):
                assert event.index == merged[-1].index + len(merged[-1]), (
                    "Blocks must be contiguous"
                )
                merged[-1] = _append(merged[-1], event)
            else:
                merged.append(event)
        return merged + notices

    return join


@pytest.fixture(scope="session")
def assert_same() -> Callable[[list[Event], list[Event]], None]:
    """Fail unless two lists of events say the same, NaN being equal to NaN."""

    def check(one: list[Event], other: list[Event]) -> None:
        assert [type(event) for event in one] == [type(event) for event in other]
        for left, right in zip(one, other, strict=True):
            if not isinstance(left, Block):
                assert left == right
                continue
            assert isinstance(right, Block)
            assert left.index == right.index
            assert left.counts.dtype == right.counts.dtype
            np.testing.assert_array_equal(left.counts, right.counts)
            for name in ("offset", "device_s", "host_s", "temperature_c"):
                np.testing.assert_array_equal(
                    getattr(left.ticks, name), getattr(right.ticks, name), err_msg=name
                )

    return check


@pytest.fixture(scope="session")
def fed() -> Callable[..., list[Event]]:
    """Feed bytes in pieces that end at the given places, then finish."""

    def feed(decoder: Decoder, data: bytes, cuts: Iterable[int] = ()) -> list[Event]:
        places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
        events: list[Event] = []
        for start, end in pairwise(places):
            events += decoder.feed(data[start:end], 1.0)
        return events + decoder.finish()

    return feed


@pytest.fixture(scope="session")
def accounted() -> Callable[..., None]:
    """Fail unless what came and what is said to be missing add up to what went in.

    Losses before the first and after the last delivered sample cannot be known, so `put_in` is the
    number of samples from the first delivered one to the last.
    """

    def check(decoder: Decoder, events: list[Event], put_in: int) -> None:
        delivered = sum(len(event) for event in events if isinstance(event, Block))
        lost = sum(event.lost or 0 for event in events if isinstance(event, Gap))
        assert delivered + lost == put_in
        assert decoder.stats.samples == delivered
        assert decoder.stats.lost_samples == lost

    return check


@pytest.fixture
def imu() -> StreamInfo:
    """Describe a LSM6DSM at 416 Hz, 250 dps and 2 g."""
    scale = (8.75e-3,) * 3 + (0.061e-3,) * 3
    return StreamInfo(AXES, scale, 416.0, "LSM6DSM", "native", 1e-6, True, 0x1234)


@pytest.fixture(scope="session")
def sealed() -> Callable[..., bytes]:
    """Write a native frame by hand: head fields, body, CRC, COBS."""

    def write(
        body: bytes, kind: int = 1, *, seq: int, flags: int = 0, n: int, **head: int
    ) -> bytes:
        version, epoch = head.get("version", 0x10), head.get("epoch", 0x1234)
        frame = struct.pack("<BBHHBB", kind, version, seq, epoch, flags, n) + body
        frame += crc32(frame).to_bytes(4, "little")
        runs = frame.split(b"\0")
        return b"".join(bytes((len(run) + 1,)) + run for run in runs) + b"\0"

    return write


@pytest.fixture(scope="session")
def data_frame(sealed: Callable[..., bytes]) -> Callable[..., bytes]:
    """Write a native data frame by hand; its samples are all zero."""

    def write(seq: int, index: int, n: int = 4, flags: int = 3, **more: int) -> bytes:
        times = more.pop("mcu_us", 0), more.pop("ticks", 0)
        body = struct.pack("<IQIh", index, *times, 0) + bytes(12 * n)
        return sealed(body, 1, seq=seq, flags=flags, n=n, **more)

    return write


@pytest.fixture
def noise() -> Callable[..., Block]:
    """Blocks of noise with device times and temperatures, at 416 Hz."""

    def make(samples: int, index: int = 0, seed: int = 1, axes: int = 6) -> Block:
        generator = np.random.default_rng(seed)
        rows = np.arange(0, samples, 9)
        return Block(
            index,
            generator.normal(0.0, 20.0, (samples, axes)).astype(np.int16),
            Ticks(
                rows,
                np.round((index + rows) / 416.0, 6),
                np.full(len(rows), np.nan),
                np.round(25.0 + rows / 2560.0, 2),
            ),
        )

    return make
