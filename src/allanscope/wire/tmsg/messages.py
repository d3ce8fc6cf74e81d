r"""TMsg messages: how they are framed, what a board says, what a host asks.

ST's tools (Unicleo-GUI, MEMS-Studio) talk to evaluation boards this way. There is no start mark,
no length and no number; a message is stuffed, has an 8-bit sum, and ends with 0xF0::

    wire = stuffed(body, check) F0      F0 -> F1 F2,  F1 -> F1 F1

The check byte makes the sum of all bytes a multiple of 256, so a damaged message passes once in 256
times; what it says is checked as well before it is believed.

A streaming message has one of the two layouts that matter. Current (X-CUBE-MEMS1 DataLogExtended
since 7.1): a time in microseconds, a mask, and a block for each bit of the mask. SensorTile
(DataLogExtended 4.3.0): 56 bytes always, a time of day in hundredths, and a mask of what is new;
what is not new is an old value again and no sample.

Every request is one message in a single write: the SensorTile reads one USB packet at a time. A
request that cannot be met is mostly not answered at all.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from allanscope.wire.base import Command, WireSettings
from allanscope.wire.rows import Triple

__all__ = [
    "DEVICE",
    "END",
    "READ_PRESENTATION",
    "REPLY",
    "STREAM",
    "Reading",
    "Unwrapper",
    "command_of",
    "read_current",
    "read_sensortile",
    "start",
    "stop",
    "wrap",
]

END = 0xF0
_LONGEST_BODY = 512
_LONGEST_CHUNK = 2 * (_LONGEST_BODY + 1)

DEVICE = 0x32
"""Address of the board; the host's is usually 1."""
_HOST = 0x01

# Commands; a reply has the number of its command plus `REPLY`.
_PING, READ_PRESENTATION, _STOP, _SENSOR = 0x01, 0x02, 0x09, 0x50
STREAM = 0x08
"""Of a streaming message, and of the request to start."""
REPLY = 0x80
_SET_FULL_SCALE, _SET_RATE, _SET_INDEX = 0x05, 0x07, 0x15
_ACCEL, _GYRO, _TEMPERATURE = 1, 2, 4
_MASK_TEMPERATURE, _MASK_ACCEL, _MASK_GYRO = 0x02, 0x10, 0x20

# Bytes of each block in the order of the mask bits: pressure, temperature, humidity, accelerometer,
# gyroscope, magnetometer, interrupts, MLC, FSM, an unused bit, QVAR.
_SIZES = (4, 4, 4, 12, 12, 12, 1, 8, 16, 0, 4)
_TEMPERATURE_BIT, _ACCEL_BIT, _GYRO_BIT, _INTERRUPTS_BIT = 1, 3, 4, 6
_HEAD = struct.Struct("<IH")
_TRIPLE = struct.Struct("<3i")
_FLOAT = struct.Struct("<f")
_LARGEST_MG = 20_000
_LARGEST_MDPS = 32_768 * 70

_SENSORTILE_BYTES = 56
_NEW_ACCEL, _NEW_GYRO, _NEW_TEMPERATURE = 1, 2, 32


def wrap(body: bytes) -> bytes:
    """Return a message as it goes over the wire.

    >>> wrap(bytes([0x32, 0x01, 0x01])).hex(" ")
    '32 01 01 cc f0'
    """
    checked = body + bytes((-sum(body) & 0xFF,))
    return checked.replace(b"\xf1", b"\xf1\xf1").replace(b"\xf0", b"\xf1\xf2") + bytes((END,))


def _body_of(chunk: bytes) -> bytes | None:
    """Return the body of what came before an 0xF0, None when it is damaged."""
    first, *rest = chunk.split(b"\xf1")
    checked = bytearray(first)
    escaped = iter(rest)
    for piece in escaped:
        if piece[:1] == b"\xf2":
            checked += b"\xf0" + piece[1:]
            continue
        if piece:
            return None
        # Two escapes in a row are one byte 0xF1; what follows the second is plain.
        plain = next(escaped, None)
        if plain is None:
            return None
        checked += b"\xf1" + plain
    return bytes(checked[:-1]) if len(checked) > 3 and sum(checked) & 0xFF == 0 else None


class Unwrapper:
    """Bytes to the bodies of messages whose sum is right.

    Attributes
    ----------
    damaged : int
        Pieces between two ends that were no message, or too long for one. The first piece after a
        start is not counted: it may be the tail of a message.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self.reset()

    def reset(self) -> None:
        """Forget a partial message."""
        self._partial = bytearray()
        self._overlong = False
        self._joining = True

    def feed(self, data: bytes) -> Iterator[bytes | None]:
        """Yield the body of each message that the bytes complete, None for a damaged one."""
        *ended, rest = data.split(bytes((END,)))
        for piece in ended:
            self._keep(piece)
            chunk, overlong, joining = bytes(self._partial), self._overlong, self._joining
            self.reset()
            self._joining = False
            if not chunk and not overlong:
                continue
            body = None if overlong else _body_of(chunk)
            if body is None and joining and not overlong:
                continue
            self.damaged += body is None
            yield body
        self._keep(rest)

    def _keep(self, piece: bytes) -> None:
        if self._overlong or len(self._partial) + len(piece) > _LONGEST_CHUNK:
            self._overlong = True
            self._partial = bytearray()
        else:
            self._partial += piece


@dataclass(frozen=True, slots=True)
class Reading:
    """One streaming message.

    Attributes
    ----------
    stamp : int
        Time, in the unit of the layout.
    gyro, accel : tuple of float or None
        mdps and mg, where they are new.
    temperature_c : float
        NaN where it is not new.
    """

    stamp: int
    gyro: Triple | None
    accel: Triple | None
    temperature_c: float


def read_current(body: bytes) -> Reading | None:
    """Return what a message of the current layout says, None when it cannot be one.

    The stamp is in microseconds since the start, modulo 2^32.
    """
    if len(body) < 9 or body[1] != DEVICE or body[2] != STREAM:
        return None
    stamp, mask = _HEAD.unpack_from(body, 3)
    if mask >> len(_SIZES):
        return None
    places: dict[int, int] = {}
    here = 9
    for bit, size in enumerate(_SIZES):
        if mask >> bit & 1:
            places[bit] = here
            here += size
    # Boards with more sensors send two bytes of interrupt status instead of one.
    wide = len(body) == here + 1 and mask >> _INTERRUPTS_BIT & 1
    if len(body) != here and not wide:
        return None
    return _reading(body, stamp, *map(places.get, (_GYRO_BIT, _ACCEL_BIT, _TEMPERATURE_BIT)))


def read_sensortile(body: bytes) -> Reading | None:
    """Return what a message of the SensorTile layout says, None when it cannot be one.

    The stamp is in hundredths of a second since midnight.
    """
    if len(body) != _SENSORTILE_BYTES or body[1] != DEVICE or body[2] != STREAM:
        return None
    hours, minutes, seconds, hundredths = body[3:7]
    if hours > 23 or minutes > 59 or seconds > 59 or hundredths > 99:
        return None
    new = body[55]
    return _reading(
        body,
        ((hours * 60 + minutes) * 60 + seconds) * 100 + hundredths,
        31 if new & _NEW_GYRO else None,
        19 if new & _NEW_ACCEL else None,
        11 if new & _NEW_TEMPERATURE else None,
    )


def _reading(
    body: bytes, stamp: int, gyro: int | None, accel: int | None, temperature: int | None
) -> Reading | None:
    rates: Triple | None = None if gyro is None else _TRIPLE.unpack_from(body, gyro)
    forces: Triple | None = None if accel is None else _TRIPLE.unpack_from(body, accel)
    if rates and max(map(abs, rates)) > _LARGEST_MDPS:
        return None
    if forces and max(map(abs, forces)) > _LARGEST_MG:
        return None
    degrees = math.nan if temperature is None else _FLOAT.unpack_from(body, temperature)[0]
    sane = -60.0 < degrees < 150.0
    return Reading(stamp, rates, forces, float(degrees) if sane else math.nan)


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
    requests = [_request(_PING)]
    if index:
        requests += [_sensor(_SET_INDEX, sensor, b"\0") for sensor in (_ACCEL, _GYRO, _TEMPERATURE)]
    for sensor, full_scale in ((_ACCEL, settings.accel_fs), (_GYRO, settings.gyro_fs)):
        if full_scale is not None:
            requests.append(_sensor(_SET_FULL_SCALE, sensor, struct.pack("<I", int(full_scale))))
        if settings.rate_hz is not None:
            requests.append(_sensor(_SET_RATE, sensor, struct.pack("<f", settings.rate_hz)))
    mask = _MASK_TEMPERATURE | _MASK_ACCEL | _MASK_GYRO
    return [*requests, _request(STREAM, struct.pack("<I", mask))]


def stop() -> list[bytes]:
    """Return the request that ends the stream."""
    return [_request(_STOP)]


def command_of(body: bytes) -> Command:
    """Return what a message from a host asks for; its bytes are in ``fields["payload"]``."""
    fields: dict[str, Any] = {"payload": body}
    command = body[2]
    if command == _PING:
        return Command("ping", fields=fields)
    if command == READ_PRESENTATION:
        return Command("describe", fields=fields)
    if command == _STOP:
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
