"""The host's side of the link: connect, ask what there is, switch on what is wanted, start.

::

    beacon ─▶ ping ─▶ get_status ─▶ enable, fs, odr of two sensors ─▶ get_status ─▶ start_log

A board listens for one packet at a time: what comes before it has answered the last one is lost. So
nothing is sent but in answer to an answer; where one is lost the board stays silent, the stall is
noticed, and the beacon begins all over. A response in fragments goes on when the host says so.
"""

from __future__ import annotations

import json
from collections import deque

from allanscope.parts import PARTS
from allanscope.wire.base import WireSettings
from allanscope.wire.sdatalog import packets
from allanscope.wire.sdatalog.packets import Packet
from allanscope.wire.sdatalog.status import Sensor, Status, read_status

__all__ = ["STATUS", "STOP", "Conversation"]

STATUS = json.dumps({"get_status": "all"})
STOP = json.dumps({"log_controller*stop_log": ""})
_SERIAL = 3
_START = json.dumps({"log_controller*start_log": {"interface": _SERIAL}})

_LONGEST_RESPONSE = 1 << 16
_PATIENCE = 4
"""Beacons, and requests after a refusal, until it is given up."""
_NEAR = 0.05


class Conversation:
    """What is to be sent to a board, from what it answers.

    Parameters
    ----------
    settings : WireSettings
        Rate, full scales and part, where the user gave them.

    Attributes
    ----------
    status : Status or None
        The last that the board said of itself.
    """

    def __init__(self, settings: WireSettings) -> None:
        self._settings = settings
        self.status: Status | None = None
        self.reset()

    def reset(self) -> None:
        """Forget what was under way; what the board said of itself holds until it says more."""
        self._requests: deque[str] = deque()
        self._last = b""
        self._tries = 0
        self._configured = False
        self._fragments = bytearray()
        self._outgoing: list[bytes] = []

    def answers(self) -> list[bytes]:
        """Return what is to be sent now, each in a single write."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def ask_for_status(self) -> None:
        """Ask a board that streams already, and is connected, what it sends."""
        self._say(packets.request(STATUS))

    def take(self, packet: Packet) -> bytes | None:
        """Take a packet that is no data of a sensor; return a response that it completes."""
        if packet.type == packets.BEACON:
            self._beacon(packet)
        elif packet.type == packets.PING:
            self._configured = False
            self._requests.clear()
            self.ask_for_status()
        elif packet.type == packets.REFUSAL:
            self._tries += 1
            if self._last and self._tries < _PATIENCE:
                self._say(self._last)
        elif packet.kind == packets.RESPONSE:
            return self._response(packet)
        return None

    def _beacon(self, packet: Packet) -> None:
        theirs = packets.capabilities(packet.header)
        if theirs == packets.capabilities(int.from_bytes(packets.beacon(), "little")):
            self._say(packets.ping())
        elif self._tries < _PATIENCE:
            # It can do less, and connects only with a host that asks for no more.
            self._tries += 1
            self._say(packets.beacon(theirs))
            if self._tries > 1:
                self._say(packets.ping())

    def _response(self, packet: Packet) -> bytes | None:
        self._tries = 0
        self._fragments += packet.content
        if len(self._fragments) > _LONGEST_RESPONSE:
            self._fragments.clear()
            return None
        if not packet.last:
            self._say(packets.request())
            return None
        whole = bytes(self._fragments)
        self._fragments.clear()
        status = read_status(whole, self._settings.part) if whole else None
        if status is not None:
            self.status = status
            self._plan(status)
        if self._requests:
            self._say(packets.request(self._requests.popleft()))
        return whole

    def _plan(self, status: Status) -> None:
        """Put what is to be asked of the board into the queue, once for each connection."""
        if status.logging or not status.sensors:
            return
        if self._configured:
            self._requests.append(_START)
            return
        self._configured = True
        for component in status.others:
            self._requests.append(json.dumps({component: {"enable": False}}))
        for sensor in status.sensors:
            for name, value in {**_wanted(sensor, self._settings), "enable": True}.items():
                self._requests.append(json.dumps({sensor.component: {name: value}}))
        self._requests.append(STATUS)

    def _say(self, message: bytes) -> None:
        self._last = message
        self._outgoing.append(message)


def _wanted(sensor: Sensor, settings: WireSettings) -> dict[str, int]:
    """Return what the user asked for, as places in the lists of what the part can do."""
    part = PARTS.get(sensor.part)
    if part is None:
        return {}
    wanted: dict[str, int] = {}
    full_scale = settings.gyro_fs if sensor.kind == "gyro" else settings.accel_fs
    scales = list(part.gyro_scales if sensor.kind == "gyro" else part.accel_scales)
    if full_scale in scales:
        wanted["fs"] = scales.index(full_scale)
    rate = settings.rate_hz
    if rate is not None:
        nearest = min(part.rates_hz, key=lambda one: abs(one - rate))
        if abs(nearest - rate) <= _NEAR * nearest:
            wanted["odr"] = part.rates_hz.index(nearest)
    return wanted
