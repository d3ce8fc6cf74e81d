"""The compiled reader says exactly what the plain one says."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.samples import AXES, Block, Event, StreamInfo, Ticks
from allanscope.wire.native import NativeDecoder, NativeEncoder
from allanscope.wire.native.framing import Deframer, cobs_decode, cobs_encode, pack_frame
from allanscope.wire.native.table import batch_table

Check = Callable[[list[Event], list[Event]], None]
INFO = StreamInfo(AXES, (8.75e-3,) * 3 + (6.1e-5,) * 3, 416.0, "LSM6DSM", epoch=9)


def _stream() -> bytes:
    rng = np.random.default_rng(5)
    encoder = NativeEncoder()
    wire = encoder.describe(INFO)
    index = 0
    for turn in range(12):
        size = int(rng.integers(1, 60))
        counts = rng.integers(-32768, 32768, (size, 6)) if turn % 2 else np.zeros((size, 6), int)
        wire += encoder.encode(Block(index, counts.astype(np.int16), Ticks.none()))
        index += size + (turn % 5 == 0) * 7
        wire += (b"", encoder.status(index, index, 0, 1.0), encoder.describe(INFO))[turn % 3]
    return wire


STREAM = _stream()


def _like_data(n: int, samples: int) -> bytes:
    """Return a sound frame that may or may not be as long as it says."""
    frame = struct.pack("<BBHHBBIQIh", 1, 0x10, 0, 9, 3, n, 0, 0, 0, 0) + bytes(12 * samples)
    return cobs_encode((frame + crc32(frame).to_bytes(4, "little"))[:246]) + b"\0"


def _both(data: bytes, cuts: list[int], check: Check) -> None:
    """Feed both readers the same pieces; they must agree after each one, in every respect."""
    plain, batch = NativeDecoder(batch=False), NativeDecoder(batch=True)
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    for number, (start, end) in enumerate(pairwise(places)):
        check(plain.feed(data[start:end], number), batch.feed(data[start:end], number))
        assert plain.stats == batch.stats
    check(plain.finish(), batch.finish())


def test_the_checksum_of_a_frame_of_any_length_is_that_of_zlib() -> None:
    """A frame of each length counts as sound; with a bit turned it does not."""
    rng = np.random.default_rng(3)
    for size in range(8, 240):
        frame = b"\x07\x10" + rng.bytes(size - 2)
        sealed = frame + crc32(frame).to_bytes(4, "little")
        turned = bytearray(sealed)
        turned[int(rng.integers(size))] ^= 1 << int(rng.integers(8))
        reader = Deframer()
        table = batch_table(
            reader, cobs_encode(sealed) + b"\0" + cobs_encode(bytes(turned)) + b"\0"
        )
        assert [other.frame for other in table.others] == [frame]
        assert (reader.crc_errors, reader.malformed) == (1, 0)


@settings(max_examples=60, deadline=None)
@given(cuts=st.lists(st.integers(0, len(STREAM)), max_size=30))
def test_both_readers_agree_however_a_stream_is_cut(cuts: list[int], assert_same: Check) -> None:
    _both(STREAM, cuts, assert_same)


@settings(max_examples=80, deadline=None)
@given(
    faults=st.lists(
        st.tuples(st.integers(0, len(STREAM) - 1), st.binary(max_size=4), st.integers(0, 40)),
        min_size=1,
        max_size=10,
    ),
    cuts=st.lists(st.integers(0, len(STREAM)), max_size=5),
)
def test_both_readers_agree_on_a_damaged_stream(
    faults: list[tuple[int, bytes, int]], cuts: list[int], assert_same: Check
) -> None:
    stream = bytearray(STREAM)
    for place, new, cut in faults:
        stream[place : place + cut] = new
    _both(bytes(stream), cuts, assert_same)


@settings(max_examples=150, deadline=None)
@given(
    chunks=st.lists(
        st.one_of(
            st.binary(max_size=30),
            st.binary(min_size=240, max_size=256).map(lambda b: b.replace(b"\0", b"\1")),
            st.binary(min_size=8, max_size=242).map(
                lambda b: cobs_encode(b + crc32(b).to_bytes(4, "little")) + b"\0"
            ),
            st.builds(_like_data, st.integers(0, 20), st.integers(0, 20)),
            st.just(b"\0"),
        ),
        max_size=12,
    ),
    cuts=st.lists(st.integers(0, 3000), max_size=6),
)
def test_both_readers_agree_on_arbitrary_bytes_and_sealed_frames(
    chunks: list[bytes], cuts: list[int], assert_same: Check
) -> None:
    _both(b"".join(chunks), cuts, assert_same)


def test_a_chunk_too_long_for_a_frame_is_dropped_once_in_both_readers(assert_same: Check) -> None:
    wire = b"\1" * 1000 + b"\0" + STREAM
    _both(wire, [100, 247, 248, 249, 500], assert_same)
    decoder = NativeDecoder(batch=True)
    decoder.feed(wire, 0.0)
    assert decoder.stats.resyncs == 1
    assert decoder.stats.crc_errors == 0


def test_a_frame_sent_without_stuffing_is_no_frame_in_either_reader(assert_same: Check) -> None:
    """Its first distance leads past the zeros inside, to its end and a right CRC."""
    frame = bytes([0x04, 0x10, 0, 0, 0, 0, 0, 9]) + bytes(9)
    frame += crc32(frame).to_bytes(4, "little")
    wire = bytes([len(frame) + 1]) + frame + b"\0"
    _both(wire, [], assert_same)
    assert NativeDecoder(batch=True).feed(wire, 0.0) == []


@pytest.mark.parametrize("joining", [True, False])
def test_the_tail_of_a_frame_at_the_start_is_no_crc_error(joining: bool) -> None:
    for batch, step in ((True, 20), (True, 7), (False, 20), (False, 7)):
        decoder = NativeDecoder(batch=batch)
        tail = STREAM[-20:] if joining else pack_frame(4, 0, 0, bytes(20)) + STREAM[-20:]
        for start in range(0, len(tail), step):
            decoder.feed(tail[start : start + step], 0.0)
        assert decoder.stats.crc_errors == (not joining)
        assert decoder.stats.resyncs == joining


def test_a_long_buffer_is_read_in_slices_without_a_seam(assert_same: Check) -> None:
    encoder = NativeEncoder()
    counts = np.random.default_rng(2).normal(0, 9, (200_000, 6)).astype(np.int16)
    wire = encoder.describe(replace(INFO, nominal_hz=6660.0))
    wire += encoder.encode(Block(0, counts, Ticks.none()))
    assert len(wire) > 2 << 20
    decoder = NativeDecoder(batch=True)
    blocks = [event for event in decoder.feed(wire, 0.0) if isinstance(event, Block)]
    np.testing.assert_array_equal(np.concatenate([block.counts for block in blocks]), counts)
    assert decoder.stats.lost_samples == 0


def test_each_frame_has_the_time_of_the_chunk_that_completed_it(assert_same: Check) -> None:
    ends = np.array([0, 150, 151, 400, 401, len(STREAM)])
    times = np.array([0.5, 1.0, 2.0, 3.0, 4.0, 5.0])
    one_by_one = NativeDecoder(batch=False)
    expected: list[float] = []
    for start, end, time in zip([0, *ends[:-1]], ends, times, strict=True):
        for event in one_by_one.feed(STREAM[start:end], time):
            expected += event.ticks.host_s.tolist() if isinstance(event, Block) else []
    for batch in (True, False):
        at_once = NativeDecoder(batch=batch).feed_chunks(STREAM, ends, times)
        blocks = [event for event in at_once if isinstance(event, Block)]
        assert np.concatenate([block.ticks.host_s for block in blocks]).tolist() == expected


def test_unstuffing_undoes_stuffing_for_every_length_of_run() -> None:
    for size in range(1, 247):
        for frame in (bytes(size), b"\1" * size, b"\1" * (size - 1) + b"\0"):
            assert cobs_decode(cobs_encode(frame)) == frame
            assert len(cobs_encode(frame)) == size + 1


def test_a_distance_of_zero_ends_nothing() -> None:
    assert cobs_decode(b"\x01\x00") is None
    assert cobs_decode(b"") is None


@pytest.mark.parametrize("batch", [True, False])
def test_a_sound_frame_that_is_too_long_is_no_frame(batch: bool) -> None:
    for size, sound in ((242, True), (243, False)):
        frame = bytes([4, 0x10, 0, 0, 0, 0, 0, size - 8]) + b"\1" * (size - 8)
        wire = cobs_encode(frame + crc32(frame).to_bytes(4, "little")) + b"\0"
        decoder = NativeDecoder(batch=batch)
        assert bool(decoder.feed(wire, 0.0)) == sound
        assert decoder.stats.resyncs == (not sound)


def test_a_frame_too_long_to_send_is_refused() -> None:
    assert len(pack_frame(4, 0, 0, bytes(234))) == 248
    with pytest.raises(ValueError, match="234 fit"):
        pack_frame(4, 0, 0, bytes(235))


def test_plain_frames_end_where_their_zero_is() -> None:
    frames = list(Deframer().feed(STREAM))
    assert all(STREAM[end - 1] == 0 for _, end in frames)
    assert sum(1 for _ in frames) == STREAM.count(b"\0") - STREAM.count(b"\0\0") - 1
