"""The links that bytes come over, behind one small interface.

pyserial's own `read` is not used where it can be avoided: a `read(n)` that has half of what it was
asked for when the device disconnects throws that half away, and a socket's `in_waiting` only says
whether there is anything. What a link must do is: give what is there, as soon as it is there.

Why a port cannot be opened is one line that says what to do about it (`open_error`).
"""

from __future__ import annotations

import errno
import os
import select
import socket
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

import serial

from allanscope.errors import DeviceError
from allanscope.sources.discovery import PortDescription, plugged_in

__all__ = [
    "LINK_ERRORS",
    "PosixPort",
    "Transport",
    "WriteTimeoutError",
    "open_error",
    "open_transport",
]

READ_BYTES = 1 << 16
WRITE_TIMEOUT_S = 1.0
CONNECT_TIMEOUT_S = 5.0
_TIOCGSERIAL, _TIOCSSERIAL = 0x541E, 0x541F
_ASYNC_LOW_LATENCY, _FLAGS_AT, _SERIAL_STRUCT_BYTES = 1 << 13, 16, 128
"""Of ``linux/serial.h``: the flag, where `flags` stand in ``serial_struct``, and room for it."""

try:
    from termios import error as _termios_error
except ImportError:  # Windows
    _termios_error = OSError  # type: ignore[misc, assignment]

LINK_ERRORS: tuple[type[Exception], ...] = (OSError, TypeError, _termios_error)
"""What a link that has gone away may raise. `SerialException` is an OSError, ``termios.error`` is
none, and a port that another thread has closed raises TypeError."""
_MISSING = {errno.ENOENT, errno.ENODEV, errno.ENXIO}
_DENIED = {errno.EACCES, errno.EPERM}
_BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}
_NO_TTY = {errno.ENOTTY, errno.EINVAL, errno.EISDIR}


class WriteTimeoutError(Exception):
    """The device does not take what is written to it."""


class Transport(Protocol):
    """An open link. One thread reads, another may write."""

    def read(self, timeout_s: float) -> bytes:
        """Return what is there, waiting for the first byte at most this long; b"" if none came.

        Raises one of `LINK_ERRORS` when the other side has gone.
        """

    def write(self, data: bytes) -> None:
        """Send all of it; WriteTimeoutError if that takes too long."""

    def close(self) -> None:
        """Release it; never raises."""


def open_transport(name: str, baud: int) -> Transport:
    """Open a device path or a pyserial URL.

    What waits in the buffer of the port is kept: it may hold the header of a text stream, which is
    said once. Data terminal ready is asserted while opening, because CDC firmware may wait for it;
    pseudo-terminals, which have no such line, are forgiven. A driver that gathers bytes is asked
    not to (`_low_latency`).

    Raises
    ------
    OSError, termios.error, ValueError
        As the system or pyserial says it.
    """
    if name.startswith("socket://"):
        return _Socket(name)
    is_url = "://" in name
    if is_url:
        port = serial.serial_for_url(
            name, do_not_open=True, baudrate=baud, write_timeout=WRITE_TIMEOUT_S
        )
    else:
        port = _Port(baudrate=baud, write_timeout=WRITE_TIMEOUT_S)
        port.port = name
    port.dtr = True
    if not is_url:
        port.exclusive = None if sys.platform == "win32" else True
    port.open()
    return _PolledPort(port) if is_url or sys.platform == "win32" else PosixPort(port)


class _Port(serial.Serial):
    """A port that keeps what waits in it when it is opened."""

    def _reset_input_buffer(self) -> None:
        """Throw nothing away; pyserial calls this while it opens a port, where not on Windows."""


def _low_latency(fd: int) -> bool:
    """Ask the driver of a port to hand on bytes at once; return whether it has that mode.

    The drivers of UARTs and of FTDI's bridges have it, which else gather for up to 16 ms; USB CDC
    needs none, and pseudo-terminals have no such call.
    """
    if not sys.platform.startswith("linux"):
        return False
    import fcntl

    try:
        settings = bytearray(fcntl.ioctl(fd, _TIOCGSERIAL, bytes(_SERIAL_STRUCT_BYTES)))
        (flags,) = struct.unpack_from("i", settings, _FLAGS_AT)
        struct.pack_into("i", settings, _FLAGS_AT, flags | _ASYNC_LOW_LATENCY)
        fcntl.ioctl(fd, _TIOCSSERIAL, bytes(settings))
        # Drivers that do not know the flag take it without a word.
        settings = bytearray(fcntl.ioctl(fd, _TIOCGSERIAL, bytes(_SERIAL_STRUCT_BYTES)))
    except OSError:
        return False
    return bool(struct.unpack_from("i", settings, _FLAGS_AT)[0] & _ASYNC_LOW_LATENCY)


class _OpenPort:
    """The end of a link that pyserial has opened: what is sent, and its release."""

    def __init__(self, port: Any) -> None:
        self._port = port

    def write(self, data: bytes) -> None:
        """Send all of it."""
        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise WriteTimeoutError from error

    def close(self) -> None:
        """Release the port."""
        with suppress(*LINK_ERRORS):  # the device is gone, and the descriptor with it
            self._port.close()


class PosixPort(_OpenPort):
    """A serial port on a system where a file descriptor says when there is something to read.

    Attributes
    ----------
    low_latency : bool
        Whether its driver was told to hand on bytes at once.
    """

    def __init__(self, port: Any) -> None:
        super().__init__(port)
        self.low_latency = _low_latency(int(port.fileno()))

    def fileno(self) -> int:
        """Return the descriptor of the open port."""
        return int(self._port.fileno())

    def queued(self) -> int:
        """Return how many bytes can be read at once."""
        return int(self._port.in_waiting)

    def read(self, timeout_s: float) -> bytes:
        """Return what is there, waiting for the first byte at most this long."""
        fd = self._port.fileno()
        if not select.select([fd], [], [], timeout_s)[0]:
            return b""
        data = os.read(fd, READ_BYTES)
        if not data:
            raise OSError(errno.EIO, "the device closed the connection")
        return data


class _PolledPort(_OpenPort):
    """Any other port that pyserial knows: Windows, rfc2217, loop, spy."""

    def read(self, timeout_s: float) -> bytes:
        if self._port.timeout != timeout_s:
            self._port.timeout = timeout_s
        data: bytes = self._port.read(self._port.in_waiting or 1)
        return data


class _Socket:
    """A byte stream over TCP, e.g. a serial port of another machine."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        if not parts.hostname or parts.port is None:
            raise ValueError(f"{url} is not an address; write socket://HOST:PORT")
        self._socket = socket.create_connection((parts.hostname, parts.port), CONNECT_TIMEOUT_S)
        self._socket.settimeout(WRITE_TIMEOUT_S)

    def read(self, timeout_s: float) -> bytes:
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return b""
        data = self._socket.recv(READ_BYTES)
        if not data:
            raise ConnectionResetError(errno.ECONNRESET, "the other side closed the connection")
        return data

    def write(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except TimeoutError as error:
            raise WriteTimeoutError from error

    def close(self) -> None:
        self._socket.close()


def open_error(name: str, error: Exception, ports: list[PortDescription]) -> DeviceError:
    """Return the error to raise when `name` could not be opened.

    Parameters
    ----------
    name : str
        Path or URL.
    error : Exception
        What the system or pyserial said.
    ports : list of PortDescription
        What is plugged in.
    """
    reason = _reason(error)
    if "://" in name:
        return DeviceError(f"cannot open {name}: {_words(error)}; is the other side running?")
    if reason in _MISSING:
        return DeviceError(
            f"no such port {name}; {plugged_in(ports)}; "
            "see `allanscope ports`, or try: allanscope live sim"
        )
    if reason in _DENIED:
        return DeviceError(f"no permission to open {name}: {_permission_advice(name)}")
    if reason in _BUSY:
        return DeviceError(f"{name} is in use by {_holders(name)}")
    if reason in _NO_TTY:
        return DeviceError(f"{name} is not a serial port; see `allanscope ports`")
    return DeviceError(f"cannot open {name}: {_words(error)}")


def _reason(error: Exception) -> int | None:
    """Return the errno behind an error; pyserial leaves it out, or tells it in words."""
    number = getattr(error, "errno", None)
    if number is None and error.args and isinstance(error.args[0], int):
        number = error.args[0]  # termios.error
    if number is not None:
        return int(number)
    text = str(error)
    for words, meaning in (
        ("FileNotFoundError", errno.ENOENT),  # Windows
        ("PermissionError", errno.EBUSY),  # Windows says so when another program has it
        ("Inappropriate ioctl", errno.ENOTTY),
        ("Could not configure port", errno.ENOTTY),
    ):
        if words in text:
            return meaning
    return None


def _words(error: Exception) -> str:
    """Return what went wrong, on one line."""
    strerror = getattr(error, "strerror", None)
    return " ".join(str(strerror or error).split())


def _permission_advice(name: str) -> str:
    group = "dialout"
    try:
        import grp

        group = grp.getgrgid(os.stat(name).st_gid).gr_name
    except (ImportError, KeyError, OSError):
        pass
    if group == "root":
        return "add a udev rule that gives it to a group of yours"
    return f"run `sudo usermod -aG {group} $USER` and log in again, or add a udev rule"


def _holders(name: str) -> str:
    """Return which programs have a file open, as far as the system lets us see, and what to do."""
    target = os.path.realpath(name)
    found = set()
    for process in Path("/proc").glob("[0-9]*"):
        try:  # one that ends meanwhile takes its files with it
            if any(os.path.realpath(link) == target for link in (process / "fd").iterdir()):
                program = (process / "comm").read_text("utf-8", "replace").strip()
                found.add(f"{program} (pid {process.name})")
        except OSError:
            continue
    if found:
        return f"{', '.join(sorted(found))}; end that and try again"
    return (
        "another program; ModemManager does so for some seconds after plugging in: try again, "
        "or look with `lsof`"
    )
