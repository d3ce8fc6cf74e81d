"""The numbers of the native protocol, whose norm is ``firmware_protocol/PROTOCOL.md``.

A frame begins with the same eight bytes whatever it holds; a data frame with `DATA_HEADER`. The
bodies of a descriptor and of a `set` command are entries of tag, length and value
(`pack_entries`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping
from enum import IntEnum, IntFlag

import numpy as np

__all__ = [
    "CHANNELS_ACCEL",
    "CHANNELS_GYRO",
    "CRC_BYTES",
    "DATA_HEADER",
    "HEADER_BYTES",
    "LONGEST_CHUNK",
    "LONGEST_FRAME",
    "MOST_SAMPLES",
    "NO_TEMPERATURE",
    "NO_TICKS",
    "SAMPLE_BYTES",
    "VERSION",
    "VERSION_MAJOR",
    "Clock",
    "Flag",
    "FrameType",
    "Result",
    "SourceCode",
    "Tag",
    "float32",
    "pack_entries",
    "read_float32",
    "unpack_entries",
]

VERSION_MAJOR = 1
VERSION = VERSION_MAJOR << 4 | 2

HEADER_BYTES = 8
"""Type, version, sequence, epoch, flags, n: the same in every frame."""
CRC_BYTES = 4
SAMPLE_BYTES = 12
MOST_SAMPLES = 18
LONGEST_FRAME = 246
"""Longest frame with its CRC: so short that COBS adds exactly one byte to any frame."""
LONGEST_CHUNK = LONGEST_FRAME + 1
"""Most bytes between two delimiters."""
NO_TICKS = 0xFFFFFFFF
NO_TEMPERATURE = -32768
CHANNELS_GYRO = 0b000111
CHANNELS_ACCEL = 0b111000

DATA_HEADER = np.dtype(
    [
        ("type", "u1"),
        ("version", "u1"),
        ("seq", "<u2"),
        ("epoch", "<u2"),
        ("flags", "u1"),
        ("n", "u1"),
        ("index", "<u4"),
        ("mcu_us", "<u8"),
        ("sensor_ticks", "<u4"),
        ("temperature", "<i2"),
    ]
)
"""The first 26 bytes of a data frame."""


class FrameType(IntEnum):
    """First byte of a frame; from 0x80 on it is a command of the host."""

    DATA = 0x01
    DESCRIPTOR = 0x02
    STATUS = 0x03
    EVENT = 0x04
    REPLY = 0x06
    START = 0x81
    STOP = 0x82
    DESCRIBE = 0x83
    SET = 0x84
    PING = 0x85


class Flag(IntFlag):
    """Byte 6 of a data frame."""

    GYRO = 1 << 0
    ACCEL = 1 << 1
    SENSOR_OVERRUN = 1 << 2
    DROPPED_BEFORE = 1 << 3
    GYRO_SATURATED = 1 << 4
    ACCEL_SATURATED = 1 << 5
    TIME_JUMP = 1 << 6
    SELF_TEST = 1 << 7


class Tag(IntEnum):
    """What an entry of a descriptor, or of a `set` command, holds."""

    PART = 0x01
    WHO_AM_I = 0x02
    FIRMWARE = 0x03
    UNIQUE_ID = 0x04
    GYRO_FULL_SCALE = 0x05
    GYRO_SENSITIVITY = 0x06
    ACCEL_FULL_SCALE = 0x07
    ACCEL_SENSITIVITY = 0x08
    TEMPERATURE = 0x09
    RATE = 0x0A
    SENSOR_TICK = 0x0B
    CHANNELS = 0x0C
    CLOCK = 0x0D
    REGISTERS = 0x0E
    AXIS_MAP = 0x0F
    MOST_SAMPLES = 0x10
    BOARD = 0x11
    SOURCE = 0x12


class Clock(IntEnum):
    """What drives the MCU time."""

    NONE = 0
    CRYSTAL = 1
    RC = 2
    EMULATED = 3


class SourceCode(IntEnum):
    """Where the samples come from."""

    PART = 1
    SYNTHETIC = 2
    EMULATED = 3


class Result(IntEnum):
    """How a command went."""

    OK = 0
    UNKNOWN_COMMAND = 1
    BAD_ARGUMENT = 2
    NOT_POSSIBLE = 3
    FAILED = 4


def pack_entries(entries: Iterable[tuple[int, bytes]]) -> bytes:
    """Return the entries one after another, each as tag, length and value."""
    return b"".join(bytes((tag, len(value))) + value for tag, value in entries)


def unpack_entries(data: bytes) -> Mapping[int, bytes] | None:
    """Return the entries by tag, the last one where a tag repeats; None when one is cut short."""
    entries: dict[int, bytes] = {}
    here = 0
    while here < len(data):
        if here + 2 > len(data) or here + 2 + data[here + 1] > len(data):
            return None
        start = here + 2
        here = start + data[here + 1]
        entries[data[start - 2]] = data[start:here]
    return entries


def float32(value: float) -> bytes:
    """Return a number as a little-endian IEEE 754 binary32."""
    return struct.pack("<f", value)


def read_float32(data: bytes | None) -> float | None:
    """Return the shortest decimal that this binary32 stands for; None when absent or not finite.

    A sensitivity of 8.75 mdps must not become 8.750000037 mdps because it travelled in 32 bits.

    >>> read_float32(float32(0.00875))
    0.00875
    """
    if data is None or len(data) != 4:
        return None
    value = float(str(np.frombuffer(data, "<f4")[0]))
    return value if math.isfinite(value) else None
