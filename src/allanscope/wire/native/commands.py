"""What a host asks of a native device, written and read."""

from __future__ import annotations

from typing import Any, cast

from allanscope.samples import AXES
from allanscope.wire.base import Command, WireSettings
from allanscope.wire.native import tlv
from allanscope.wire.native.descriptor import channels_of
from allanscope.wire.native.framing import seal
from allanscope.wire.native.layout import HEADER_BYTES, VERSION_MAJOR, FrameType, Tag
from allanscope.wire.native.remarks import COMMANDS

__all__ = ["command_of", "request", "settings_body"]

_NUMBERS = {
    "rate_hz": Tag.RATE,
    "gyro_fs": Tag.GYRO_FULL_SCALE,
    "accel_fs": Tag.ACCEL_FULL_SCALE,
}


def request(kind: FrameType, seq: int, body: bytes = b"") -> bytes:
    """Return a command as it goes over the wire; the zero in front ends whatever came before."""
    return b"\0" + seal(kind, seq, 0, body)


def settings_body(settings: WireSettings, axes: tuple[str, ...] = ()) -> bytes:
    """Return the body of a `set` command; empty when nothing is to be set."""
    entries = [
        (tag, tlv.float32(getattr(settings, name)))
        for name, tag in _NUMBERS.items()
        if getattr(settings, name) is not None
    ]
    if axes:
        entries.append((Tag.CHANNELS, bytes((channels_of(axes),))))
    return tlv.pack(entries)


def command_of(frame: bytes) -> Command:
    """Return what a frame from the host asks for."""
    seq = int.from_bytes(frame[2:4], "little")
    body = frame[HEADER_BYTES:]
    name = COMMANDS.get(frame[0], "unknown") if frame[1] >> 4 == VERSION_MAJOR else "unknown"
    fields: dict[str, Any] = {"payload": body, "type": frame[0]}
    if name == "set":
        entries = tlv.unpack(body)
        if entries is None:
            return Command("unknown", seq, fields)
        for field, tag in _NUMBERS.items():
            value = tlv.read_float32(entries.get(tag))
            if value is not None:
                fields[field] = value
        channels = entries.get(Tag.CHANNELS, b"")
        if len(channels) == 1:
            fields["axes"] = tuple(axis for i, axis in enumerate(AXES) if channels[0] >> i & 1)
    return Command(cast("Any", name), seq, fields)
