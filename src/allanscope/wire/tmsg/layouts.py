"""What a streaming message holds, in the two layouts that matter.

Current (X-CUBE-MEMS1 DataLogExtended since 7.1): a time in microseconds, a mask, and a block for
each bit of the mask. SensorTile (DataLogExtended 4.3.0): 56 bytes always, a time of day in
hundredths, and a mask of what is new; what is not new is an old value again and no sample.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from allanscope.wire.pairing import Triple

__all__ = ["DEVICE", "STREAM", "Reading", "read_current", "read_sensortile"]

DEVICE = 0x32
"""Address of the board; the host's is usually 1."""
STREAM = 0x08
"""Command of a streaming message, and of the request to start."""

# Bytes of each block in the order of the mask bits: pressure, temperature, humidity, accelerometer,
# gyroscope, magnetometer, interrupts, MLC, FSM, an unused bit, QVAR.
_SIZES = (4, 4, 4, 12, 12, 12, 1, 8, 16, 0, 4)
_TEMPERATURE, _ACCEL, _GYRO, _INTERRUPTS = 1, 3, 4, 6
_HEAD = struct.Struct("<IH")
_TRIPLE = struct.Struct("<3i")
_FLOAT = struct.Struct("<f")
_LARGEST_MG = 20_000
_LARGEST_MDPS = 32_768 * 70

_SENSORTILE_BYTES = 56
_NEW_ACCEL, _NEW_GYRO, _NEW_TEMPERATURE = 1, 2, 32


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
    wide = len(body) == here + 1 and mask >> _INTERRUPTS & 1
    if len(body) != here and not wide:
        return None
    return _reading(body, stamp, places.get(_GYRO), places.get(_ACCEL), places.get(_TEMPERATURE))


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
