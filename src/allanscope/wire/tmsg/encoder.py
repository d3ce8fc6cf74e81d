"""An evaluation board with ST's DataLogExtended firmware, simulated."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import AXES, Block, StreamInfo
from allanscope.wire.base import Command
from allanscope.wire.device_side import OneWayEncoder, milli_units, temperatures, times
from allanscope.wire.tmsg.messages import (
    DEVICE,
    END,
    READ_PRESENTATION,
    REPLY,
    STREAM,
    Unwrapper,
    command_of,
    wrap,
)

__all__ = ["SensorTileEncoder", "TMsgEncoder"]

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
        sent = milli_units(block, self._info).astype("<i4")
        degrees = temperatures(block, rows).astype("<f4")
        blocks: list[tuple[int, NDArray[Any]]] = []
        if np.isfinite(degrees).all():
            blocks.append((_TEMPERATURE_BIT, degrees))
        for bit, columns in ((_ACCEL_BIT, slice(3, 6)), (_GYRO_BIT, slice(0, 3))):
            if any(axis in self._info.axes for axis in AXES[columns]):
                blocks.append((bit, sent[:, columns]))
        head = np.zeros(len(block), _CURRENT)
        head["head"] = (_HOST, DEVICE, STREAM)
        microseconds = np.rint(times(block, rows, self._info.nominal_hz) * 1e6).astype(np.int64)
        head["time"] = microseconds & 0xFFFFFFFF
        head["mask"] = sum(bit for bit, _ in blocks)
        return np.hstack([_bytes(head), *(_bytes(values) for _, values in blocks)])


class SensorTileEncoder(TMsgEncoder):
    """The same with the fixed layout of the SensorTile's firmware."""

    presentation: ClassVar[bytes] = _PRESENTATION_SENSORTILE

    def _bodies(self, block: Block) -> NDArray[np.uint8]:
        rows = np.arange(len(block))
        body = np.zeros(len(block), _SENSORTILE)
        body["head"] = (_HOST, DEVICE, STREAM)
        hundredths = np.floor(times(block, rows, self._info.nominal_hz) * 100.0 + 1e-6)
        clock = hundredths.astype(np.int64)
        steps = ((360_000, 24), (6000, 60), (100, 60), (1, 100))
        body["clock"] = np.stack([clock // size % modulus for size, modulus in steps], axis=1)
        degrees = temperatures(block, rows)
        body["temperature"] = np.nan_to_num(degrees)
        sent = milli_units(block, self._info)
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
