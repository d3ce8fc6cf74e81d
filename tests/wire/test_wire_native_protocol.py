"""The norm and the code say the same: every example of PROTOCOL.md is run."""

from __future__ import annotations

import json
import re
import struct
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from allanscope.samples import Block, Gap, Notice, StreamInfo, Ticks
from allanscope.wire import Command
from allanscope.wire.native import NativeDecoder, NativeEncoder
from allanscope.wire.native.framing import pack_frame

PROTOCOL = Path(__file__).parents[2] / "firmware_protocol" / "PROTOCOL.md"
TEXT = PROTOCOL.read_text(encoding="utf-8")


def _examples() -> dict[str, dict[str, str]]:
    found = {}
    for name, body in re.findall(r"^```example (\S+)\n(.*?)^```", TEXT, re.M | re.S):
        entry: dict[str, str] = {}
        key = ""
        for line in body.splitlines():
            key = line[:6].strip() or key
            entry[key] = (entry.get(key, "") + " " + line[6:]).strip()
        found[name] = entry
    return found


EXAMPLES = _examples()


def _crc32(data: bytes) -> int:
    """CRC-32 bit by bit, from the norm's own words."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def _cobs(frame: bytes) -> bytes:
    """COBS from the norm's own words: each zero becomes the distance to the next."""
    padded = bytearray(b"\0" + frame)
    zeros = [i for i, byte in enumerate(padded) if byte == 0] + [len(padded)]
    for here, there in pairwise(zeros):
        padded[here] = there - here
    return bytes(padded) + b"\0"


def _entry(tag: int, value: bytes) -> Any:
    floats = {0x05: 1, 0x06: 1, 0x07: 1, 0x08: 1, 0x09: 2, 0x0A: 1}
    if tag in floats:
        return [float(str(np.float32(x))) for x in struct.unpack(f"<{floats[tag]}f", value)]
    if tag in (0x01, 0x03):
        return value.decode()
    return int.from_bytes(value, "little") if tag == 0x0B else value.hex()


def _entries(body: bytes) -> dict[str, Any]:
    entries = {}
    while body:
        tag, size = body[0], body[1]
        entries[f"0x{tag:02x}"] = _entry(tag, body[2 : 2 + size])
        body = body[2 + size :]
    return entries


def _said(frame: bytes) -> dict[str, Any]:
    """Read a frame by the tables of the norm alone."""
    kind, version, seq, epoch, flags, n = struct.unpack_from("<BBHHBB", frame)
    body = frame[8:]
    assert version == 0x12
    assert kind == 1 or (n == len(body) and flags == 0)
    said: dict[str, Any] = {"type": kind, "seq": seq, "epoch": epoch}
    if kind == 0x01:
        index, mcu_time, sensor_time, temperature = struct.unpack_from("<IQIh", body)
        counts = np.frombuffer(body[18:], "<i2").reshape(n, 6).tolist()
        said |= {"flags": flags, "index": index, "mcu_time": mcu_time, "samples": counts}
        said |= {"sensor_time": sensor_time, "temperature": temperature}
    elif kind == 0x02:
        said |= {"version": body[0], "entries": _entries(body[1:])}
    elif kind == 0x03:
        names = ("produced", "sent", "dropped", "overruns", "commands", "bad_commands")
        said |= dict(zip(("mcu_time", *names), struct.unpack("<Q6I", body), strict=True))
    elif kind == 0x04:
        mcu_time, level = struct.unpack_from("<QB", body)
        said |= {"mcu_time": mcu_time, "level": level, "text": body[9:].decode()}
    elif kind == 0x06:
        sequence, command, result = struct.unpack_from("<HBB", body)
        said |= {"command_seq": sequence, "command": command, "result": result}
        if command == 0x85:
            said |= {"payload": body[4:-8].hex(), "mcu_time": int.from_bytes(body[-8:], "little")}
    elif kind == 0x84:
        said |= {"entries": _entries(body)}
    else:
        said |= {"body": body.hex()}
    return said


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 9


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_true_to_the_words_of_the_norm(name: str) -> None:
    example = EXAMPLES[name]
    wire, frame, crc = (bytes.fromhex(example[key]) for key in ("wire", "frame", "crc"))
    assert crc == _crc32(frame).to_bytes(4, "little")
    assert wire == _cobs(frame + crc)
    assert _said(frame) == json.loads(example["says"])


def _device(imu: StreamInfo, next_seq: int) -> NativeEncoder:
    """Return a simulated device whose next frame has a given sequence number."""
    encoder = NativeEncoder()
    encoder.describe(imu)
    for _ in range(next_seq - 1):
        encoder.status(0, 0, 0, 0.0)
    return encoder


def test_the_encoder_writes_the_examples(imu: StreamInfo) -> None:
    encoder = _device(imu, 40)
    wire = {name: bytes.fromhex(EXAMPLES[name]["wire"]) for name in EXAMPLES}
    start, settings = encoder.receive(b"garbage" + b"\0" + wire["start"] + wire["set-416Hz-250dps"])
    assert start.name == "start"
    assert encoder.reply(settings) == wire["reply-ok"]
    encoder.status(0, 0, 0, 0.0)  # in the place of the descriptor
    ticks = Ticks(np.array([0]), np.array([5.0]), np.array([np.nan]), np.array([25.0]))
    rows = np.array([[0, 1, -1, 32767, -32768, 256]], np.int16)
    assert encoder.encode(Block(0, rows, ticks)) == wire["data-one-sample"]
    encoder.status(0, 0, 0, 0.0)
    encoder.receive(wire["start"])
    assert encoder.status(416, 400, 16, 6.0) == wire["status"]
    assert encoder.event("FIFO nearly full", 6.1, level=1) == wire["event"]
    fields = {"payload": b"\x00\x01\x00", "type": 0x85, "uptime_s": 6.2}
    ping = Command("ping", 7, fields)
    assert encoder.reply(ping) == wire["reply-to-ping"]


def test_the_decoder_reads_the_examples_in_a_row() -> None:
    names = ("reply-ok", "descriptor", "data-one-sample", "data-after-a-drop", "status", "event")
    decoder = NativeDecoder()
    wire = b"".join(bytes.fromhex(EXAMPLES[name]["wire"]) for name in names)
    reply, info, remark, first, gap, second, status, event = decoder.feed(wire, 3.5)
    assert isinstance(remark, Notice)
    assert "accelerometer is at the end of its range" in remark.text
    assert reply == Notice("reply", "set: ok", {"sequence": 2, "command": 0x84, "result": 0})
    assert isinstance(info, StreamInfo)
    assert (info.part, info.nominal_hz, info.epoch) == ("LSM6DSM", 416.0, 0x1234)
    assert info.scale == (8.75e-3, 8.75e-3, 8.75e-3, 6.1e-5, 6.1e-5, 6.1e-5)
    assert info.details["registers"] == "10:60 11:60"
    assert info.details["firmware"] == "1.2.0 abc1234"
    assert (info.origin, info.details["clock"], info.device_clock) == ("measured", "crystal", True)
    assert isinstance(first, Block)
    assert first.counts.tolist() == [[0, 1, -1, 32767, -32768, 256]]
    assert first.ticks.device_s.tolist() == [5.0]
    assert first.ticks.temperature_c.tolist() == [25.0]
    assert first.ticks.host_s.tolist() == [3.5]
    assert gap == Gap("device", 18)
    assert isinstance(second, Block)
    assert second.index == 19
    assert np.isnan(second.ticks.temperature_c).all()
    assert isinstance(status, Notice)
    assert status.fields["dropped"] == 16
    assert isinstance(event, Notice)
    assert (event.kind, event.text) == ("text", "FIFO nearly full")


def test_the_device_understands_the_command_examples() -> None:
    encoder = NativeEncoder()
    wire = b"".join(bytes.fromhex(EXAMPLES[name]["wire"]) for name in ("start", "set-416Hz-250dps"))
    start, settings = encoder.receive(b"\0" + wire)
    assert (start.name, start.sequence) == ("start", 1)
    assert (settings.name, settings.sequence) == ("set", 2)
    assert settings.fields["rate_hz"] == 416.0
    assert settings.fields["gyro_fs"] == 250.0


def _loss_lines() -> list[str]:
    match = re.search(r"^```losses\n(.*?)^```", TEXT, re.M | re.S)
    assert match
    return match[1].splitlines()


def test_losses_are_told_as_the_norm_says() -> None:
    decoder = NativeDecoder()
    decoder.feed(bytes.fromhex(EXAMPLES["descriptor"]["wire"]), 0.0)
    for line in _loss_lines():
        facts, _, told = line.partition("->")
        seq = int(re.findall(r"seq (\d+)", facts)[0])
        if "status" in facts:
            wire = pack_frame(0x03, seq, 0x1234, bytes(32))
        else:
            index, n = (int(re.findall(rf"{key} (\d+)", facts)[0]) for key in ("index", "n"))
            flags = int(re.findall(r"flags (\w+)", facts)[0], 16)
            head = struct.pack("<BBHHBBIQIh", 1, 0x10, seq, 0x1234, flags, n, index, 0, 0, 0)
            frame = head + bytes(12 * n)
            wire = _cobs(frame + _crc32(frame).to_bytes(4, "little"))
        events = [e for e in decoder.feed(wire, 0.0) if isinstance(e, Block | Gap)]
        assert ", ".join(map(_told, events)) == told.strip(), line


def _told(event: Block | Gap) -> str:
    if isinstance(event, Gap):
        return f"lost {'unknown' if event.lost is None else event.lost} {event.reason}"
    return f"samples {event.index}..{event.index + len(event) - 1}"


def test_the_byte_budget_is_what_frames_of_that_size_cost() -> None:
    rows = re.findall(r"^\| ([\d.]+) \| (\d+) \| ([\d.]+) \| (\d+) \|$", TEXT, re.M)
    assert len(rows) == 10
    for rate, n, frames, size in rows:
        assert NativeEncoder().samples_per_frame(float(rate)) == int(n)
        assert float(frames) == pytest.approx(float(rate) / int(n), abs=0.06)
        assert int(size) == pytest.approx(float(rate) / int(n) * (32 + 12 * int(n)), abs=1)
