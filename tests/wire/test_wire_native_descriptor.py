"""What a descriptor may leave out, and what it says of the source and of the clock."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import pytest

from allanscope.samples import Block, Gap, StreamInfo
from allanscope.simulator import Simulator
from allanscope.wire.native import NativeDecoder, NativeEncoder, descriptor
from allanscope.wire.native.layout import float32, pack_entries

Wire = Callable[..., bytes]

NEEDED = [
    (0x06, float32(8.75e-3)),
    (0x08, float32(0.061e-3)),
    (0x0A, float32(104.0)),
    (0x0C, b"\x3f"),
    (0x0D, b"\x01"),
]


def body(*entries: tuple[int, bytes]) -> bytes:
    """Return the body of a descriptor that has what every device must say, and more."""
    return b"\x01" + pack_entries([*NEEDED, *entries])


def stream(sealed: Wire, data_frame: Wire, said: bytes, seconds: int = 60) -> bytes:
    """Return a minute of a device that sends its descriptor every second, as it must."""
    wire, seq = b"", 0
    for second in range(seconds):
        wire += sealed(said, 2, seq=seq, n=len(said))
        for frame in range(26):
            seq += 1
            wire += data_frame(seq, 104 * second + 4 * frame)
        seq += 1
    return wire


@pytest.mark.parametrize(
    "temperature",
    [
        (),
        ((0x09, b""),),
        ((0x09, struct.pack("<ff", np.nan, 25.0)),),
        ((0x09, struct.pack("<ff", 256.0, np.nan)),),
        ((0x09, struct.pack("<ff", np.inf, -np.inf)),),
        ((0x09, struct.pack("<ff", 0.0, 25.0)),),
    ],
)
@pytest.mark.parametrize("batch", [False, True])
def test_a_descriptor_that_is_sent_again_is_no_restart_whatever_it_says_of_the_temperature(
    temperature: tuple[tuple[int, bytes], ...], batch: bool, sealed: Wire, data_frame: Wire
) -> None:
    decoder = NativeDecoder(batch)
    events = decoder.feed(stream(sealed, data_frame, body(*temperature)), 0.0)
    assert [event for event in events if isinstance(event, Gap)] == []
    assert len([event for event in events if isinstance(event, StreamInfo)]) == 1
    assert sum(len(event) for event in events if isinstance(event, Block)) == 60 * 104
    assert (decoder.stats.lost_samples, decoder.stats.unknown_losses) == (0, 0)


@pytest.mark.parametrize("tag", range(0x14))
@pytest.mark.parametrize("value", [b"", b"\xff", b"\xff" * 4, b"\xff" * 8, b"\0" * 8])
def test_a_descriptor_equals_itself_whatever_is_in_it(tag: int, value: bytes) -> None:
    first, again = (descriptor.read(body((tag, value)), 7) for _ in range(2))
    assert first == again
    if first is not None:
        assert np.isfinite([first.info.nominal_hz, *first.info.scale]).all()


def test_a_stream_is_not_described_by_what_never_equals_itself() -> None:
    with pytest.raises(ValueError, match="must be finite"):
        StreamInfo(("gx",), (float("nan"),))
    with pytest.raises(ValueError, match="must be finite"):
        StreamInfo(("gx",), (1.0,), nominal_hz=float("nan"))


@pytest.mark.parametrize(
    ("source", "origin"),
    [
        ((), ""),
        (((0x12, b"\1"),), "measured"),
        (((0x12, b"\2"),), "synthetic"),
        (((0x12, b"\3"),), "emulated"),
        (((0x12, b"\x09"),), ""),
        (((0x12, b""),), ""),
    ],
)
def test_the_source_is_what_the_device_says_and_unknown_where_it_says_nothing(
    source: tuple[tuple[int, bytes], ...], origin: str
) -> None:
    known = descriptor.read(body(*source), 7)
    assert known is not None
    assert known.info.origin == origin


@pytest.mark.parametrize(
    ("clock", "word", "comparable"),
    [
        (b"\0", "none", False),
        (b"\1", "crystal", True),
        (b"\2", "RC oscillator", False),
        (b"\3", "emulated", True),
        (b"\x09", "RC oscillator", False),
    ],
)
def test_the_clock_is_called_what_it_is(clock: bytes, word: str, comparable: bool) -> None:
    known = descriptor.read(body((0x0D, clock)), 7)
    assert known is not None
    assert (known.info.details["clock"], known.info.device_clock) == (word, comparable)


def test_a_simulated_device_says_that_it_is_one(fed: Callable[..., list[object]]) -> None:
    sensor = Simulator(rate=104.0, seed=1)
    encoder = NativeEncoder()
    wire = encoder.describe(sensor.info) + encoder.encode(sensor.read(50))
    info = fed(NativeDecoder(), wire)[0]
    assert isinstance(info, StreamInfo)
    assert (info.origin, info.details["clock"]) == ("synthetic", "emulated")


def test_a_device_of_version_1_0_is_read_as_before(sealed: Wire, data_frame: Wire) -> None:
    said = body()
    wire = sealed(said, 2, seq=0, n=len(said), version=0x10) + data_frame(1, 0, version=0x10)
    info, block = NativeDecoder().feed(wire, 0.0)
    assert isinstance(info, StreamInfo)
    assert info.origin == ""
    assert isinstance(block, Block)
