"""Which serial ports there are, and which of them is the board.

A SensorTile is a USB CDC device of ST's stock vendor and product number; a Nucleo's virtual port
belongs to its ST-LINK. Nothing is opened or written to find out: a probe would disturb whatever
else is plugged in.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from allanscope.errors import DeviceError
from allanscope.sanitize import sanitize

__all__ = ["Comports", "PortDescription", "auto_port", "describe_ports", "find_ports"]

Comports = Callable[[], Iterable[Any]]
"""Lists ports as `serial.tools.list_ports.comports` does."""

ST = 0x0483
SENSORTILE = 0x5740
ST_LINKS = (0x374A, 0x374B, 0x374E, 0x374F, 0x3752, 0x3753, 0x3754, 0x3757)

_KINDS = {
    SENSORTILE: "SensorTile, or another STM32 with a virtual COM port",
    **dict.fromkeys(ST_LINKS, "ST-LINK virtual COM port"),
}
_RANKS = {product: rank for rank, product in enumerate(_KINDS)}
_UNKNOWN = len(_RANKS)


@dataclass(frozen=True, slots=True)
class PortDescription:
    """A serial port, with what its USB descriptors say; empty where they say nothing.

    Attributes
    ----------
    device : str
        The path or name to open; it may change when the board is plugged in again.
    vendor, product : int or None
        USB numbers; None for a port that is not on USB.
    serial_number, manufacturer, model, location : str
        As the device and the system tell.
    stable_path : str
        A path that stays the same for this device, under /dev/serial/by-id.
    """

    device: str
    vendor: int | None = None
    product: int | None = None
    serial_number: str = ""
    manufacturer: str = ""
    model: str = ""
    location: str = ""
    stable_path: str = ""

    @property
    def kind(self) -> str:
        """What we take it for; empty when it is none of ours."""
        return _KINDS.get(self.product or 0, "") if self.vendor == ST else ""

    @property
    def usb_id(self) -> str:
        """Vendor and product number, e.g. ``0483:5740``; empty when it is not on USB."""
        if self.vendor is None or self.product is None:
            return ""
        return f"{self.vendor:04x}:{self.product:04x}"

    def facts(self) -> dict[str, str]:
        """Return what is known, for the metadata of a recording."""
        facts = {
            "port": self.device,
            "usb_id": self.usb_id,
            "serial_number": self.serial_number,
            "manufacturer": self.manufacturer,
            "model": self.model,
            "stable_path": self.stable_path,
        }
        return {key: value for key, value in facts.items() if value}

    def is_same_device(self, other: PortDescription) -> bool:
        """Return whether the other port is this device, plugged in again perhaps.

        Devices without a serial number are distinguished by the socket they are plugged into.
        """
        if self.vendor is None or (self.vendor, self.product) != (other.vendor, other.product):
            return False
        if self.serial_number or other.serial_number:
            return self.serial_number == other.serial_number
        return not self.location or self.location == other.location

    def __str__(self) -> str:
        told = [self.usb_id, self.manufacturer, self.model]
        if self.serial_number:
            told.append(f"serial {self.serial_number}")
        line = f"{self.device}  {self.kind}".rstrip()
        return f"{line}  ({', '.join(text for text in told if text)})" if any(told) else line


def find_ports(comports: Comports | None = None) -> list[PortDescription]:
    """Return all serial ports, the most likely boards first.

    Boards of the same kind are ordered by serial number, then by name, so that the choice does not
    depend on the order of plugging in. A macOS port that has a ``cu`` and a ``tty`` name is listed
    by the first, because opening the second waits for a carrier.
    """
    infos = list((comports or _comports)())
    names = {info.device for info in infos}
    stable = _stable_paths()
    ports = [
        PortDescription(
            device=info.device,
            vendor=info.vid,
            product=info.pid,
            serial_number=sanitize(info.serial_number or ""),
            manufacturer=sanitize(info.manufacturer or ""),
            model=sanitize(info.product or ""),
            location=sanitize(info.location or ""),
            stable_path=stable.get(os.path.realpath(info.device), ""),
        )
        for info in infos
        if info.device.replace("/dev/tty.", "/dev/cu.") not in names - {info.device}
    ]
    return sorted(ports, key=_order)


def auto_port(comports: Comports | None = None) -> PortDescription:
    """Return the board.

    Raises
    ------
    DeviceError
        If there is none; the message says what was looked for and what is there.
    """
    ports = find_ports(comports)
    if ports and ports[0].kind:
        return ports[0]
    raise DeviceError(
        f"no board found; looked for USB {ST:04x}:{SENSORTILE:04x} (SensorTile) and "
        f"{ST:04x}:{'/'.join(f'{product:04x}' for product in ST_LINKS)} (ST-LINK); "
        f"{plugged_in(ports)}; name a port, or try: allanscope live sim"
    )


def describe_ports(comports: Comports | None = None) -> list[str]:
    """Return one line for each port and sensor of IIO, and one that says what `auto` takes."""
    from allanscope.sources.iio.devices import find_iio_sensors

    ports = find_ports(comports)
    try:
        choice = f"auto takes {auto_port(comports).device}"
    except DeviceError as error:
        choice = str(error)
    return [*(str(port) for port in ports), *(str(one) for one in find_iio_sensors()), choice]


def plugged_in(ports: list[PortDescription]) -> str:
    """Return what is there, for an error message."""
    if not ports:
        return "no serial port was found"
    return "found: " + ", ".join(port.device for port in ports)


def _order(port: PortDescription) -> tuple[int, str, list[tuple[int, str]]]:
    rank = _RANKS.get(port.product or 0, _UNKNOWN) if port.vendor == ST else _UNKNOWN
    pieces = re.split(r"(\d+)", port.device)
    natural = [(int(piece), "") if piece.isdigit() else (-1, piece) for piece in pieces]
    return rank, port.serial_number, natural


def _comports() -> Iterable[Any]:
    from serial.tools.list_ports import comports

    return comports()


def _stable_paths() -> dict[str, str]:
    folder = Path("/dev/serial/by-id")
    if not folder.is_dir():
        return {}
    return {os.path.realpath(link): str(link) for link in sorted(folder.iterdir())}
