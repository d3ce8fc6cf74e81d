"""ST's SDATALOG link: bytes, the conversation with a board at a pseudo-terminal, and losses."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from allanscope.pipeline import Decoding
from allanscope.samples import AXES, Block, Event, Gap, Notice, StreamInfo
from allanscope.sources import SerialSource
from allanscope.wire import WireSettings, answers, format_named, sniff
from allanscope.wire.sdatalog import packets
from allanscope.wire.sdatalog.packets import Unpacker
from support.pty_device import PATIENCE, Device
from support.sdatalog_board import ACCEL, GYRO, Board, header, packet, sample

STATUS = {
    "devices": [
        {
            "sn": "0123",
            "components": [
                {
                    "ism330is_gyro": {
                        "enable": True,
                        "odr": 4,
                        "sensitivity": 0.07,
                        "data_type": "int16",
                        "stream_id": 3,
                        "samples_per_ts": 50,
                        "measured_odr": 208.0,
                    }
                },
                {"log_controller": {"log_status": True}},
            ],
        }
    ]
}


def response(said: object, kind: int = 0xA) -> bytes:
    return packet(kind, 0x140, json.dumps(said).encode() + b"\0")


def test_packets_are_those_that_sts_host_and_board_send() -> None:
    """Made by hand from the drawings of ST's documentation and its CRC table."""
    assert packets.beacon() == bytes.fromhex("05ffff0f")
    assert packets.ping() == bytes.fromhex("06000060")
    assert packets.request("{}") == bytes.fromhex("79000e00 20010000 7b7d00")
    assert packets.request() == bytes.fromhex("49000ef0 40010000")
    data = bytes.fromhex("29010ed0 80030000 000000000000e03f 0100feff0300")
    (found,) = Unpacker().feed(data)
    assert found is not None
    assert (found.kind, found.channel, found.last, found.number) == (packets.CUSTOM, 1, True, 0)
    assert struct.unpack("<d3h", found.content) == (0.5, 1, -2, 3)
    assert data == sample(1, 0.5, (1, -2, 3))


@pytest.mark.parametrize("bit", range(32))
def test_a_header_with_a_wrong_bit_is_no_header(bit: int) -> None:
    data = sample(1, 0.5, (1, -2, 3))
    damaged = (int.from_bytes(data[:4], "little") ^ 1 << bit).to_bytes(4, "little") + data[4:]
    found = list(Unpacker().feed(damaged + data + data))
    assert len([one for one in found if one is not None]) == 2


@pytest.fixture
def device(tmp_path: Path):
    made = Device(tmp_path / "ttyBoard")
    yield made
    made.unplug()


def conversed(device: Device, board: Board, settings: WireSettings, wanted: int) -> list[Event]:
    """Read the port as a live session does until so many samples came; then stop the board."""
    source = SerialSource(str(device.path))
    decoding = Decoding(settings, write=source.write)
    events: list[Event] = []
    for _ in range(PATIENCE):
        events += decoding.feed(source.read())
        if sum(len(one) for one in events if isinstance(one, Block)) >= wanted:
            break
    decoding.stop_device()
    assert board.stopped.wait(20.0)
    source.close()
    return events + decoding.finish()


def test_a_silent_board_is_found_configured_started_read_and_stopped(device: Device) -> None:
    lost = {100, 101, 250}
    board = Board(device, 400, lost)
    settings = WireSettings(rate_hz=240.0, gyro_fs=500.0, accel_fs=2.0)
    events = conversed(device, board, settings, 370)
    assert not board.wedged
    assert board.overruns == 0
    asked = board.asked
    assert asked[0] == {"get_status": "all"}
    assert {"lsm6dsv16x_mlc": {"enable": False}} in asked
    for name, place in ((GYRO, 2), (ACCEL, 0)):
        for setting in ({"odr": 5}, {"fs": place}, {"enable": True}):
            assert {name: setting} in asked
    assert asked[-3:] == [
        {"get_status": "all"},
        {"log_controller*start_log": {"interface": 3}},
        {"log_controller*stop_log": ""},
    ]
    info = next(one for one in events if isinstance(one, StreamInfo))
    assert info.axes == AXES
    assert info.scale == (0.0175,) * 3 + (0.000061,) * 3
    assert (info.nominal_hz, info.part, info.wire) == (240.0, "LSM6DSV16X", "sdatalog")
    assert info.details["unique_id"] == "0123"
    assert [one for one in events if isinstance(one, Gap)] == [Gap("device", 2), Gap("device", 1)]
    counts = np.concatenate([one.counts for one in events if isinstance(one, Block)])
    kept = [i for i in range(400) if i not in lost][: len(counts)]
    assert counts[:, 0].tolist() == [i % 1000 for i in kept]
    assert set(counts[:, 5].tolist()) == {16384}


def test_a_board_that_streams_already_is_asked_what_it_sends() -> None:
    decoder = format_named("sdatalog").decoder(WireSettings())
    data = b"".join(sample(3, i / 208.0, (i, 0, 0)) for i in range(5))
    assert sniff(data).name == "sdatalog"
    events = decoder.feed(data, 0.0)
    (notice,) = events
    assert isinstance(notice, Notice)
    assert notice.fields["wanted"] == "descriptor"
    (asked,) = answers(decoder)
    assert b"get_status" in asked
    assert answers(decoder) == []
    decoder.feed(response(STATUS), 0.0)
    assert answers(decoder) == []  # it is streaming: nothing is set, nothing started
    data = b"".join(sample(3, i / 208.0, (i, 0, 0)) for i in range(5, 60))
    events = decoder.feed(data, 0.0) + decoder.finish()
    info = next(one for one in events if isinstance(one, StreamInfo))
    assert (info.axes, info.scale[0], info.nominal_hz) == (AXES[:3], 0.07, 208.0)
    assert sum(len(one) for one in events if isinstance(one, Block)) == 55


def test_a_board_answers_behind_half_a_packet_that_it_sent_before() -> None:
    answer = header(5 | 63 << 8 | 127 << 14 | 127 << 21)
    assert sniff(sample(1, 0.5, (1, -2, 3))[:12] + answer).name == "sdatalog"
    decoder = format_named("sdatalog").decoder(WireSettings())
    decoder.feed(sample(1, 0.5, (1, -2, 3))[:12] + answer, 0.0)
    assert answers(decoder) == [packets.ping()]


def test_halves_of_a_sample_are_paired_by_their_times(fed: Callable[..., list[Event]]) -> None:
    """Where one half is lost the other is given up, and the next sample has its own two halves."""
    decoder = format_named("sdatalog").decoder(WireSettings())
    status = json.loads(json.dumps(STATUS))
    one = status["devices"][0]["components"][0]["ism330is_gyro"]
    status["devices"][0]["components"].append({"ism330is_acc": {**one, "stream_id": 4}})
    data = response(status)
    for i in range(100):
        data += sample(4, i / 208.0, (i, 1, 1)) if i != 60 else b""
        data += sample(3, i / 208.0 + 2e-4, (i, 2, 2)) if i != 80 else b""
    events = fed(decoder, data)
    counts = np.concatenate([e.counts for e in events if isinstance(e, Block)])
    assert (counts[:, 0] == counts[:, 3]).all()
    assert [e for e in events if isinstance(e, Gap)] == [Gap("device", 1), Gap("device", 1)]


def _binary(rows: int = 50, frames: int = 24, size: int = 200) -> list[bytes]:
    """Return packets of HSDatalog's binary data: a counter up to their end, a piece of frames."""
    stream = b""
    for frame in range(frames):
        counts = np.arange(frame * rows, (frame + 1) * rows, dtype="<i2")
        last_s = ((frame + 1) * rows - 1) / 208.0
        stream += np.repeat(counts[:, None], 3, axis=1).tobytes() + struct.pack("<d", last_s)
    pieces = [stream[at : at + size] for at in range(0, len(stream), size)]
    ends = np.cumsum([len(piece) for piece in pieces]).tolist()
    inner = 0x100 | 3 << 9
    return [
        packet(0x9, inner, struct.pack("<I", end) + piece)
        for end, piece in zip(ends, pieces, strict=True)
    ]


@pytest.mark.parametrize("missing", [None, 23])
def test_binary_data_of_hsdatalog_are_read_and_lost_packets_counted(
    missing: int | None, fed: Callable[..., list[Event]]
) -> None:
    data = [piece for i, piece in enumerate(_binary()) if i != missing]
    decoder = format_named("sdatalog").decoder(WireSettings())
    events = fed(decoder, response(STATUS) + b"".join(data))
    counts = np.concatenate([e.counts for e in events if isinstance(e, Block)])[:, 0].tolist()
    gaps = [e for e in events if isinstance(e, Gap)]
    if missing is None:
        assert counts == list(range(1200))
        assert gaps == []
    else:  # this packet has the end of one frame and the beginning of the next
        assert counts == [*range(700), *range(800, 1200)]
        assert gaps == [Gap("device", 100)]


def test_a_refusal_is_answered_with_the_same_again_a_few_times() -> None:
    decoder = format_named("sdatalog").decoder(WireSettings())
    decoder.feed(header(5 | 63 << 8 | 127 << 14 | 127 << 21), 0.0)
    assert answers(decoder) == [packets.ping()]
    refusal = header(0xF | 4 << 8 | 4 << 16)
    again = []
    for _ in range(10):
        decoder.feed(refusal, 0.0)
        again += answers(decoder)
    assert set(again) == {packets.ping()}
    assert len(again) == 3


def test_a_board_with_less_memory_is_asked_for_no_more() -> None:
    decoder = format_named("sdatalog").decoder(WireSettings())
    small = header(5 | 15 << 8 | 31 << 14 | 63 << 21)
    decoder.feed(small, 0.0)
    (again,) = answers(decoder)
    assert again == small
    decoder.feed(small, 0.0)
    assert answers(decoder)[-1] == packets.ping()


@pytest.mark.parametrize(
    "said",
    [
        {},
        {"devices": []},
        {"devices": [{"components": 5}]},
        {"devices": [{"components": [{"x_gyro": {"sensitivity": "a", "data_type": "int16"}}]}]},
        {"devices": [{"components": [{"x_gyro": {"sensitivity": 1e400, "stream_id": 1}}]}]},
        [[[[]]]],
    ],
)
def test_a_status_that_makes_no_sense_changes_nothing(said: object) -> None:
    decoder = format_named("sdatalog").decoder(WireSettings())
    decoder.feed(response(said), 0.0)
    assert answers(decoder) == []
