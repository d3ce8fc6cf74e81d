"""The TMsg protocol, against vectors worked out from ST's sources."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from allanscope.samples import AXES, Block, Event, Gap, Notice, StreamInfo, Ticks
from allanscope.wire import WireSettings, format_named
from allanscope.wire.rows import Pairing
from allanscope.wire.tmsg.messages import Reading, Unwrapper, read_current, read_sensortile, wrap

VECTORS = {
    "ping": ("32 01 01", "32 01 01 CC F0"),
    "ping reply": ("01 32 81", "01 32 81 4C F0"),
    "read presentation": ("32 01 02", "32 01 02 CB F0"),
    "set index acc": ("32 01 50 15 01 00", "32 01 50 15 01 00 67 F0"),
    "set index gyro": ("32 01 50 15 02 00", "32 01 50 15 02 00 66 F0"),
    "gyro full scale 125": ("32 01 50 05 02 7D 00 00 00", "32 01 50 05 02 7D 00 00 00 F9 F0"),
    "gyro rate 104": ("32 01 50 07 02 00 00 D0 42", "32 01 50 07 02 00 00 D0 42 62 F0"),
    "start": ("32 01 08 30 00 00 00", "32 01 08 30 00 00 00 95 F0"),
    "stop": ("32 01 09", "32 01 09 C4 F0"),
    "stream": (
        "01 32 08 40 E2 01 00 18 00 FD FF FF FF 0C 00 00 00 E9 03 00 00"
        " E8 FE FF FF EA 01 00 00 BA FF FF FF",
        "01 32 08 40 E2 01 00 18 00 FD FF FF FF 0C 00 00 00 E9 03 00 00"
        " E8 FE FF FF EA 01 00 00 BA FF FF FF 12 F0",
    ),
    "stream with stuffing": (
        "01 32 08 F0 00 00 00 10 00 F1 00 00 00 F0 FF FF FF 00 00 00 00",
        "01 32 08 F1 F2 00 00 00 10 00 F1 F1 00 00 00 F1 F2 FF FF FF 00 00 00 00 E7 F0",
    ),
}


@pytest.mark.parametrize("name", VECTORS)
def test_framing_gives_the_known_bytes(name: str) -> None:
    body, wire = (bytes.fromhex(text) for text in VECTORS[name])
    assert wrap(body) == wire
    assert list(Unwrapper().feed(wire)) == [body]


@given(body=st.binary(min_size=3, max_size=300))
def test_any_body_survives_the_framing(body: bytes) -> None:
    assert list(Unwrapper().feed(wrap(body))) == [body]


@pytest.mark.parametrize(
    "wire",
    [
        "32 01 01 CD F0",  # wrong sum
        "32 01 F1 01 CC F0",  # an escape of nothing
        "32 01 01 CC F1 F0",  # an escape at the end
        "F1 F0",
        "32 01 F1 F3 DD F0",  # an escape of something else, with the sum of 32 01 F0
        "00 F0",
    ],
)
def test_a_damaged_message_is_counted(wire: str) -> None:
    unwrapper = Unwrapper()
    list(unwrapper.feed(bytes.fromhex(VECTORS["ping"][1])))
    assert list(unwrapper.feed(bytes.fromhex(wire))) == [None]
    assert unwrapper.damaged == 1


def test_the_stream_vectors_say_what_they_should() -> None:
    both, gyro = (bytes.fromhex(VECTORS[n][0]) for n in ("stream", "stream with stuffing"))
    plain = read_current(both)
    assert plain is not None
    assert (plain.stamp, plain.gyro, plain.accel) == (123456, (-280, 490, -70), (-3, 12, 1001))
    stuffed = read_current(gyro)
    assert stuffed is not None
    assert (stuffed.stamp, stuffed.gyro, stuffed.accel) == (240, (241, -16, 0), None)


def test_the_encoder_writes_the_stream_vector() -> None:
    encoder = format_named("tmsg").encoder()
    encoder.describe(StreamInfo(AXES, (0.07,) * 3 + (1e-3,) * 3, 104.0))
    ticks = Ticks(*(np.array([x]) for x in (0, 0.123456, np.nan, np.nan)))
    block = Block(0, np.array([[-4, 7, -1, -3, 12, 1001]], np.int16), ticks)
    assert encoder.encode(block) == bytes.fromhex(VECTORS["stream"][1])


def test_blocks_come_in_the_order_of_the_mask() -> None:
    values = [(4, 1013.25), (4, 21.5), (4, 40.0)]
    body = bytes((1, 0x32, 8)) + struct.pack("<IH", 7, 0x7FF & ~(1 << 9))
    body += b"".join(struct.pack("<f", value) for _, value in values)
    body += struct.pack("<3i3i3i", 1, 2, 3, 4, 5, 6, 7, 8, 9)
    reading = read_current(body + bytes(1 + 8 + 16 + 4))
    assert reading == Reading(7, (4, 5, 6), (1, 2, 3), 21.5)
    assert read_current(body + bytes(2 + 8 + 16 + 4)) == reading
    assert read_current(body + bytes(3 + 8 + 16 + 4)) is None
    assert read_current(body + bytes(8 + 16 + 4)) is None


@pytest.mark.parametrize("mask", [1 << 11, 1 << 15])
def test_an_unknown_bit_of_the_mask_is_refused(mask: int) -> None:
    assert read_current(bytes((1, 0x32, 8)) + struct.pack("<IH", 7, mask)) is None


def test_values_that_no_sensor_can_have_are_refused() -> None:
    head = bytes((1, 0x32, 8)) + struct.pack("<IH", 7, 1 << 4)
    assert read_current(head + struct.pack("<3i", 2_293_760, 0, -2_293_760)) is not None
    assert read_current(head + struct.pack("<3i", 2_293_761, 0, 0)) is None


def _sensortile(new: int, **changes: int) -> bytes:
    body = bytearray(56)
    body[:7] = bytes((1, 0x32, 8, 23, 59, 58, 97))
    struct.pack_into("<3f3i3i3i", body, 7, 1013.0, 22.5, 40.0, 1, 2, 3, 70, -140, 0, 7, 8, 9)
    body[55] = new
    for place, value in changes.items():
        body[int(place[1:])] = value
    return bytes(body)


def test_the_sensortile_layout_gives_only_what_is_new() -> None:
    stamp = ((23 * 60 + 59) * 60 + 58) * 100 + 97
    reading = read_sensortile(_sensortile(0b100011))
    assert reading == Reading(stamp, (70, -140, 0), (1, 2, 3), 22.5)
    only_gyro = read_sensortile(_sensortile(0b000010))
    assert only_gyro is not None
    assert only_gyro.accel is None
    assert np.isnan(only_gyro.temperature_c)
    only_accel = read_sensortile(_sensortile(0b000001))
    assert only_accel is not None
    assert only_accel.gyro is None


@pytest.mark.parametrize("change", [{"b3": 24}, {"b4": 60}, {"b5": 60}, {"b6": 100}, {"b1": 1}])
def test_a_message_with_no_time_of_day_is_refused(change: dict[str, int]) -> None:
    assert read_sensortile(_sensortile(3, **change)) is None


@pytest.mark.parametrize("name", ["tmsg", "tmsg-sensortile"])
def test_the_two_layouts_do_not_pass_for_each_other(name: str) -> None:
    encoder = format_named(name).encoder()
    wire = encoder.encode(Block(0, np.zeros((20, 6), np.int16), Ticks.none()))
    for other in ("tmsg", "tmsg-sensortile"):
        assert format_named(other).score(wire) == (other == name)


def test_a_board_is_started_in_the_right_order() -> None:
    settings = WireSettings(rate_hz=104.0, gyro_fs=125.0)
    messages = format_named("tmsg").start(settings)
    known = {bytes.fromhex(wire): name for name, (_, wire) in VECTORS.items()}
    names = [known.get(message, "other") for message in messages]
    assert names[:3] == ["ping", "set index acc", "set index gyro"]
    assert names.index("gyro full scale 125") < names.index("gyro rate 104")
    assert messages[-1] == wrap(bytes.fromhex("32 01 08 32 00 00 00"))
    assert format_named("tmsg").stop() == [bytes.fromhex(VECTORS["stop"][1])]
    older = format_named("tmsg-sensortile").start(WireSettings())
    assert len(older) == 2
    assert format_named("tmsg").encoder().silent_until_started


def test_garbage_before_the_first_request_costs_the_ping_only() -> None:
    device = format_named("tmsg").encoder()
    messages = format_named("tmsg").start(WireSettings())
    commands = device.receive(b"\0\x03\x83" + b"".join(messages))
    assert [command.name for command in commands] == ["unknown"] * 3 + ["start"]


def test_replies_are_shown() -> None:
    device, decoder = format_named("tmsg").encoder(), format_named("tmsg").decoder(WireSettings())
    ping, who, start = (
        device.receive(bytes.fromhex(VECTORS[name][1]))[0]
        for name in ("ping", "read presentation", "start")
    )
    assert device.reply(ping) == bytes.fromhex(VECTORS["ping reply"][1])
    assert device.reply(start) == wrap(bytes.fromhex("01 32 88"))
    assert device.reply(ping, ok=False) == b""
    wire = device.reply(ping) + device.reply(who) + device.reply(start)
    said = [event.text for event in decoder.feed(wire, 0.0) if isinstance(event, Notice)]
    assert said == [
        "command 0x01",
        "command 0x02: MEMS shield demo,101,9.4.0,0.0.0,IKS01A2",
        "command 0x08",
    ]


@pytest.mark.parametrize("full_scale", [125.0, 250.0, 500.0, 1000.0, 2000.0])
def test_counts_of_the_gyroscope_are_had_back_exactly(
    full_scale: float, fed: Callable[..., list[Event]]
) -> None:
    scale = full_scale * 35e-6
    every = np.arange(-32768, 32768, 7, dtype=np.int16)
    counts = np.stack([every, every[::-1], np.roll(every, 3)], axis=1)
    encoder = format_named("tmsg").encoder()
    encoder.describe(StreamInfo(AXES[:3], (scale,) * 3, 104.0))
    decoder = format_named("tmsg").decoder(WireSettings(gyro_fs=full_scale))
    events = fed(decoder, encoder.encode(Block(0, counts, Ticks.none())))
    received = np.concatenate([event.counts for event in events if isinstance(event, Block)])
    np.testing.assert_array_equal(received, counts[-len(received) :])
    assert len(received) >= len(counts) - 8


def test_microseconds_go_on_after_two_to_the_32(fed: Callable[..., list[Event]]) -> None:
    encoder = format_named("tmsg").encoder()
    ticks = Ticks(
        np.array([0]), np.array([2**32 / 1e6 - 0.5]), np.array([np.nan]), np.array([25.0])
    )
    wire = encoder.encode(Block(0, np.zeros((104, 6), np.int16), ticks))
    _, block = fed(format_named("tmsg").decoder(WireSettings()), wire)
    assert isinstance(block, Block)
    assert np.all(np.diff(block.ticks.device_s) > 0.0)


def test_halves_of_a_sample_are_joined() -> None:
    pairing = Pairing()
    assert pairing.update((1, 2, 3), None) is None
    assert pairing.update(None, (4, 5, 6)) == (1, 2, 3, 4, 5, 6)
    assert pairing.update((7, 8, 9), (1, 1, 1)) == (7, 8, 9, 1, 1, 1)
    assert pairing.update((1, 2, 3), None) is None
    assert pairing.update((4, 4, 4), None) is None
    assert pairing.update(None, (5, 5, 5)) == (4, 4, 4, 5, 5, 5)


@pytest.mark.parametrize("sensor", [0, 3])
def test_a_sensor_that_never_comes_is_done_without(sensor: int) -> None:
    pairing = Pairing()
    halves: list[tuple[float, float, float] | None] = [None, None]
    halves[sensor // 3] = (1.0, 2.0, 3.0)
    rows = [pairing.update(*halves) for _ in range(10)]
    assert rows[:8] == [None] * 8
    assert rows[8] is not None
    assert np.isnan(rows[8]).tolist() == [sensor == 3] * 3 + [sensor == 0] * 3


def test_a_message_with_halves_at_different_times_still_makes_rows() -> None:
    decoder = format_named("tmsg").decoder(WireSettings())
    wire = b""
    for i in range(60):
        head = bytes((1, 0x32, 8))
        wire += wrap(head + struct.pack("<IH3i", 9600 * i, 1 << 4, 70, 0, -70))
        wire += wrap(head + struct.pack("<IH3i", 9600 * i + 900, 1 << 3, 1, 2, 1000))
    events = decoder.feed(wire, 0.0)
    assert not [event for event in events if isinstance(event, Gap)]
    assert decoder.stats.samples == 60
