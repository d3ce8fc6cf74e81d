"""What a host asks of a TMsg board, written and read.

Every request is one message in a single write: the SensorTile reads one USB packet at a time. A
request that cannot be met is mostly not answered at all.
"""

from __future__ import annotations

import struct
from typing import Any

from allanscope.wire.base import Command, WireSettings
from allanscope.wire.tmsg.framing import wrap
from allanscope.wire.tmsg.layouts import DEVICE, STREAM

__all__ = ["PING", "READ_PRESENTATION", "REPLY", "STOP", "command_of", "start", "stop"]

PING = 0x01
READ_PRESENTATION = 0x02
STOP = 0x09
_SENSOR = 0x50
REPLY = 0x80
_HOST = 0x01

_SET_FULL_SCALE, _SET_RATE, _SET_INDEX = 0x05, 0x07, 0x15
_ACCEL, _GYRO, _TEMPERATURE = 1, 2, 4
_MASK_TEMPERATURE, _MASK_ACCEL, _MASK_GYRO = 0x02, 0x10, 0x20


def _request(command: int, payload: bytes = b"") -> bytes:
    return wrap(bytes((DEVICE, _HOST, command)) + payload)


def _sensor(action: int, sensor: int, value: bytes) -> bytes:
    return _request(_SENSOR, bytes((action, sensor)) + value)


def start(settings: WireSettings, index: bool) -> list[bytes]:
    """Return the requests that make a board stream both sensors and the temperature.

    Parameters
    ----------
    settings : WireSettings
        Full scales and rate, set where the user gave them.
    index : bool
        Whether the sensors must be chosen first: the current firmware has none chosen after reset.
    """
    # Whatever stood on the line before takes the ping with it, and not a setting.
    requests = [_request(PING)]
    if index:
        requests += [_sensor(_SET_INDEX, s, b"\0") for s in (_ACCEL, _GYRO, _TEMPERATURE)]
    for sensor, full_scale in ((_ACCEL, settings.accel_fs), (_GYRO, settings.gyro_fs)):
        if full_scale is not None:
            requests.append(_sensor(_SET_FULL_SCALE, sensor, struct.pack("<I", int(full_scale))))
        if settings.rate_hz is not None:
            requests.append(_sensor(_SET_RATE, sensor, struct.pack("<f", settings.rate_hz)))
    mask = _MASK_TEMPERATURE | _MASK_ACCEL | _MASK_GYRO
    return [*requests, _request(STREAM, struct.pack("<I", mask))]


def stop() -> list[bytes]:
    """Return the request that ends the stream."""
    return [_request(STOP)]


def command_of(body: bytes) -> Command:
    """Return what a message from a host asks for; its bytes are in ``fields["payload"]``."""
    fields: dict[str, Any] = {"payload": body}
    command = body[2]
    if command == PING:
        return Command("ping", fields=fields)
    if command == READ_PRESENTATION:
        return Command("describe", fields=fields)
    if command == STOP:
        return Command("stop", fields=fields)
    if command == STREAM and len(body) >= 7:
        (mask,) = struct.unpack_from("<I", body, 3)
        gyro = ("gx", "gy", "gz") if mask & _MASK_GYRO else ()
        accel = ("ax", "ay", "az") if mask & _MASK_ACCEL else ()
        return Command("start", fields=fields | {"axes": (*gyro, *accel)})
    if command == _SENSOR and len(body) >= 9 and body[3] in (_SET_FULL_SCALE, _SET_RATE):
        return _setting(body, fields)
    return Command("unknown", fields=fields)


def _setting(body: bytes, fields: dict[str, Any]) -> Command:
    if body[3] == _SET_RATE:
        return Command("set", fields=fields | {"rate_hz": struct.unpack_from("<f", body, 5)[0]})
    name = {_ACCEL: "accel_fs", _GYRO: "gyro_fs"}.get(body[4])
    if name is None:
        return Command("unknown", fields=fields)
    return Command("set", fields=fields | {name: float(struct.unpack_from("<I", body, 5)[0])})
