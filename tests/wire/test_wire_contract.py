"""What every format must do, whatever its wire looks like."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from allanscope.errors import UsageError
from allanscope.samples import AXES, Block, Event, Gap, Notice, StreamInfo, Ticks
from allanscope.wire import (
    Command,
    Encoder,
    WireSettings,
    answers,
    feed_chunks,
    format_named,
    formats,
    sniff,
)
from support.asked import said_when_asked

Joined = Callable[[list[Event]], list[Event]]
Check = Callable[[list[Event], list[Event]], None]

RATE = 104.0
INFO = StreamInfo(AXES, (70e-3,) * 3 + (0.061e-3,) * 3, RATE, "LSM6DSM", "", 1e-6, True, epoch=3)
COARSE = ("datalog11", "tmsg-sensortile")
SETTINGS = WireSettings(part="LSM6DSM")


def block(samples: int = 120, index: int = 0, seed: int = 4, rate: float = RATE) -> Block:
    generator = np.random.default_rng(seed)
    counts = generator.normal(0.0, 30.0, (samples, 6)).astype(np.int16)
    counts[:, 5] += 16_393
    offset = np.arange(samples)
    return Block(
        index,
        counts,
        Ticks(
            offset,
            10.0 + (index + offset) / rate,
            np.full(samples, np.nan),
            np.full(samples, 26.5),
        ),
    )


def stream(name: str, *blocks: Block, info: StreamInfo = INFO) -> bytes:
    encoder = format_named(name).encoder()
    return (
        encoder.describe(info)
        + said_when_asked(encoder, name)
        + b"".join(map(encoder.encode, blocks))
    )


def started(name: str, device: Encoder, asked: WireSettings) -> tuple[list[Command], bytes]:
    """Return the commands that a host starts a device with, and all that the device answers."""
    entry = format_named(name)
    host, commands, said = entry.decoder(asked), [], b""
    messages = entry.start(asked)
    while messages:
        new = [command for message in messages for command in device.receive(message)]
        reply = b"".join(map(device.reply, new))
        host.feed(reply, 0.0)
        commands, said, messages = commands + new, said + reply, answers(host)
    return commands, said


STREAMS = {name: stream(name, block(60), block(60, 64, seed=5)) for name in formats()}


def checked(events: list[Event]) -> list[Event]:
    """Fail unless events keep what `allanscope.samples` promises of them."""
    info: StreamInfo | None = None
    expected: int | None = None
    for event in events:
        match event:
            case StreamInfo():
                info = event
            case Gap(lost=None):
                expected = None
            case Gap(lost=lost):
                expected = None if expected is None else expected + int(lost or 0)
            case Notice(text=text):
                assert text.isprintable()
            case Block():
                assert info is not None
                assert event.counts.shape == (len(event), len(info.axes))
                assert event.counts.dtype in (np.int16, np.int32, np.float64)
                assert len(event) > 0
                assert expected is None or event.index == expected
                expected = event.index + len(event)
                offset = event.ticks.offset
                assert (np.diff(offset) > 0).all()
                assert ((offset >= 0) & (offset < len(event))).all()
                for column in (event.ticks.device_s, event.ticks.host_s, event.ticks.temperature_c):
                    assert column.shape == offset.shape
    return events


@pytest.mark.parametrize("name", formats())
class TestEveryFormat:
    def test_it_says_what_it_is(self, name: str) -> None:
        entry = format_named(name)
        assert entry.name == name
        assert entry.summary.isprintable()
        assert len(entry.summary) < 90

    def test_a_stream_survives_the_round_trip(
        self, name: str, fed: Callable[..., list[Event]], joined: Joined
    ) -> None:
        sent = block()
        decoder = format_named(name).decoder(SETTINGS)
        info, received = joined(checked(fed(decoder, stream(name, sent))))[:2]
        assert isinstance(info, StreamInfo)
        assert isinstance(received, Block)
        assert info.axes == AXES
        assert info.nominal_hz == pytest.approx(RATE, rel=0.04)
        expected = sent.counts * np.asarray(INFO.scale)
        got = received.counts * np.asarray(info.scale)
        truncated = np.asarray(info.truncated or (False,) * 6)
        np.testing.assert_allclose(got[:, ~truncated], expected[:, ~truncated], atol=1e-9)
        cut = np.trunc(np.round(expected[:, truncated] / 1e-3, 6)) * 1e-3
        np.testing.assert_allclose(got[:, truncated], cut, atol=1e-9)
        resolution = info.time_resolution_s
        rows = received.ticks.offset
        steps = received.ticks.device_s - sent.ticks.device_s[rows]
        assert np.ptp(steps) <= resolution + 1e-9
        assert decoder.stats.samples == len(sent)
        assert decoder.stats.bytes == len(stream(name, sent))

    def test_the_temperature_comes_along(self, name: str, fed: Callable[..., list[Event]]) -> None:
        if name == "sdatalog":
            pytest.skip("this firmware sends no temperature")
        events = fed(format_named(name).decoder(SETTINGS), stream(name, block()))
        for event in events:
            if isinstance(event, Block):
                assert event.ticks.temperature_c == pytest.approx(26.5)

    @pytest.mark.parametrize("way", ["whole", "byte by byte", "with trailing garbage"])
    def test_it_does_not_matter_how_bytes_arrive(
        self,
        name: str,
        way: str,
        fed: Callable[..., list[Event]],
        joined: Joined,
        assert_same: Check,
    ) -> None:
        data = STREAMS[name]
        whole = fed(format_named(name).decoder(SETTINGS), data)
        cuts = range(len(data)) if way == "byte by byte" else []
        more = b"\x81garb\xf1\xf3age" if way == "with trailing garbage" else b""
        events = fed(format_named(name).decoder(SETTINGS), data + more, cuts)
        assert_same(joined(checked(events)), joined(checked(whole)))

    @settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(cuts=st.lists(st.integers(0, 1 << 16), max_size=40))
    def test_any_split_gives_the_same_events(
        self,
        name: str,
        cuts: list[int],
        fed: Callable[..., list[Event]],
        joined: Joined,
        assert_same: Check,
    ) -> None:
        one, other = (format_named(name).decoder(SETTINGS) for _ in range(2))
        whole = joined(fed(one, STREAMS[name]))
        assert_same(joined(fed(other, STREAMS[name], cuts)), whole)
        assert one.stats == other.stats

    @settings(max_examples=60, deadline=None)
    @given(pieces=st.lists(st.binary(max_size=300), max_size=8))
    def test_arbitrary_bytes_never_raise(self, name: str, pieces: list[bytes]) -> None:
        decoder = format_named(name).decoder(SETTINGS)
        events = [event for piece in pieces for event in decoder.feed(piece, 0.0)]
        checked(events + decoder.finish())
        assert decoder.stats.bytes == sum(map(len, pieces))

    @settings(max_examples=60, deadline=None)
    @given(
        faults=st.lists(
            st.tuples(st.integers(0, 1 << 16), st.binary(max_size=8), st.integers(0, 90)),
            max_size=12,
        ),
        cuts=st.lists(st.integers(0, 1 << 16), max_size=3),
    )
    def test_a_damaged_stream_never_raises(
        self,
        name: str,
        faults: list[tuple[int, bytes, int]],
        cuts: list[int],
        fed: Callable[..., list[Event]],
    ) -> None:
        data = bytearray(STREAMS[name])
        for where, new, cut in faults:
            place = where % (len(data) + 1)
            data[place : place + cut] = new
        checked(fed(format_named(name).decoder(SETTINGS), bytes(data), cuts))

    def test_a_decoder_can_be_interrupted_anywhere(
        self, name: str, joined: Joined, accounted: Callable[..., None]
    ) -> None:
        data = STREAMS[name]
        for place in range(0, len(data), len(data) // 25):
            decoder = format_named(name).decoder(SETTINGS)
            events = decoder.feed(data[:place], 0.0)
            before = sum(len(event) for event in events if isinstance(event, Block))
            events += decoder.interrupt("disconnected")
            after = decoder.feed(data, 0.0) + decoder.finish()
            checked(events + after)
            gaps = [event for event in after if isinstance(event, Gap)]
            assert bool(before) == any(gap.reason == "disconnected" for gap in gaps)

    def test_an_endless_frame_or_line_is_dropped_in_little_memory(self, name: str) -> None:
        decoder = format_named(name).decoder(SETTINGS)
        piece = b"7" * 10_000
        tracemalloc.start()
        for _ in range(200):
            assert decoder.feed(piece, 0.0) == []
        held, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert held < 50_000
        end = {"native": b"\0", "tmsg": b"\xf0", "tmsg-sensortile": b"\xf0"}.get(name, b"\n")
        events = decoder.feed(end + STREAMS[name], 0.0) + decoder.finish()
        assert sum(len(event) for event in events if isinstance(event, Block)) == 120
        assert decoder.stats.resyncs + decoder.stats.crc_errors >= 1

    def test_a_stream_is_recognised_in_two_seconds_from_the_middle(self, name: str) -> None:
        data = stream(name, block(208))
        middle = data[len(data) // 3 + 7 :]
        header = stream(name) if name == "text" else b""
        for sample in (data, middle, b"\x00\xffgarbage\x80\n" + middle, header + middle):
            found = sniff(sample)
            assert found.name == name, found

    def test_what_starts_a_device_is_understood_by_its_encoder(self, name: str) -> None:
        entry = format_named(name)
        asked = WireSettings(rate_hz=208.0, gyro_fs=500.0, accel_fs=4.0)
        device = entry.encoder()
        commands, _ = started(name, device, asked)
        if commands:
            assert commands[-1].name == "start"
            fields = {k: v for c in commands if c.name == "set" for k, v in c.fields.items()}
            assert fields["rate_hz"] == 208.0
            assert fields["gyro_fs"] == 500.0
            assert fields["accel_fs"] == 4.0
            stops = [c for message in entry.stop() for c in device.receive(message)]
            assert [c.name for c in stops] == ["stop"]
        else:
            assert not device.silent_until_started
            assert device.receive(b"start\r\n") == []

    def test_replies_and_statuses_are_no_samples(self, name: str) -> None:
        entry = format_named(name)
        device, decoder = entry.encoder(), entry.decoder(SETTINGS)
        wire = device.describe(INFO)
        commands, said = started(name, device, SETTINGS)
        wire += said + device.status(100, 90, 10, 1.0) + device.encode(block())
        events = checked(decoder.feed(wire, 0.0) + decoder.finish())
        assert decoder.stats.samples == 120
        replies = [e for e in events if isinstance(e, Notice) and e.kind == "reply"]
        assert len(replies) >= len(commands) - 3
        assert not [e for e in events if isinstance(e, Notice) and e.kind == "error"]

    def test_many_chunks_at_once_are_the_same_as_one_by_one(
        self, name: str, joined: Joined, assert_same: Check
    ) -> None:
        data = STREAMS[name]
        ends = np.arange(0, len(data), 71)
        ends[-1] = len(data)
        times = np.linspace(0.0, 1.0, len(ends))
        one, other = (format_named(name).decoder(SETTINGS) for _ in range(2))
        starts = np.concatenate([[0], ends[:-1]])
        slowly = [
            event
            for start, end, time in zip(starts, ends, times, strict=True)
            for event in one.feed(data[start:end], time)
        ]
        at_once = feed_chunks(other, data, ends, times)
        assert_same(
            joined(at_once + other.finish()),
            joined(slowly + one.finish()),
        )

    def test_an_empty_block_is_no_bytes(self, name: str) -> None:
        encoder = format_named(name).encoder()
        assert encoder.encode(Block(0, np.empty((0, 6), np.int16), Ticks.none())) == b""

    def test_a_block_without_times_is_paced_by_the_nominal_rate(
        self, name: str, fed: Callable[..., list[Event]], joined: Joined
    ) -> None:
        sent = Block(0, block().counts, Ticks.none())
        decoder = format_named(name).decoder(SETTINGS)
        received = joined(fed(decoder, stream(name, sent)))[1]
        assert isinstance(received, Block)
        steps = received.ticks.device_s - received.ticks.offset / RATE
        assert np.ptp(steps) <= 0.011

    def test_only_the_gyroscope_is_possible_too(
        self, name: str, fed: Callable[..., list[Event]], joined: Joined
    ) -> None:
        if name.startswith("datalog"):
            pytest.skip("this firmware always prints both sensors")
        info = StreamInfo(AXES[:3], INFO.scale[:3], RATE, "LSM6DSM", "", 1e-6, True, epoch=3)
        sent = Block(0, block().counts[:, :3], Ticks.none())
        decoder = format_named(name).decoder(SETTINGS)
        first, received = joined(fed(decoder, stream(name, sent, info=info)))[:2]
        assert isinstance(first, StreamInfo)
        assert isinstance(received, Block)
        assert first.axes == AXES[:3]
        np.testing.assert_allclose(
            received.counts * np.asarray(first.scale),
            (sent.counts * 70e-3)[-len(received) :],
            atol=1e-9,
        )


@pytest.mark.parametrize("name", formats())
@pytest.mark.parametrize("lost", [1, 3, 4])
def test_whole_samples_that_vanish_are_counted_exactly(
    name: str, lost: int, fed: Callable[..., list[Event]], accounted: Callable[..., None]
) -> None:
    # WrappingCounter of 10 ms are too coarse to count single samples at 104 Hz, but not at 26 Hz.
    rate = 26.0 if name in COARSE else RATE
    later = block(200, 200 + lost, seed=6, rate=rate)
    info = replace(INFO, nominal_hz=rate)
    data = stream(name, block(200, rate=rate), later, info=info)
    decoder = format_named(name).decoder(SETTINGS)
    events = fed(decoder, data)
    accounted(decoder, events, 400 + lost)
    assert decoder.stats.lost_samples == lost
    assert decoder.stats.unknown_losses == 0


@pytest.mark.parametrize("name", COARSE)
@pytest.mark.parametrize("rate", [98.0, 104.0, 416.0])
def test_where_stamps_are_too_coarse_a_hole_is_left_without_a_number(
    name: str, rate: float, fed: Callable[..., list[Event]]
) -> None:
    """Steps of 10 ms at 104 Hz: whether one sample is missing or two, nothing tells."""
    blocks = block(200, rate=rate), block(200, 220, seed=6, rate=rate)
    decoder = format_named(name).decoder(SETTINGS)
    events = fed(decoder, stream(name, *blocks, info=replace(INFO, nominal_hz=rate)))
    assert [event for event in events if isinstance(event, Gap)] == [Gap("device", None)]
    assert decoder.stats.samples == 400


def test_a_damaged_message_under_coarse_stamps_is_never_passed_over(
    fed: Callable[..., list[Event]],
) -> None:
    """The two sides of a damaged message are no neighbours, whatever the stamps say."""
    data = bytearray(stream("tmsg-sensortile", block(400)))
    ends = [place for place, byte in enumerate(data) if byte == 0xF0]
    for number in range(40, 400, 40):
        data[ends[number] - 20] ^= 4
    decoder = format_named("tmsg-sensortile").decoder(SETTINGS)
    events = fed(decoder, bytes(data))
    gaps = [event for event in events if isinstance(event, Gap)]
    assert len(gaps) == decoder.stats.crc_errors == 9
    assert {gap.lost for gap in gaps} == {None}
    assert {gap.reason for gap in gaps} == {"link"}


def test_an_unknown_format_is_refused_with_all_names() -> None:
    with pytest.raises(UsageError, match="native, sdatalog, tmsg"):
        format_named("morse")


def test_formats_are_imported_when_they_are_asked_for() -> None:
    import subprocess
    import sys

    code = (
        "import sys, allanscope.wire; "
        "print([m for m in sys.modules if m.startswith('allanscope.wire.native')"
        " or m == 'scipy'])"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"


def test_what_a_format_can_do_is_declared_by_its_class_and_its_streams() -> None:
    traits = ("numbered", "polled", "tabular")
    declared = {}
    for name in formats():
        events = format_named(name).decoder(SETTINGS).feed(STREAMS[name], 0.0)
        info = next(event for event in events if isinstance(event, StreamInfo))
        declared[name] = {trait for trait in traits if getattr(info, trait)}
        assert (format_named(name).encoder().samples_per_frame(RATE) > 1) == (
            format_named(name).framed
        )
    assert declared == {
        "native": {"numbered"},
        "sdatalog": set(),
        "tmsg": set(),
        "tmsg-sensortile": set(),
        "datalog": {"polled"},
        "datalog11": {"polled"},
        "text": {"tabular"},
    }
