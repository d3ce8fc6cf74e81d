"""The descriptor: what the device says about itself, as a frame body and as a StreamInfo."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

from allanscope.parts import ACCEL_SCALES, GYRO_SCALES, PARTS
from allanscope.samples import AXES, Origin, StreamInfo
from allanscope.sanitize import text_of
from allanscope.wire.native.layout import (
    CHANNELS_ACCEL,
    CHANNELS_GYRO,
    MOST_SAMPLES,
    Clock,
    Flag,
    SourceCode,
    Tag,
    float32,
    pack_entries,
    read_float32,
    unpack_entries,
)

__all__ = [
    "DESCRIPTOR_VERSION",
    "ZERO_COUNTS_C",
    "Descriptor",
    "channels_of",
    "counts_per_degree",
    "read",
    "valid_flags",
    "write",
]

DESCRIPTOR_VERSION = 1
_ORIGINS: Mapping[int, Origin] = {
    SourceCode.PART: "measured",
    SourceCode.SYNTHETIC: "synthetic",
    SourceCode.EMULATED: "emulated",
}
_CLOCKS: Mapping[Clock, str] = {
    Clock.NONE: "none",
    Clock.CRYSTAL: "crystal",
    Clock.RC: "RC oscillator",
    Clock.EMULATED: "emulated",
}
_DEFAULT_TICK_NS = 25_000
ZERO_COUNTS_C = 25.0


@dataclass(frozen=True, slots=True)
class Descriptor:
    """What is needed to make sense of data frames of one epoch.

    Attributes
    ----------
    info : StreamInfo
        What the rest of the program receives.
    columns : tuple of int
        Which of the six columns of a frame are delivered.
    valid : int
        The bits `Flag.GYRO` and `Flag.ACCEL` as they must stand in every data frame.
    clock : Clock
        What drives the MCU time; without one the sensor timestamp is the device time.
    tick_ns : int
        Step of the sensor timestamp.
    temperature_lsb_per_c : float or None
        Counts per degree; None when the device does not say. Never NaN, because descriptors are
        compared: one that came again must equal itself.
    temperature_zero_c : float
        The temperature at zero counts.
    """

    info: StreamInfo
    columns: tuple[int, ...]
    valid: int
    clock: Clock
    tick_ns: int
    temperature_lsb_per_c: float | None
    temperature_zero_c: float


def channels_of(axes: tuple[str, ...]) -> int:
    """Return the channel mask: bit 0 for gx to bit 5 for az.

    >>> bin(channels_of(("gx", "gy", "gz")))
    '0b111'
    """
    return sum(1 << AXES.index(axis) for axis in axes)


def counts_per_degree(part: str) -> float:
    """Return the temperature sensitivity of a part; that of the LSM6DSL and DSM when unknown."""
    return PARTS[part].temperature_lsb_per_c if part in PARTS else 256.0


def valid_flags(channels: int) -> int:
    """Return the data flags that say which sensors the samples come from."""
    gyro = Flag.GYRO if channels & CHANNELS_GYRO else 0
    accel = Flag.ACCEL if channels & CHANNELS_ACCEL else 0
    return int(gyro | accel)


def write(info: StreamInfo) -> bytes:
    """Return the body of the descriptor frame of a stream (simulated devices send this)."""
    scale = dict(zip(info.axes, info.scale, strict=True))
    gyro = next((scale[axis] for axis in info.axes if axis[0] == "g"), None)
    accel = next((scale[axis] for axis in info.axes if axis[0] == "a"), None)
    part = PARTS.get(info.part)
    entries: list[tuple[int, bytes]] = [(Tag.CHANNELS, bytes((channels_of(info.axes),)))]
    if info.part:
        entries.append((Tag.PART, info.part.encode("ascii", "replace")))
    if part:
        entries.append((Tag.WHO_AM_I, bytes((part.who_am_i,))))
    if gyro is not None:
        entries.append((Tag.GYRO_FULL_SCALE, float32(_full_scale(GYRO_SCALES, gyro))))
        entries.append((Tag.GYRO_SENSITIVITY, float32(gyro)))
    if accel is not None:
        entries.append((Tag.ACCEL_FULL_SCALE, float32(_full_scale(ACCEL_SCALES, accel))))
        entries.append((Tag.ACCEL_SENSITIVITY, float32(accel)))
    entries += [
        (Tag.TEMPERATURE, float32(counts_per_degree(info.part)) + float32(ZERO_COUNTS_C)),
        (Tag.RATE, float32(info.nominal_hz)),
        (Tag.SENSOR_TICK, struct.pack("<I", _DEFAULT_TICK_NS)),
        (Tag.CLOCK, bytes((_clock_of(info),))),
        (Tag.MOST_SAMPLES, bytes((MOST_SAMPLES,))),
    ]
    entries += [
        (Tag.SOURCE, bytes((code,))) for code, one in _ORIGINS.items() if one == info.origin
    ]
    entries += [
        (tag, info.details[name].encode("utf-8")[:40])
        for tag, name in ((Tag.FIRMWARE, "firmware"), (Tag.BOARD, "board"))
        if name in info.details
    ]
    return bytes((DESCRIPTOR_VERSION,)) + pack_entries(entries)


def read(body: bytes, epoch: int) -> Descriptor | None:
    """Return what a descriptor says, or None when data cannot be understood by it."""
    entries = unpack_entries(body[1:])
    if not body or body[0] != DESCRIPTOR_VERSION or entries is None:
        return None
    channels = entries.get(Tag.CHANNELS, b"\x3f")[:1] or b"\0"
    columns = tuple(i for i in range(len(AXES)) if channels[0] >> i & 1)
    sensitivity = {
        "g": read_float32(entries.get(Tag.GYRO_SENSITIVITY)),
        "a": read_float32(entries.get(Tag.ACCEL_SENSITIVITY)),
    }
    axes = tuple(AXES[i] for i in columns)
    scale = tuple(sensitivity[axis[0]] or 0.0 for axis in axes)
    if not axes or min(scale) <= 0.0:
        return None
    clock = _clock(entries.get(Tag.CLOCK))
    tick_ns = int.from_bytes(entries.get(Tag.SENSOR_TICK, b""), "little") or _DEFAULT_TICK_NS
    temperature = entries.get(Tag.TEMPERATURE, b"")
    rate = read_float32(entries.get(Tag.RATE)) or 0.0
    return Descriptor(
        info=StreamInfo(
            axes=axes,
            scale=scale,
            nominal_hz=max(rate, 0.0),
            part=text_of(entries.get(Tag.PART, b""), 40),
            wire="native",
            numbered=True,
            time_resolution_s=1e-6 if clock is not Clock.NONE else tick_ns * 1e-9,
            # An emulated clock is that of the emulated world, in which the samples are made.
            device_clock=clock in (Clock.CRYSTAL, Clock.EMULATED),
            epoch=epoch,
            truncated=(False,) * len(axes),
            details=_details(entries),
            origin=_ORIGINS.get(int.from_bytes(entries.get(Tag.SOURCE, b""), "little"), ""),
        ),
        columns=columns,
        valid=valid_flags(channels[0]),
        clock=clock,
        tick_ns=tick_ns,
        temperature_lsb_per_c=read_float32(temperature[:4]) or None,
        temperature_zero_c=read_float32(temperature[4:8]) or 0.0,
    )


def _clock(value: bytes | None) -> Clock:
    known = value is not None and len(value) == 1 and value[0] in set(Clock)
    return Clock(value[0]) if known and value else Clock.RC


def _clock_of(info: StreamInfo) -> Clock:
    """Return what drives the device time of a stream that is to be described."""
    if info.origin in ("synthetic", "emulated"):
        return Clock.EMULATED
    return Clock.CRYSTAL if info.device_clock else Clock.RC


def _full_scale(table: Mapping[float, float], scale: float) -> float:
    """Return the nominal full scale that a sensitivity belongs to; 0 when it is none of ST's."""
    return next((full for full, one in table.items() if abs(one / scale - 1.0) < 1e-3), 0.0)


def _details(known: Mapping[int, bytes]) -> dict[str, str]:
    details = {
        name: text_of(known[tag], 80)
        for tag, name in ((Tag.FIRMWARE, "firmware"), (Tag.BOARD, "board"))
        if tag in known
    }
    details |= {
        name: known[tag].hex()
        for tag, name in ((Tag.UNIQUE_ID, "unique_id"), (Tag.AXIS_MAP, "axis_map"))
        if tag in known
    }
    if Tag.CLOCK in known:
        details["clock"] = _CLOCKS[_clock(known[Tag.CLOCK])]
    if Tag.WHO_AM_I in known:
        details["who_am_i"] = "0x" + known[Tag.WHO_AM_I].hex()
    if Tag.REGISTERS in known:
        pairs = known[Tag.REGISTERS]
        details["registers"] = " ".join(pairs[i : i + 2].hex(":") for i in range(0, len(pairs), 2))
    for tag, name in ((Tag.GYRO_FULL_SCALE, "gyro_fs"), (Tag.ACCEL_FULL_SCALE, "accel_fs")):
        value = read_float32(known.get(tag))
        if value:
            details[name] = f"{value:g}"
    return details
