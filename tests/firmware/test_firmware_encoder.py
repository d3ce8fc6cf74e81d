"""The C encoder and the Python codec agree byte for byte, and books are kept as the norm says."""

import ctypes as c
import struct
import zlib

import numpy as np
import pytest

from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.wire import WireSettings, format_named
from allanscope.wire.native.framing import cobs_decode, cobs_encode
from support.encoder_ring import Ring

AXES = 6
WIRE_MAX = 248
DATA, REPLY = 0, 1


class Sender(c.Structure):
    _fields_ = (
        ("ring", c.POINTER(Ring)),
        ("seq", c.c_uint16),
        ("epoch", c.c_uint16),
        ("produced", c.c_uint32),
        ("sent", c.c_uint32),
        ("dropped", c.c_uint32),
        ("overruns", c.c_uint32),
        ("commands", c.c_uint32),
        ("bad_commands", c.c_uint32),
        ("pending_flags", c.c_uint8),
    )


class Data(c.Structure):
    _fields_ = (
        ("mcu_time_us", c.c_uint64),
        ("sensor_time", c.c_uint32),
        ("temperature", c.c_int16),
        ("channels", c.c_uint8),
        ("n", c.c_uint8),
        ("samples", c.c_void_p),
    )


class Command(c.Structure):
    _fields_ = (
        ("type", c.c_uint8),
        ("version", c.c_uint8),
        ("seq", c.c_uint16),
        ("n", c.c_uint8),
        ("body", c.POINTER(c.c_uint8)),
    )


class Receiver(c.Structure):
    _fields_ = (
        ("bytes", c.c_uint8 * WIRE_MAX),
        ("used", c.c_uint32),
        ("too_long", c.c_bool),
        ("bad", c.c_uint32),
    )


class Device:
    """A device made of the C encoder, with a ring of its own."""

    def __init__(self, encoder, size=1 << 16, reserve=0, epoch=7):
        self.c = encoder
        self.room = (c.c_uint8 * size)()
        self.ring, self.sender = Ring(), Sender()
        encoder.as_ring_init(c.byref(self.ring), self.room, size, reserve)
        encoder.as_sender_init(c.byref(self.sender), c.byref(self.ring), c.c_uint16(epoch))
        for name in ("as_send_data", "as_send_body", "as_send_status", "as_send_reply"):
            getattr(encoder, name).restype = c.c_bool

    def data(self, samples, time_us=0, sensor_time=0xFFFFFFFF, temperature=-32768, channels=3):
        samples = np.ascontiguousarray(samples, np.int16)
        one = Data(time_us, sensor_time, temperature, channels, len(samples), samples.ctypes.data)
        return self.c.as_send_data(c.byref(self.sender), c.byref(one))

    def body(self, kind, body):
        return self.c.as_send_body(c.byref(self.sender), kind, body, len(body))

    def drain(self):
        out = bytearray()
        while (byte := self.c.as_ring_take(c.byref(self.ring))) >= 0:
            out.append(byte)
        return bytes(out)


def descriptor(rate=416.0):
    """Return a descriptor's body with everything that a host must have."""

    def entry(tag, value):
        return bytes([tag, len(value)]) + value

    return b"\x01" + b"".join(
        [
            entry(0x01, b"LSM6DSM"),
            entry(0x06, struct.pack("<f", 8.75e-3)),
            entry(0x08, struct.pack("<f", 0.061e-3)),
            entry(0x09, struct.pack("<ff", 256.0, 25.0)),
            entry(0x0A, struct.pack("<f", rate)),
            entry(0x0C, b"\x3f"),
            entry(0x0D, b"\x01"),
        ]
    )


def decode(data):
    decoder = format_named("native").decoder(WireSettings())
    return decoder.feed(data, 0.0) + decoder.finish(), decoder.stats


@pytest.mark.parametrize(
    "length", [0, 1, 2, 252, 253, 254, 255, 256, 507, 508, 509, 510, 511, 1000]
)
@pytest.mark.parametrize("share", [0.0, 0.004, 0.5, 1.0])
def test_cobs_is_undone_at_every_length_around_its_edges(encoder, length, share):
    rng = np.random.default_rng(length)
    plain = np.where(rng.random(length) < share, 0, rng.integers(1, 256, length)).astype(np.uint8)
    stuffed, back = c.create_string_buffer(1100), c.create_string_buffer(1100)
    n = encoder.as_cobs_encode(plain.tobytes(), length, stuffed)
    assert b"\0" not in stuffed.raw[:n]
    assert n <= length + length // 254 + 1
    assert encoder.as_cobs_decode(stuffed.raw[:n], n, back) == length
    assert back.raw[:length] == plain.tobytes()


def test_cobs_and_crc_agree_with_python_over_twenty_thousand_frames(encoder):
    rng = np.random.default_rng(1)
    out = c.create_string_buffer(300)
    for _ in range(20_000):
        size = int(rng.integers(1, 247))
        frame = rng.integers(0, int(rng.choice([2, 256])), size).astype(np.uint8).tobytes()
        n = encoder.as_cobs_encode(frame, size, out)
        assert out.raw[:n] == cobs_encode(frame)
        assert encoder.as_crc32(frame, size) == zlib.crc32(frame)


def test_what_cobs_refuses_python_refuses_too(encoder):
    rng = np.random.default_rng(2)
    out = c.create_string_buffer(300)
    for _ in range(20_000):
        size = int(rng.integers(1, 240))
        chunk = rng.integers(1, int(rng.choice([6, 256])), size).astype(np.uint8).tobytes()
        n = encoder.as_cobs_decode(chunk, size, out)
        expected = cobs_decode(chunk)
        assert out.raw[:n] == (expected or b"")


def test_ten_thousand_random_frames_reach_the_python_decoder_unharmed(encoder):
    rng = np.random.default_rng(3)
    device = Device(encoder, size=1 << 22)
    assert device.body(2, descriptor())
    sent = []
    for _ in range(10_000):
        n = int(rng.integers(1, 19))
        samples = rng.integers(-32768, 32768, (n, AXES)).astype(np.int16)
        sent.append(samples)
        assert device.data(samples, time_us=int(rng.integers(0, 1 << 40)), temperature=256)
    events, stats = decode(device.drain())
    got = np.concatenate([event.counts for event in events if isinstance(event, Block)])
    np.testing.assert_array_equal(got, np.concatenate(sent))
    assert (stats.crc_errors, stats.lost_samples) == (0, 0)
    assert isinstance(events[0], StreamInfo)
    assert events[0].scale[0] == 0.00875


def test_index_gaps_equal_the_devices_drop_count_to_the_sample(encoder):
    rng = np.random.default_rng(4)
    device = Device(encoder, size=2048, reserve=512)
    device.body(2, descriptor())
    wire = device.drain()
    for _ in range(3000):
        device.data(np.zeros((16, AXES)))
        if rng.random() < 0.3:
            wire += device.drain()
    wire += device.drain()
    device.data(np.zeros((16, AXES)))
    wire += device.drain()
    device.c.as_send_status(c.byref(device.sender), c.c_uint64(5))
    events, stats = decode(wire + device.drain())
    lost = sum(event.lost for event in events if isinstance(event, Gap))
    status = next(e for e in events if isinstance(e, Notice) and e.kind == "status")
    assert device.sender.dropped > 0
    assert lost == device.sender.dropped == status.fields["dropped"] == stats.lost_samples
    assert {e.reason for e in events if isinstance(e, Gap)} == {"device"}


def test_a_reply_finds_room_in_a_ring_full_of_data(encoder):
    device = Device(encoder, size=1024, reserve=256)
    while device.data(np.zeros((16, AXES))):
        pass
    assert device.c.as_send_reply(c.byref(device.sender), 9, 0x82, 0, None, 0)
    events, _ = decode(device.drain())
    assert "reply" in [event.kind for event in events if isinstance(event, Notice)]


def test_an_overrun_of_the_sensor_is_told_apart_from_a_drop(encoder):
    device = Device(encoder)
    device.body(2, descriptor())
    device.data(np.zeros((4, AXES)))
    device.c.as_sensor_lost(c.byref(device.sender), 11)
    device.data(np.zeros((4, AXES)))
    events, _ = decode(device.drain())
    assert [(e.reason, e.lost) for e in events if isinstance(e, Gap)] == [("sensor", 11)]


def receive(encoder, data):
    receiver, command, got = Receiver(), Command(), []
    encoder.as_receiver_init(c.byref(receiver))
    encoder.as_receive.restype = c.c_bool
    for byte in data:
        if encoder.as_receive(c.byref(receiver), c.c_uint8(byte), c.byref(command)):
            got.append((command.type, command.seq, bytes(command.body[: command.n])))
    return got, receiver.bad


def command(kind, seq, body=b""):
    frame = struct.pack("<BBHHBB", kind, 0x10, seq, 0, 0, len(body)) + body
    return b"\0" + cobs_encode(frame + zlib.crc32(frame).to_bytes(4, "little")) + b"\0"


def test_commands_are_read_between_damaged_ones_and_the_damage_is_counted(encoder):
    rng = np.random.default_rng(5)
    stream, good, bad = b"", [], 0
    for seq in range(2000):
        body = rng.integers(0, 256, int(rng.integers(0, 33))).astype(np.uint8).tobytes()
        one = bytearray(command(0x85, seq, body))
        if rng.random() < 0.2:
            place = int(rng.integers(1, len(one) - 1))
            one[place] = one[place] % 255 + 1
            bad += 1
        else:
            good.append((0x85, seq, body))
        stream += bytes(one)
    got, counted = receive(encoder, stream)
    assert got == good
    # A damaged byte can turn a distance, never a zero, so each damaged frame is one chunk.
    assert counted == bad


def test_a_receiver_survives_anything_and_is_in_step_after_the_next_zero(encoder):
    rng = np.random.default_rng(6)
    noise = rng.integers(0, 256, 100_000).astype(np.uint8).tobytes() + b"\x01" * 5000
    got, _ = receive(encoder, noise + command(0x82, 77))
    assert got[-1] == (0x82, 77, b"")
