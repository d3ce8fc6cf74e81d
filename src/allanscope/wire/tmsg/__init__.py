"""TMsg, the protocol between ST's evaluation boards and ST's desktop tools.

::

    bytes ─▶ messages ─▶ pairing of sensors ─▶ milli (mdps, mg to counts) ─▶ rows (losses, Blocks)

A board is silent until `messages.start` wakes it. Messages have an 8-bit sum and no number: losses
are counted from the time stamps. Here are both ends, the decoder and a simulated board with ST's
DataLogExtended firmware; `messages` has the messages themselves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import AXES, Block, Event, GapReason, Notice, StreamInfo
from allanscope.sanitize import text_of
from allanscope.wire.base import (
    Command,
    LinkStats,
    OneWayEncoder,
    WireFormat,
    WireSettings,
    device_times,
    temperatures_at,
)
from allanscope.wire.milli_units import MilliUnits, to_milli_units
from allanscope.wire.row_events import RowEvents
from allanscope.wire.rows import Pairing
from allanscope.wire.timestamps import WrappingCounter
from allanscope.wire.tmsg.messages import (
    DEVICE,
    END,
    READ_PRESENTATION,
    REPLY,
    STREAM,
    Unwrapper,
    command_of,
    read_current,
    read_sensortile,
    start,
    stop,
    wrap,
)

__all__ = ["SensorTileEncoder", "TMsgDecoder", "TMsgEncoder", "TMsgFormat", "TMsgSensorTileFormat"]

_USUAL_RATES = (12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1660.0)


class TMsgDecoder:
    """Bytes of the TMsg protocol to events.

    Parameters
    ----------
    settings : WireSettings
        What the user said about the device.
    sensortile : bool
        Whether messages have the fixed layout of the SensorTile's firmware.
    """

    def __init__(self, settings: WireSettings, sensortile: bool) -> None:
        self.stats = LinkStats()
        self._sensortile = sensortile
        self._unwrapper = Unwrapper()
        self._read = read_sensortile if sensortile else read_current
        units = MilliUnits(
            "tmsg-sensortile" if sensortile else "tmsg",
            settings,
            usual_rates=_USUAL_RATES,
            time_resolution_s=1e-2 if sensortile else 1e-6,
        )
        self._rows = RowEvents(self.stats, units.decide, checked=True)
        self._start_over()

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        self.stats.bytes += len(data)
        events: list[Event] = []
        for body in self._unwrapper.feed(data):
            if body is None:
                self.stats.crc_errors += 1
                self._rows.note_damage()
            elif body[2] == STREAM:
                self._stream(body, host_s)
            else:
                events += self._rows.events()
                events += self._other(body)
        return events + self._rows.events()

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial message, e.g. after an unplug; the next Block follows a Gap."""
        self._unwrapper.reset()
        self._start_over()
        self._rows.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: rows that were held back."""
        return self._rows.events(final=True)

    def _start_over(self) -> None:
        self._stamps = (
            WrappingCounter(24 * 3600 * 100, 100.0)
            if self._sensortile
            else WrappingCounter(1 << 32, 1e6)
        )
        self._pairing = Pairing()
        self._temperature_c = math.nan

    def _stream(self, body: bytes, host_s: float) -> None:
        reading = self._read(body)
        if reading is None:
            self.stats.unknown += 1
            self._rows.note_damage()
            return
        self.stats.frames += 1
        device_s = self._stamps.seconds(reading.stamp)
        if not math.isnan(reading.temperature_c):
            self._temperature_c = reading.temperature_c
        values = self._pairing.update(reading.gyro, reading.accel)
        if values is not None:
            self._rows.add(values, device_s, host_s, self._temperature_c)
            self._temperature_c = math.nan

    def _other(self, body: bytes) -> list[Event]:
        command = body[2] - REPLY
        if body[1] != DEVICE or command < 0:
            self.stats.unknown += 1
            return []
        self.stats.frames += 1
        said = text_of(body[3:]) if command == READ_PRESENTATION else body[3:].hex(" ")
        return [Notice("reply", f"command {command:#04x}: {said}".rstrip(": "))]


_HOST = 1
_PRESENTATION = b"MEMS shield demo,101,9.4.0,0.0.0,IKS01A2"
_PRESENTATION_SENSORTILE = b"MEMS shield demo,101,4.0.0,0.0.0,STLKT01V1"
_TEMPERATURE_BIT, _ACCEL_BIT, _GYRO_BIT = 1 << 1, 1 << 3, 1 << 4

_CURRENT = np.dtype([("head", "u1", 3), ("time", "<u4"), ("mask", "<u2")])
_SENSORTILE = np.dtype(
    [
        ("head", "u1", 3),
        ("clock", "u1", 4),
        ("pressure", "<f4"),
        ("temperature", "<f4"),
        ("humidity", "<f4"),
        ("accel", "<i4", 3),
        ("gyro", "<i4", 3),
        ("magneto", "<i4", 3),
        ("new", "u1"),
    ]
)


class TMsgEncoder(OneWayEncoder):
    """Blocks to TMsg messages of the current layout, and requests to commands."""

    silent_until_started: ClassVar[bool] = True
    presentation: ClassVar[bytes] = _PRESENTATION

    def __init__(self) -> None:
        super().__init__(StreamInfo(AXES, (70e-3,) * 3 + (0.061e-3,) * 3, 104.0))
        self._unwrapper = Unwrapper()

    def encode(self, block: Block) -> bytes:
        """Return one message a row."""
        return _wrapped(self._bodies(block)) if len(block) else b""

    def receive(self, data: bytes) -> list[Command]:
        """Take bytes from the host and return the commands that they complete."""
        return [command_of(body) for body in self._unwrapper.feed(data) if body is not None]

    def reply(self, command: Command, ok: bool = True) -> bytes:
        """Return the answer to a command; a failure is not answered."""
        request = command.fields.get("payload", b"")
        if not ok or command.name == "unknown" or len(request) < 3:
            return b""
        rest = b"" if command.name == "start" else request[3:]
        if request[2] == READ_PRESENTATION:
            rest = self.presentation
        return wrap(bytes((request[1], DEVICE, request[2] + REPLY)) + rest)

    def _bodies(self, block: Block) -> NDArray[np.uint8]:
        rows = np.arange(len(block))
        sent = to_milli_units(block, self._info).astype("<i4")
        degrees = temperatures_at(block, rows).astype("<f4")
        blocks: list[tuple[int, NDArray[Any]]] = []
        if np.isfinite(degrees).all():
            blocks.append((_TEMPERATURE_BIT, degrees))
        for bit, columns in ((_ACCEL_BIT, slice(3, 6)), (_GYRO_BIT, slice(0, 3))):
            if any(axis in self._info.axes for axis in AXES[columns]):
                blocks.append((bit, sent[:, columns]))
        head = np.zeros(len(block), _CURRENT)
        head["head"] = (_HOST, DEVICE, STREAM)
        microseconds = np.rint(1e6 * device_times(block, rows, self._info.nominal_hz))
        head["time"] = microseconds.astype(np.int64) & 0xFFFFFFFF
        head["mask"] = sum(bit for bit, _ in blocks)
        return np.hstack([_bytes(head), *(_bytes(values) for _, values in blocks)])


class SensorTileEncoder(TMsgEncoder):
    """The same with the fixed layout of the SensorTile's firmware."""

    presentation: ClassVar[bytes] = _PRESENTATION_SENSORTILE

    def _bodies(self, block: Block) -> NDArray[np.uint8]:
        rows = np.arange(len(block))
        body = np.zeros(len(block), _SENSORTILE)
        body["head"] = (_HOST, DEVICE, STREAM)
        hundredths = np.floor(device_times(block, rows, self._info.nominal_hz) * 100.0 + 1e-6)
        clock = hundredths.astype(np.int64)
        steps = ((360_000, 24), (6000, 60), (100, 60), (1, 100))
        body["clock"] = np.stack([clock // size % modulus for size, modulus in steps], axis=1)
        degrees = temperatures_at(block, rows)
        body["temperature"] = np.nan_to_num(degrees)
        sent = to_milli_units(block, self._info)
        body["gyro"], body["accel"] = sent[:, :3], sent[:, 3:]
        new = 2 * ("gx" in self._info.axes) | 1 * ("ax" in self._info.axes)
        body["new"] = np.where(np.isnan(degrees), new, new | 32)
        return _bytes(body)


def _bytes(table: NDArray[Any]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(table).view(np.uint8).reshape(len(table), -1)


def _wrapped(bodies: NDArray[np.uint8]) -> bytes:
    """Return messages, one in each row, as they go over the wire."""
    check = (-bodies.sum(axis=1, dtype=np.int64) & 0xFF).astype(np.uint8)
    ends = np.full((len(bodies), 1), END, np.uint8)
    plain = np.hstack([bodies, check[:, np.newaxis], ends])
    escaped = plain >= END
    escaped &= plain <= END + 1
    escaped[:, -1] = False
    wire = np.repeat(plain.ravel(), 1 + escaped.ravel())
    last = np.cumsum(1 + escaped.ravel())[escaped.ravel()] - 1
    wire[last - 1] = END + 1
    wire[last] = np.where(plain[escaped] == END, END + 2, END + 1)
    return wire.tobytes()


@dataclass(frozen=True, slots=True)
class TMsgFormat(WireFormat):
    """What Nucleo boards with X-CUBE-MEMS1 DataLogExtended send to ST's own tools."""

    name: str = "tmsg"
    summary: str = "binary protocol of ST's DataLogExtended firmware (Unicleo-GUI, MEMS-Studio)"
    sensortile: bool = False

    def decoder(self, settings: WireSettings) -> TMsgDecoder:
        """Return a fresh decoder."""
        return TMsgDecoder(settings, self.sensortile)

    def encoder(self) -> TMsgEncoder:
        """Return a fresh encoder."""
        return SensorTileEncoder() if self.sensortile else TMsgEncoder()

    def start(self, settings: WireSettings) -> list[bytes]:
        """Choose the sensors, set what the user asked for, and start."""
        return start(settings, index=not self.sensortile)

    def stop(self) -> list[bytes]:
        """End the stream."""
        return stop()

    def score(self, sample: bytes) -> float:
        """Return 1 for two streaming messages of this layout, 0.7 for one, else 0."""
        read = read_sensortile if self.sensortile else read_current
        messages = (body for body in Unwrapper().feed(sample) if body is not None)
        found = sum(read(body) is not None for body in messages)
        return (0.0, 0.7, 1.0)[min(found, 2)]


@dataclass(frozen=True, slots=True)
class TMsgSensorTileFormat(TMsgFormat):
    """What a SensorTile with DataLogExtended 4.3.0 sends."""

    name: str = "tmsg-sensortile"
    summary: str = "the same in the fixed layout of the SensorTile's DataLogExtended 4.3.0"
    sensortile: bool = True
