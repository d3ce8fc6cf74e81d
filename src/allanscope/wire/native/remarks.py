"""Frames that are for people: status, events, replies."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from allanscope.samples import Notice
from allanscope.sanitize import text_of
from allanscope.wire.native.layout import Flag, FrameType, Result

__all__ = ["COMMANDS", "FLAGS", "STATUS", "notice_of"]

STATUS = struct.Struct("<Q6I")
"""MCU time in us, then produced, sent, dropped samples, FIFO overruns, commands good and bad."""
_STATUS_FIELDS = ("produced", "sent", "dropped", "overruns", "commands", "bad_commands")
_EVENT_HEAD = struct.Struct("<QB")
_REPLY_HEAD = struct.Struct("<HBB")
_WARNING = 1

COMMANDS: Mapping[int, str] = {
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


def notice_of(kind: int, body: bytes) -> Notice | None:
    """Return what a status, event or reply says; None when it is none of them or too short."""
    if kind == FrameType.STATUS and len(body) >= STATUS.size:
        time_us, *numbers = STATUS.unpack_from(body)
        fields = dict(zip(_STATUS_FIELDS, numbers, strict=True))
        text = " ".join(f"{name} {number}" for name, number in fields.items())
        return Notice("status", text, {**fields, "uptime_s": time_us * 1e-6})
    if kind == FrameType.EVENT and len(body) >= _EVENT_HEAD.size:
        time_us, level = _EVENT_HEAD.unpack_from(body)
        text = text_of(body[_EVENT_HEAD.size :])
        return Notice("error" if level > _WARNING else "text", text, {"uptime_s": time_us * 1e-6})
    if kind == FrameType.REPLY and len(body) >= _REPLY_HEAD.size:
        sequence, command, code = _REPLY_HEAD.unpack_from(body)
        name = COMMANDS.get(command, f"command {command:#04x}")
        result = Result(code).name.lower().replace("_", " ") if code in set(Result) else str(code)
        return Notice("reply", f"{name}: {result}", {"sequence": sequence, "result": code})
    return None
