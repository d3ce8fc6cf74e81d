"""Whatever is damaged or dropped, the native format tells how much, to the sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.samples import Block, Event, Gap, Notice, StreamInfo, Ticks
from allanscope.wire.native import Flag, NativeDecoder, NativeEncoder

Noise = Callable[..., Block]


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
        "90 samples were dropped: the stream never said what its counts mean",
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


def test_another_major_version_is_refused_once(imu: StreamInfo) -> None:
    from zlib import crc32

    from allanscope.wire.native.framing import stuff

    frame = bytes([0x01, 0x20, 0, 0, 0, 0, 0, 0])
    wire = stuff(frame + crc32(frame).to_bytes(4, "little")) + b"\0"
    decoder = NativeDecoder()
    events = decoder.feed(3 * wire, 0.0)
    assert len(events) == 1
    assert "version 2.0" in events[0].text  # type: ignore[union-attr]
    assert decoder.stats.unknown == 3
