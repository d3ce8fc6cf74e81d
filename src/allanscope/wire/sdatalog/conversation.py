"""The host's side of the link: connect, ask what there is, switch on what is wanted, start.

::

    beacon ─▶ ping ─▶ get_status ─▶ enable, fs, odr of two sensors ─▶ get_status ─▶ start_log

A board listens for one packet at a time: what comes before it has answered the last one is lost. So
nothing is sent but in answer to an answer; where one is lost the board stays silent, the stall is
noticed, and the beacon begins all over. A response in fragments goes on when the host says so.

A status is JSON of components, of which gyroscope and accelerometer count::

    {"devices": [{"board_id": ..., "fw_id": ..., "sn": ..., "components": [
        {"lsm6dsv16x_gyro": {"enable": true, "sensitivity": 0.07, "odr": 5, "fs": 4,
                             "measured_odr": 240.1, "stream_id": 1, ...}}, ...]}]}

``odr`` and ``fs`` are places in the lists of what the part can do, the lowest first. The channel is
``stream_id``, in newer firmware within ``output_st_stream.channel_specification``.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from allanscope.parts import PARTS
from allanscope.sanitize import text_of
from allanscope.wire.base import WireSettings
from allanscope.wire.sdatalog import packets
from allanscope.wire.sdatalog.packets import Packet

__all__ = ["STATUS", "STOP", "Conversation", "Sensor", "Status", "read_status"]

Kind = Literal["gyro", "acc"]
_LARGEST_SCALE = 1.0
_MOST_CHANNELS = 128
_MOST_ROWS = 10_000


@dataclass(frozen=True, slots=True)
class Sensor:
    """One component that sends samples.

    Attributes
    ----------
    component : str
        Its name in requests.
    part : str
        Name of the part, in capitals.
    kind : {'gyro', 'acc'}
    channel : int
        On which its samples come.
    enabled : bool
    scale : float
        dps or g per count.
    rate_hz : float
        Rate that the board claims; 0.0 where it claims none.
    rows : int
        Samples for each time in binary data of HSDatalog; 0 where it does not say.
    """

    component: str
    part: str
    kind: Kind
    channel: int
    enabled: bool
    scale: float
    rate_hz: float
    rows: int = 0


@dataclass(frozen=True, slots=True)
class Status:
    """A board's answer to ``get_status``.

    Attributes
    ----------
    sensors : tuple of Sensor
        Gyroscope and accelerometer of one part: the first that has a gyroscope.
    others : tuple of str
        Components besides that are switched on.
    logging : bool
        Whether it streams.
    details : mapping
        What else it says of itself, as text.
    """

    sensors: tuple[Sensor, ...]
    others: tuple[str, ...]
    logging: bool
    details: Mapping[str, str]


def read_status(content: bytes, part: str = "") -> Status | None:
    """Return what a response says of the whole board, None where it is about something else.

    Parameters
    ----------
    content : bytes
        JSON, with or without a final zero.
    part : str
        The part that the user named, where there are several.
    """
    try:
        said = json.loads(content.rstrip(b"\0"))
    except (ValueError, RecursionError):
        return None
    devices = said.get("devices") if isinstance(said, dict) else None
    device = devices[0] if isinstance(devices, list) and devices else None
    if not isinstance(device, dict):
        return None
    components = dict(_components(device))
    found = [sensor for name, one in components.items() if (sensor := _sensor(name, one))]
    named = [sensor for sensor in found if sensor.part == part.upper()]
    gyros = [sensor for sensor in named or found if sensor.kind == "gyro"]
    chosen = (gyros or found)[0].part if found else ""
    sensors: dict[Kind, Sensor] = {}
    for sensor in found:
        if sensor.part == chosen:
            sensors.setdefault(sensor.kind, sensor)
    ours = {sensor.component for sensor in sensors.values()}
    others = [name for name, one in components.items() if one.get("enable") is True]
    controller = components.get("log_controller", {})
    return Status(
        sensors=tuple(sensors.values()),
        others=tuple(name for name in others if name not in ours),
        logging=controller.get("log_status") is True,
        details=dict(_details(device, components)),
    )


def _components(device: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    components = device.get("components")
    for component in components if isinstance(components, list) else ():
        for name, content in component.items() if isinstance(component, dict) else ():
            if isinstance(content, dict) and name.isidentifier() and name.isascii():
                yield name, content


def _sensor(name: str, content: Mapping[str, Any]) -> Sensor | None:
    part, _, kind = name.partition("_")
    # A part for shocks has two accelerometers, l for low and h for high g.
    kind = kind.removeprefix("l_")
    scale = _number(content.get("sensitivity"))
    channel = content.get("stream_id", _channel(content.get("output_st_stream")))
    if kind not in ("gyro", "acc") or content.get("data_type") not in ("int16", "int16_t"):
        return None
    if not 0.0 < scale < _LARGEST_SCALE or not isinstance(channel, int):
        return None
    if not 0 <= channel < _MOST_CHANNELS:
        return None
    rate = _number(content.get("measured_odr"))
    rates = PARTS[part.upper()].rates_hz if part.upper() in PARTS else ()
    place = content.get("odr")
    if isinstance(place, int) and 0 <= place < len(rates):
        rate = rates[place]
    return Sensor(
        component=name,
        part=part.upper(),
        kind="gyro" if kind == "gyro" else "acc",
        channel=channel,
        enabled=content.get("enable") is True,
        scale=float(f"{scale:.6g}"),  # a float32 on the board
        rate_hz=rate if 0.0 < rate < 1e5 else 0.0,
        rows=int(min(max(_number(content.get("samples_per_ts")), 0.0), _MOST_ROWS)),
    )


def _channel(stream: object) -> object:
    inner = stream.get("channel_specification") if isinstance(stream, dict) else None
    return inner.get("stream_id") if isinstance(inner, dict) else None


def _number(value: object) -> float:
    if isinstance(value, dict):  # older firmware: with the limits of what may be set
        value = value.get("val")
    return float(value) if isinstance(value, int | float) and abs(value) < 1e30 else 0.0


def _details(
    device: Mapping[str, Any], components: Mapping[str, Mapping[str, Any]]
) -> Iterator[tuple[str, str]]:
    """Yield what is shown of the board: its firmware and its number."""
    about = {**components.get("firmware_info", {}), **components.get("device_information", {})}
    wanted = {"unique_id": device.get("sn")}
    for new, old in (("firmware_name", "fw_name"), ("firmware_version", "fw_version")):
        wanted[new] = about.get(new, about.get(old))
    for name, value in wanted.items():
        if isinstance(value, str) and (text := text_of(value.encode())):
            yield name, text


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
        self._send(packets.request(STATUS))

    def feed(self, packet: Packet) -> bytes | None:
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
                self._send(self._last)
        elif packet.kind == packets.RESPONSE:
            return self._response(packet)
        return None

    def _beacon(self, packet: Packet) -> None:
        theirs = packets.capabilities(packet.header)
        if theirs == packets.capabilities(int.from_bytes(packets.beacon(), "little")):
            self._send(packets.ping())
        elif self._tries < _PATIENCE:
            # It can do less, and connects only with a host that asks for no more.
            self._tries += 1
            self._send(packets.beacon(theirs))
            if self._tries > 1:
                self._send(packets.ping())

    def _response(self, packet: Packet) -> bytes | None:
        self._tries = 0
        self._fragments += packet.content
        if len(self._fragments) > _LONGEST_RESPONSE:
            self._fragments.clear()
            return None
        if not packet.last:
            self._send(packets.request())
            return None
        whole = bytes(self._fragments)
        self._fragments.clear()
        status = read_status(whole, self._settings.part) if whole else None
        if status is not None:
            self.status = status
            self._plan(status)
        if self._requests:
            self._send(packets.request(self._requests.popleft()))
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

    def _send(self, message: bytes) -> None:
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
