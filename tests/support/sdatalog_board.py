"""A board with ST's SDATALOG firmware at the far end of a pseudo-terminal, as ST's sources behave.

It shares no code with the program: the CRC is by ST's table of nibbles, a status is of the length
that a STEVAL-MKBOXPRO sends, in two fragments. Like the board it reads one packet at a time: its
receiver is armed again when it has answered, and what came in between is lost (`overruns`). A
wrong header is refused, and then it listens no more.
"""

from __future__ import annotations

import json
import os
import struct
import threading
from typing import Any

from support.pty_device import Device

NIBBLES = bytes.fromhex("00070e090b0c0502 01060f080a0d0403")
FRAGMENT = 4092
GYRO, ACCEL = "lsm6dsv16x_gyro", "lsm6dsv16x_acc"


def header(low: int) -> bytes:
    """Return a header with its CRC."""
    crc = 0
    for place in range(7):
        crc = NIBBLES[crc ^ (low >> 4 * place & 15)]
    return (low | crc << 28).to_bytes(4, "little")


def packet(kind: int, inner: int, content: bytes = b"") -> bytes:
    """Return a data packet or a response."""
    return header(kind | (len(content) + 4) << 4 | 7 << 17) + struct.pack("<I", inner) + content


def sample(channel: int, time_s: float, counts: tuple[int, int, int]) -> bytes:
    """Return the packet of one sample of one sensor."""
    return packet(0x9, 0x180 | channel << 9, struct.pack("<d3h", time_s, *counts))


class Board:
    """The firmware, in a thread; `samples` of each sensor are sent once it is told to start.

    Parameters
    ----------
    device : Device
        The far end.
    samples : int
    lost : set of int
        Samples that it leaves out, because it is busy sending: it has no place to keep them.
    """

    def __init__(self, device: Device, samples: int, lost: set[int]) -> None:
        self.asked: list[Any] = []
        self.overruns = 0
        self.wedged = False
        self.stopped = threading.Event()
        self._device = device
        self._samples, self._lost = samples, lost
        self._near = device._ends[0]
        self._status: dict[str, dict[str, Any]] = {
            ACCEL: {"enable": False, "odr": 5, "fs": 1, "sensitivity": 0.000122, "stream": 0},
            GYRO: {"enable": False, "odr": 5, "fs": 5, "sensitivity": 0.14, "stream": 1},
            "lsm6dsv16x_mlc": {"enable": True, "stream": 2},
        }
        self._logging = self._configured = self._connected = False
        self._left, self._fragment = b"", 0
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while not self.stopped.is_set():
            try:
                head = self._read(4)
                (low,) = struct.unpack("<I", head)
                if header(low & 0x0FFFFFFF) != head:
                    self.wedged = True
                    self._say(header(0xF | 4 << 8 | 4 << 16))
                    return
                self._take(low)
            except OSError:
                return

    def _waiting(self) -> int:
        """Return how many bytes came before the receiver was armed again."""
        os.set_blocking(self._near, False)
        try:
            return len(os.read(self._near, 100))
        except BlockingIOError:
            return 0
        finally:
            os.set_blocking(self._near, True)

    def _take(self, low: int) -> None:
        kind = low & 15
        payload = self._read(low >> 4 & 0x1FFF) if kind == 9 else b""
        self.overruns += self._waiting()
        if kind == 5:
            self._configured, self._connected = True, False
            self._say(header(5 | 63 << 8 | 127 << 14 | 127 << 21))
        elif kind == 6:
            self._connected = self._configured
            self._say(header(6 | 3 << 4))
        elif self._connected:
            self._request(payload[4:])

    def _request(self, content: bytes) -> None:
        started = False
        if content:
            assert content.endswith(b"\0"), "a C string has a zero"
            said = json.loads(content[:-1])
            self.asked.append(said)
            ((name, value),) = said.items()
            if name == "get_status":
                self._left, self._fragment = json.dumps(self._all()).encode() + b"\0", 0
            elif name == "log_controller*start_log":
                started = self._logging = True
            elif name == "log_controller*stop_log":
                self._logging = False
                self.stopped.set()
            else:
                self._status[name] |= value
                full_scales = 0.0175 if name == GYRO else 0.000061
                if "fs" in value:
                    self._status[name]["sensitivity"] = full_scales
        self._answer()
        if started:
            self._stream()

    def _answer(self) -> None:
        piece, self._left = self._left[:FRAGMENT], self._left[FRAGMENT:]
        if not self._left:
            self._say(packet(0xA, 0x140 | self._fragment << 16, piece))
        else:
            total = len(piece) + len(self._left)
            self._say(packet(0xA, 0x40 | total << 9, piece))
            self._fragment += 1

    def _stream(self) -> None:
        for i in range(self._samples):
            if i in self._lost:
                continue
            time_s = 0.5 + i / 238.0  # the part's own 240 Hz
            for name, later in ((ACCEL, 0.0), (GYRO, 90e-6)):
                status = self._status[name]
                if status["enable"]:
                    counts = (i % 1000, -i % 500, 16384 if name == ACCEL else 7)
                    self._say(sample(status["stream"], time_s + later, counts))

    def _all(self) -> dict[str, Any]:
        components: list[dict[str, Any]] = []
        for name, one in self._status.items():
            status = {
                **{key: value for key, value in one.items() if key != "stream"},
                "data_type": "int16_t",
                "measured_odr": 238.1,
                "annotation": "",
                "output_st_stream": {
                    "channel_specification": {"interface": 3, "stream_id": one["stream"]},
                    "payload_specification": {"t": "timestamp " * 140},
                },
            }
            components.append({name: status})
        components.append({"log_controller": {"log_status": self._logging}})
        components.append({"device_information": {"firmware_name": "SDATALOG"}})
        return {"devices": [{"board_id": 13, "sn": "0123", "components": components}]}

    def _say(self, data: bytes) -> None:
        while data:
            data = data[os.write(self._near, data) :]

    def _read(self, count: int) -> bytes:
        return self._device.heard(count)
