"""Whatever is damaged or dropped, the native format tells how much, to the sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.samples import Block, Event, Gap, Notice, StreamInfo, Ticks
from allanscope.wire import Command
from allanscope.wire.native import Flag, NativeDecoder, NativeEncoder
from allanscope.wire.native.framing import cobs_decode
from allanscope.wire.native.layout import float32, pack_entries

Noise = Callable[..., Block]
Wire = Callable[..., bytes]


def _frames(imu: StreamInfo, noise: Noise, samples: int = 900) -> list[bytes]:
    """Return a descriptor and data frames of nine samples, with a status after each ten."""
    encoder = NativeEncoder()
    frames = [encoder.describe(imu)]
    block = noise(samples)
    for start in range(0, samples, 90):
        part = Block(start, block.counts[start : start + 90], Ticks.none())
        frames += [frame + b"\0" for frame in encoder.encode(part).split(b"\0")[:-1]]
        frames.append(encoder.status(start + 90, start + 90, 0, start / 416.0))
    return frames


def _span(events: list[Event]) -> int:
    """Count the samples that the encoder put in between the first delivered one and the last."""
    blocks = [event for event in events if isinstance(event, Block)]
    return blocks[-1].index + len(blocks[-1]) - blocks[0].index if blocks else 0


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_kind_of_damage_is_accounted_to_the_sample(
    data: st.DataObject, imu_frames: list[bytes], accounted: Callable[..., None]
) -> None:
    stream = bytearray(b"".join(imu_frames))
    first = len(imu_frames[0])
    for _ in range(data.draw(st.integers(1, 12))):
        place = data.draw(st.integers(first, len(stream) - 1))
        fault = data.draw(st.sampled_from(["flip", "drop", "insert", "lose", "noise"]))
        size = data.draw(st.sampled_from([1, 7, 64, 300]))
        if fault == "flip":
            stream[place] ^= 1 << data.draw(st.integers(0, 7))
        elif fault == "drop":
            del stream[place]
        elif fault == "insert":
            stream.insert(place, data.draw(st.integers(0, 255)))
        elif fault == "lose":
            del stream[place : place + size]
        elif fault == "noise":
            stream[place:place] = data.draw(st.binary(min_size=size, max_size=size))
    decoder = NativeDecoder(batch=False)
    events = decoder.feed(bytes(stream), 0.0) + decoder.finish()
    accounted(decoder, events, _span(events))
    assert all(gap.reason == "link" for gap in events if isinstance(gap, Gap))
    original = NativeDecoder(batch=False).feed(b"".join(imu_frames), 0.0)
    whole = np.concatenate([event.counts for event in original if isinstance(event, Block)])
    for event in events:
        if isinstance(event, Block):
            expected = whole[event.index : event.index + len(event)]
            np.testing.assert_array_equal(event.counts, expected)


@pytest.fixture(scope="module")
def imu_frames() -> list[bytes]:
    info = StreamInfo(
        ("gx", "gy", "gz", "ax", "ay", "az"), (8.75e-3,) * 3 + (6.1e-5,) * 3, 416.0, epoch=5
    )
    rng = np.random.default_rng(3)

    def noise(samples: int) -> Block:
        return Block(0, rng.normal(0, 20, (samples, 6)).astype(np.int16), Ticks.none())

    return _frames(info, noise)


@pytest.mark.parametrize("lost", [(5,), (5, 6, 7), (11,), (11, 12), (3, 4, 20, 21, 50)])
def test_frames_lost_on_the_link_are_link_losses(
    lost: tuple[int, ...], imu_frames: list[bytes], accounted: Callable[..., None]
) -> None:
    kept = [frame for i, frame in enumerate(imu_frames) if i not in lost]
    decoder = NativeDecoder()
    events = decoder.feed(b"".join(kept), 0.0)
    accounted(decoder, events, 900)
    data_frames = [i for i in lost if i % 11]
    assert sum(gap.lost or 0 for gap in events if isinstance(gap, Gap)) == 9 * len(data_frames)
    assert {gap.reason for gap in events if isinstance(gap, Gap)} <= {"link"}


@pytest.mark.parametrize(("flag", "reason"), [(0, "device"), (Flag.SENSOR_OVERRUN, "sensor")])
def test_samples_never_sent_are_losses_of_the_device_or_the_sensor(
    flag: int, reason: str, imu: StreamInfo, noise: Noise, accounted: Callable[..., None]
) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(imu) + encoder.encode(noise(90))
    encoder.flags = Flag(flag)
    wire += encoder.encode(noise(90, index=137))
    events = decoder.feed(wire, 0.0)
    assert [event for event in events if isinstance(event, Gap)] == [Gap(reason, 47)]  # type: ignore[arg-type]
    accounted(decoder, events, 227)


def test_the_index_goes_on_after_two_to_the_32(imu: StreamInfo, noise: Noise) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    start = 2**32 - 50
    wire = encoder.describe(imu) + encoder.encode(noise(90, index=start))
    wire += encoder.encode(noise(90, index=start + 100))
    blocks = [event for event in decoder.feed(wire, 0.0) if isinstance(event, Block)]
    assert [block.index for block in blocks] == [start, start + 100]
    assert decoder.stats.lost_samples == 10


def test_the_sequence_number_goes_on_after_two_to_the_16(imu: StreamInfo, noise: Noise) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(replace(imu, nominal_hz=26.0)) + encoder.encode(noise(70_000))
    kinds = {type(event) for event in decoder.feed(wire, 0.0)}
    assert kinds == {StreamInfo, Block}
    assert decoder.stats.samples == 70_000


def test_a_hole_at_the_turn_of_the_sequence_number_is_still_the_devices(
    imu: StreamInfo, noise: Noise
) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(replace(imu, nominal_hz=26.0)) + encoder.encode(noise(65_535))
    decoder.feed(wire, 0.0)
    gap, block = decoder.feed(encoder.encode(noise(1, index=65_540)), 0.0)  # sequence number 0
    assert gap == Gap("device", 5)
    assert isinstance(block, Block)


def test_a_new_epoch_starts_over_with_a_gap_of_unknown_length(
    imu: StreamInfo, noise: Noise
) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(imu) + encoder.encode(noise(90))
    coarse = replace(imu, epoch=imu.epoch + 1, scale=(17.5e-3,) * 3 + imu.scale[3:])
    wire += encoder.describe(coarse) + encoder.encode(noise(90))
    _, before, info, gap, after = decoder.feed(wire, 0.0)
    assert isinstance(info, StreamInfo)
    assert info.scale[0] == 17.5e-3
    assert gap == Gap("restarted", None)
    assert isinstance(before, Block)
    assert isinstance(after, Block)
    assert after.index == 0
    assert decoder.stats.unknown_losses == 1


def test_a_repeated_descriptor_says_nothing_new(imu: StreamInfo, noise: Noise) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(imu) + encoder.encode(noise(90)) + encoder.describe(imu)
    kinds = [type(event) for event in decoder.feed(wire, 0.0)]
    assert kinds == [StreamInfo, Block]


def test_data_without_a_descriptor_waits_for_it(imu: StreamInfo, noise: Noise) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    descriptor = encoder.describe(imu)
    events = decoder.feed(encoder.encode(noise(180)), 0.0)
    assert [type(event) for event in events] == [Notice]
    assert events[0].fields["wanted"] == "descriptor"  # type: ignore[union-attr]
    assert decoder.stats.samples == 0
    info, *blocks = decoder.feed(descriptor, 0.0)
    assert isinstance(info, StreamInfo)
    assert decoder.stats.samples == 180
    assert all(isinstance(block, Block) for block in blocks)


def test_the_wish_for_a_descriptor_is_repeated(imu: StreamInfo, noise: Noise) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    encoder.describe(imu)
    events = decoder.feed(encoder.encode(noise(9 * 200)), 0.0)
    assert len(events) == 4


def test_data_of_another_epoch_is_never_scaled_by_the_old_descriptor(
    imu: StreamInfo, noise: Noise
) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(imu) + encoder.encode(noise(90))
    lost_descriptor = encoder.describe(replace(imu, epoch=77))
    wire += encoder.encode(noise(90))
    events = decoder.feed(wire, 0.0) + decoder.finish()
    assert decoder.stats.samples == 90
    assert events[-1] == Notice(
        "error",
        "90 samples were dropped: the stream has no descriptor of its counts",
        {"samples": 90},
    )
    assert lost_descriptor


def test_what_waits_for_a_descriptor_is_bounded(imu: StreamInfo, noise: Noise) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    descriptor = encoder.describe(imu)
    for second in range(40):
        decoder.feed(encoder.encode(noise(416, index=416 * second)), 0.0)
    blocks = [event for event in decoder.feed(descriptor, 0.0) if isinstance(event, Block)]
    delivered = sum(len(block) for block in blocks)
    assert 1000 * 8 < delivered <= 1024 * 9
    assert blocks[-1].index + len(blocks[-1]) == 416 * 40
    assert decoder.stats.lost_samples == 0


@pytest.mark.parametrize("missing", [0, 30])
def test_after_an_interruption_the_index_still_tells_the_loss(
    missing: int, imu: StreamInfo, noise: Noise
) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    decoder.feed(encoder.describe(imu) + encoder.encode(noise(90))[:-5], 0.0)
    decoder.interrupt("disconnected")
    events = decoder.feed(encoder.encode(noise(90, index=90 + missing)), 0.0)
    assert events[0] == Gap("disconnected", 9 + missing)


def test_a_frame_whose_channels_contradict_the_descriptor_is_lost(
    imu: StreamInfo, noise: Noise, accounted: Callable[..., None]
) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(imu) + encoder.encode(noise(90))
    encoder.describe(replace(imu, axes=("gx", "gy", "gz"), scale=imu.scale[:3]))
    wire += encoder.encode(noise(9, index=90, axes=3))
    encoder.describe(imu)
    wire += encoder.encode(noise(90, index=99))
    events = decoder.feed(wire, 0.0)
    accounted(decoder, events, 189)
    assert decoder.stats.lost_samples == 9


def test_only_the_axes_of_the_descriptor_are_delivered(imu: StreamInfo, noise: Noise) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    gyro = replace(imu, axes=("gx", "gy", "gz"), scale=imu.scale[:3])
    sent = noise(90, axes=3)
    info, block = decoder.feed(encoder.describe(gyro) + encoder.encode(sent), 0.0)
    assert isinstance(info, StreamInfo)
    assert isinstance(block, Block)
    assert info.axes == ("gx", "gy", "gz")
    np.testing.assert_array_equal(block.counts, sent.counts)


def test_another_major_version_is_refused_once(data_frame: Wire) -> None:
    wire = b"".join(data_frame(seq, 4 * seq, version=0x20) for seq in range(3))
    for batch in (True, False):
        decoder = NativeDecoder(batch=batch)
        events = decoder.feed(wire, 0.0)
        assert len(events) == 1
        assert "version 2.0" in events[0].text  # type: ignore[union-attr]
        assert decoder.stats.unknown == 3


def test_an_epoch_that_changes_without_a_descriptor_is_not_joined_to_the_old_one(
    imu: StreamInfo, data_frame: Wire
) -> None:
    decoder = NativeDecoder()
    decoder.feed(NativeEncoder().describe(imu), 0.0)
    events = decoder.feed(data_frame(1, 0) + data_frame(2, 4, epoch=7) + data_frame(3, 8), 0.0)
    assert [type(event) for event in events] == [Block, Notice, Gap, Block]
    assert events[2] == Gap("device", 4)


def test_a_frame_of_half_the_sensors_breaks_the_run(imu: StreamInfo, data_frame: Wire) -> None:
    decoder = NativeDecoder()
    decoder.feed(NativeEncoder().describe(imu), 0.0)
    events = decoder.feed(data_frame(1, 0) + data_frame(2, 4, flags=1) + data_frame(3, 8), 0.0)
    assert [type(event) for event in events] == [Block, Gap, Block]


def test_other_frames_count_in_the_sequence_so_that_a_drop_is_still_the_devices(
    imu: StreamInfo, noise: Noise
) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(imu) + encoder.encode(noise(9))
    wire += encoder.reply(Command("ping", 1, {"type": 0x85})) + encoder.event("hot", 1.0)
    wire += encoder.status(1, 1, 0, 1.0) + encoder.encode(noise(9, index=20))
    gaps = [event for event in decoder.feed(wire, 0.0) if isinstance(event, Gap)]
    assert gaps == [Gap("device", 11)]


@pytest.mark.parametrize("kind", [3, 4, 6, 5, 0x7F, 0x81])
def test_a_frame_of_a_wrong_length_or_type_is_counted_and_skipped(kind: int, sealed: Wire) -> None:
    decoder = NativeDecoder()
    assert decoder.feed(sealed(bytes(32), kind, seq=0, n=31), 0.0) == []
    assert decoder.stats.unknown == 1


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"\x01",  # no sensitivity
        b"\x02" + pack_entries([(6, float32(0.1)), (8, float32(0.1))]),  # another version
        b"\x01" + pack_entries([(6, float32(0.1)), (8, float32(0.0))]),
        b"\x01" + pack_entries([(6, float32(0.1)), (8, float32(float("inf")))]),
        b"\x01" + pack_entries([(6, float32(0.1)), (8, float32(0.1)), (12, b"\0")]),
        b"\x01" + pack_entries([(6, float32(0.1)), (8, float32(0.1))])[:-1],
        b"\x01" + pack_entries([(6, float32(0.1)), (8, float32(0.1))]) + b"\x09",
        b"\x01" + pack_entries([(6, float32(0.1)), (8, float32(0.1))]) + b"\x11\x05abc",
    ],
)
def test_a_descriptor_that_says_too_little_is_refused(body: bytes, sealed: Wire) -> None:
    decoder = NativeDecoder()
    events = decoder.feed(sealed(body, 2, seq=0, n=len(body)), 0.0)
    assert [event.kind for event in events] == ["error"]  # type: ignore[union-attr]
    assert decoder.stats.unknown == 1


def test_an_index_that_starts_ahead_in_a_new_epoch_is_no_known_loss(
    imu: StreamInfo, noise: Noise
) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    wire = encoder.describe(imu) + encoder.encode(noise(90))
    wire += encoder.describe(replace(imu, epoch=9)) + encoder.encode(noise(90, index=500))
    gaps = [event for event in decoder.feed(wire, 0.0) if isinstance(event, Gap)]
    assert gaps == [Gap("restarted", None)]


def test_frames_that_waited_before_an_unplug_are_forgotten(imu: StreamInfo, noise: Noise) -> None:
    encoder, decoder = NativeEncoder(), NativeDecoder()
    descriptor = encoder.describe(imu)
    decoder.feed(encoder.encode(noise(90)), 0.0)
    decoder.interrupt("disconnected")
    assert [type(event) for event in decoder.feed(descriptor, 0.0)] == [StreamInfo]


def test_only_frames_of_the_described_epoch_are_released(imu: StreamInfo, data_frame: Wire) -> None:
    decoder = NativeDecoder()
    decoder.feed(data_frame(1, 0, epoch=7) + data_frame(2, 0), 0.0)
    events = decoder.feed(NativeEncoder().describe(imu), 0.0)
    assert [type(event) for event in events] == [StreamInfo, Block]
    assert decoder.stats.samples == 4


def test_saturation_is_said_once_until_it_ends(imu: StreamInfo, noise: Noise) -> None:
    encoder = NativeEncoder()
    wire = [encoder.describe(imu)]
    for turn, end in enumerate((0, 32767, -32768, 0, 32767)):
        block = noise(9, index=9 * turn)
        block.counts[3, 1] = end
        wire.append(encoder.encode(block))
    for pieces in (wire, [b"".join(wire)]):
        decoder = NativeDecoder()
        events = [event for piece in pieces for event in decoder.feed(piece, 0.0)]
        said = [event.text for event in events if isinstance(event, Notice)]
        assert said[0] == "the gyroscope is at the end of its range"
        assert len(said) == (2 if len(pieces) > 1 else 1)


@pytest.mark.parametrize("missing", [0, 5])
def test_the_device_says_that_it_dropped_samples(
    missing: int, imu: StreamInfo, noise: Noise
) -> None:
    encoder = NativeEncoder()
    encoder.describe(imu)
    encoder.encode(noise(9))
    frame = cobs_decode(encoder.encode(noise(9, index=9 + missing))[:-1])
    assert frame is not None
    assert bool(frame[6] & Flag.DROPPED_BEFORE) == bool(missing)


def test_a_command_of_another_major_version_is_unknown(sealed: Wire) -> None:
    command = NativeEncoder().receive(sealed(b"", 0x81, seq=3, n=0, version=0x20))[0]
    assert (command.name, command.sequence) == ("unknown", 3)


def test_without_a_clock_the_time_of_the_sensor_is_taken_and_unwrapped(
    sealed: Wire, data_frame: Wire
) -> None:
    entries = [(6, float32(0.1)), (8, float32(0.1)), (13, b"\0")]
    body = b"\x01" + pack_entries([*entries, (11, (100_000).to_bytes(4, "little"))])
    wire = sealed(body, 2, seq=0, n=len(body))
    ticks = (2**32 - 20, 2**32 - 10, 2**32 - 1, 5, 15)
    wire += b"".join(data_frame(1 + i, 4 * i, ticks=t, mcu_us=9) for i, t in enumerate(ticks))
    info, block = NativeDecoder().feed(wire, 0.0)
    assert isinstance(info, StreamInfo)
    assert isinstance(block, Block)
    assert not info.device_clock
    assert info.time_resolution_s == pytest.approx(1e-4)
    none = block.ticks.device_s[2]  # 0xFFFFFFFF means that there is none
    assert np.isnan(none)
    seconds = block.ticks.device_s[[0, 1, 3, 4]]
    assert seconds == pytest.approx(1e-4 * (2**32 + np.array([-20, -10, 5, 15])))
