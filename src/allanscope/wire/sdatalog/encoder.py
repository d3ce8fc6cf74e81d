"""A board with SDATALOG firmware, simulated: the far end of the link, written from ST's behaviour.

It shares no code with the decoder. As on the board: it connects by beacon and ping, answers one
packet at a time, keeps both sensors switched off until told otherwise, sends a long response in
fragments and each next one when the host has acknowledged the last, and refuses what has a wrong
header. A sample is one packet of each sensor, the accelerometer's first, with the time at which it
was read.
"""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from allanscope.parts import PARTS, Part, part_named
from allanscope.samples import AXES, Block, StreamInfo
from allanscope.wire.base import Command, OneWayEncoder, device_times

__all__ = ["SDatalogEncoder"]

_FRAGMENT = 4092
_SSTL = 7
_DATA, _ANSWER, _BEACON, _PING, _NACK = 0x9, 0xA, 0x5, 0x6, 0xF
_BAD_HEADER = 4
_CHANNELS = {"acc": 0, "gyro": 1}
_AXES = {"acc": AXES[3:], "gyro": AXES[:3]}
_KIND = {axis: kind for kind, axes in _AXES.items() for axis in axes}
_PLAIN = {"get_status": Command("describe"), "log_controller*stop_log": Command("stop")}


def _header(low: int) -> bytes:
    """Return a header with its CRC, bit by bit: each nibble from its highest bit, lowest first."""
    crc = 0
    for nibble in range(7):
        for bit in (3, 2, 1, 0):
            one = low >> (4 * nibble + bit) & 1 ^ crc >> 3
            crc = crc << 1 & 0xF ^ 7 * one
    return struct.pack("<I", low | crc << 28)


class SDatalogEncoder(OneWayEncoder):
    """Blocks to packets, and requests to commands."""

    silent_until_started: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__(StreamInfo(AXES, (70e-3,) * 3 + (0.061e-3,) * 3, 104.0, "LSM6DSM"))
        self._enabled: set[str] = set()
        self._logging = False
        self._configured = self._connected = False
        self._incoming = bytearray()
        self._left = b""
        self._fragment = 0

    def describe(self, info: StreamInfo) -> bytes:
        """Take note of what is sampled from now on; a board says so when it is asked."""
        if self._connected and not self._logging:
            return b""  # a host is at it, and what it set holds
        self._info = info
        self._enabled = {kind for kind, axes in _AXES.items() if axes[0] in info.axes}
        return b""

    def encode(self, block: Block) -> bytes:
        """Return the packets of each sample."""
        if not len(block):
            return b""
        seconds = device_times(block, np.arange(len(block)), self._info.nominal_hz).tolist()
        head = {kind: _head(kind) for kind in self._enabled}
        columns = {
            kind: block.counts[:, [self._info.axes.index(axis) for axis in axes]].tolist()
            for kind, axes in _AXES.items()
            if kind in self._enabled
        }
        return b"".join(
            head[kind] + struct.pack("<d3h", time_s, *rows[i])
            for i, time_s in enumerate(seconds)
            for kind, rows in columns.items()
        )

    def receive(self, data: bytes) -> list[Command]:
        """Take bytes from the host and return the commands that they complete."""
        self._incoming += data
        commands: list[Command] = []
        while len(self._incoming) >= 4:
            (low,) = struct.unpack_from("<I", self._incoming)
            kind, length = low & 0xF, low >> 4 & 0x1FFF
            if _header(low & 0x0FFF_FFFF) != self._incoming[:4]:
                self._incoming.clear()  # what came with it is lost, too
                commands.append(Command("unknown", fields={"answer": "refusal"}))
            elif kind in (_BEACON, _PING):
                del self._incoming[:4]
                self._configured |= kind == _BEACON
                self._connected = self._configured and kind == _PING
                commands.append(Command("ping", fields={"payload": _control(low)}))
            elif len(self._incoming) < 4 + length:
                break
            else:
                content = bytes(self._incoming[8 : 4 + length])
                del self._incoming[: 4 + length]
                if self._connected:
                    commands.append(self._command(content))
        return commands

    def reply(self, command: Command, ok: bool = True) -> bytes:
        """Return the answer to a command."""
        if "payload" in command.fields:
            return bytes(command.fields["payload"])
        if command.fields.get("answer") == "refusal":
            return _header(_NACK | _BAD_HEADER << 8 | _BAD_HEADER << 16)
        if command.name == "describe":
            self._left = json.dumps(self._status()).encode() + b"\0"
            self._fragment = 0
        return self._response()

    def _response(self) -> bytes:
        """Return the next fragment of a response; one of nothing where nothing is left to say."""
        piece, rest = self._left[:_FRAGMENT], self._left[_FRAGMENT:]
        if not rest:
            inner = 2 << 5 | 1 << 8 | self._fragment << 16
        elif self._fragment == 0:
            inner = 2 << 5 | len(self._left) << 9
        else:
            inner = 2 << 5 | self._fragment << 16
        self._left, self._fragment = rest, self._fragment + 1 if rest else 0
        length = 4 + len(piece)
        return _header(_ANSWER | length << 4 | _SSTL << 17) + struct.pack("<I", inner) + piece

    def _command(self, content: bytes) -> Command:
        if not content:
            return Command("unknown", fields={"answer": "next"})
        try:
            said = json.loads(content.partition(b"\0")[0])
        except ValueError:
            return Command("unknown")
        name, value = next(iter(said.items())) if isinstance(said, dict) and said else ("", None)
        kind = name.rpartition("_")[2]
        if kind in _AXES and isinstance(value, dict) and not self._logging:
            return self._set(kind, value)
        if name == "log_controller*start_log":
            return self._start()
        self._logging &= name != "log_controller*stop_log"
        return _PLAIN.get(name, Command("unknown"))

    def _start(self) -> Command:
        axes = tuple(axis for axis in AXES if _KIND[axis] in self._enabled)
        if self._logging or not axes:
            return Command("unknown")
        self._logging = True
        return Command("start", fields={"axes": axes})

    def _set(self, kind: str, value: dict[str, Any]) -> Command:
        part, fields = self._part, {}
        if "enable" in value:
            (self._enabled.add if value["enable"] else self._enabled.discard)(kind)
        if "odr" in value:
            fields["rate_hz"] = part.rates_hz[value["odr"]]
            self._info = replace(self._info, nominal_hz=fields["rate_hz"])
        if "fs" in value:
            scales = part.gyro_scales if kind == "gyro" else part.accel_scales
            full_scale = list(scales)[value["fs"]]
            fields["gyro_fs" if kind == "gyro" else "accel_fs"] = full_scale
            old = zip(self._info.axes, self._info.scale, strict=True)
            new = (scales[full_scale] if axis in _AXES[kind] else scale for axis, scale in old)
            self._info = replace(self._info, scale=tuple(new))
        return Command("set", fields=fields)

    @property
    def _part(self) -> Part:
        return part_named(self._info.part if self._info.part in PARTS else "LSM6DSM")

    def _status(self) -> dict[str, Any]:
        info, part = self._info, self._part
        components: list[dict[str, Any]] = []
        for kind, axes in _AXES.items():
            scales = part.gyro_scales if kind == "gyro" else part.accel_scales
            scale = dict(zip(info.axes, info.scale, strict=True)).get(axes[0], scales[min(scales)])
            near = [i for i, step in enumerate(scales.values()) if abs(step / scale - 1) < 1e-3]
            off = [abs(rate - info.nominal_hz) for rate in part.rates_hz]
            odr = [off.index(min(off))] if min(off) < 0.01 * info.nominal_hz else []
            status = {
                "enable": kind in self._enabled,
                "data_type": "int16_t",
                "dimensions": 3,
                "short_unit": "dps" if kind == "gyro" else "g",
                **({"odr": odr[0]} if odr else {}),
                **({"fs": near[0]} if near else {}),
                "measured_odr": info.nominal_hz,
                "sensitivity": float(np.float32(scale)),
                "annotation": "",
                "output_st_stream": {
                    "channel_specification": {"interface": 3, "stream_id": _CHANNELS[kind]},
                    "payload_specification": _PAYLOAD,
                },
            }
            components.append({f"{part.name.lower()}_{kind}": status})
        components.append({"log_controller": {"log_status": self._logging, "c_type": 2}})
        about = {"firmware_name": "SDATALOG", "firmware_version": "1.0.0"}
        components.append({"device_information": about})
        device = {"board_id": 13, "fw_id": 21, "sn": "00112233445566778899AABB"}
        return {"schema_version": "3.0.0", "devices": [{**device, "components": components}]}


_PAYLOAD = {
    name: {"data_type": kind, "dimensions": 1, "unit": unit, "short_unit": unit, "labels": name}
    for name, kind, unit in (
        ("timestamp", "double", "s"),
        ("x", "int16_t", ""),
        ("y", "int16_t", ""),
        ("z", "int16_t", ""),
    )
}


def _head(kind: str) -> bytes:
    """Return both headers of a sample's packet."""
    inner = 4 << 5 | 1 << 8 | _CHANNELS[kind] << 9
    return _header(_DATA | (4 + 14) << 4 | _SSTL << 17) + struct.pack("<I", inner)


def _control(low: int) -> bytes:
    """Return the answer to a beacon, what the board can do, or to a ping: it is connected."""
    if low & 0xF == _BEACON:
        return _header(_BEACON | 63 << 8 | 127 << 14 | 127 << 21)
    return _header(_PING | 0x30 | low & 0x0FFF_F000)
