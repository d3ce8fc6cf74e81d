"""Frames without samples: what a device says (status, event, reply) and a host asks (commands)."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, cast

from allanscope.samples import AXES, Notice
from allanscope.sanitize import text_of
from allanscope.wire.base import Command, WireSettings
from allanscope.wire.native.framing import pack_frame
from allanscope.wire.native.layout import (
    HEADER_BYTES,
    VERSION_MAJOR,
    Flag,
    FrameType,
    Result,
    Tag,
    float32,
    pack_entries,
    read_float32,
    unpack_entries,
)

__all__ = [
    "EVENT_HEAD",
    "FLAGS",
    "REPLY_HEAD",
    "STATUS",
    "command_of",
    "notice_of",
    "request",
    "settings_body",
]

STATUS = struct.Struct("<Q6I")
"""MCU time in us, then produced, sent, dropped samples, FIFO overruns, commands good and bad."""
_STATUS_FIELDS = ("produced", "sent", "dropped", "overruns", "commands", "bad_commands")
EVENT_HEAD = struct.Struct("<QB")
"""MCU time in us and level; the text follows."""
REPLY_HEAD = struct.Struct("<HBB")
"""Sequence number and type of the command, and the result."""
_WARNING = 1
_PING_TELLS_TIME = 2
"""Minor version since which the reply to a ping ends with the device's time."""
_TIME_BYTES = 8

_COMMANDS: Mapping[int, str] = {
    FrameType.START: "start",
    FrameType.STOP: "stop",
    FrameType.DESCRIBE: "describe",
    FrameType.SET: "set",
    FrameType.PING: "ping",
}

FLAGS: Mapping[int, str] = {
    Flag.GYRO_SATURATED: "the gyroscope is at the end of its range",
    Flag.ACCEL_SATURATED: "the accelerometer is at the end of its range",
    Flag.TIME_JUMP: "the clock of the device was stepped",
    Flag.SELF_TEST: "the self-test of the sensor is on: its output is not noise",
}

_NUMBERS = {
    "rate_hz": Tag.RATE,
    "gyro_fs": Tag.GYRO_FULL_SCALE,
    "accel_fs": Tag.ACCEL_FULL_SCALE,
}


def notice_of(kind: int, version: int, body: bytes) -> Notice | None:
    """Return what a status, event or reply says; None when it is none of them or too short."""
    if kind == FrameType.STATUS and len(body) >= STATUS.size:
        time_us, *numbers = STATUS.unpack_from(body)
        fields = dict(zip(_STATUS_FIELDS, numbers, strict=True))
        text = " ".join(f"{name} {number}" for name, number in fields.items())
        return Notice("status", text, {**fields, "uptime_s": time_us / 1e6})
    if kind == FrameType.EVENT and len(body) >= EVENT_HEAD.size:
        time_us, level = EVENT_HEAD.unpack_from(body)
        text = text_of(body[EVENT_HEAD.size :])
        told = {"uptime_s": time_us / 1e6, "level": level}
        return Notice("error" if level > _WARNING else "text", text, told)
    if kind == FrameType.REPLY and len(body) >= REPLY_HEAD.size:
        sequence, command, code = REPLY_HEAD.unpack_from(body)
        name = _COMMANDS.get(command, f"command {command:#04x}")
        result = Result(code).name.lower().replace("_", " ") if code in set(Result) else str(code)
        answer: dict[str, int | float | str] = {
            "sequence": sequence,
            "command": command,
            "result": code,
        }
        payload = body[REPLY_HEAD.size :]
        if name == "ping" and version & 0xF >= _PING_TELLS_TIME and len(payload) >= _TIME_BYTES:
            answer["uptime_s"] = int.from_bytes(payload[-_TIME_BYTES:], "little") / 1e6
        return Notice("reply", f"{name}: {result}", answer)
    return None


def request(kind: FrameType, seq: int, body: bytes = b"") -> bytes:
    """Return a command as it goes over the wire; the zero in front ends whatever came before."""
    return b"\0" + pack_frame(kind, seq, 0, body)


def settings_body(settings: WireSettings) -> bytes:
    """Return the body of a `set` command; empty when nothing is to be set."""
    entries = [
        (tag, float32(getattr(settings, name)))
        for name, tag in _NUMBERS.items()
        if getattr(settings, name) is not None
    ]
    return pack_entries(entries)


def command_of(frame: bytes) -> Command:
    """Return what a frame from the host asks for."""
    seq = int.from_bytes(frame[2:4], "little")
    body = frame[HEADER_BYTES:]
    name = _COMMANDS.get(frame[0], "unknown") if frame[1] >> 4 == VERSION_MAJOR else "unknown"
    fields: dict[str, Any] = {"payload": body, "type": frame[0]}
    if name == "set":
        entries = unpack_entries(body)
        if entries is None:
            return Command("unknown", seq, fields)
        for field, tag in _NUMBERS.items():
            value = read_float32(entries.get(tag))
            if value is not None:
                fields[field] = value
        channels = entries.get(Tag.CHANNELS, b"")
        if len(channels) == 1:
            fields["axes"] = tuple(axis for i, axis in enumerate(AXES) if channels[0] >> i & 1)
    return Command(cast("Any", name), seq, fields)
