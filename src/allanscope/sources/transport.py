"""The links that bytes come over, behind one small interface.

pyserial's own `read` is not used where it can be avoided: a `read(n)` that has half of what it was
asked for when the device goes away throws that half away, and a socket's `in_waiting` only says
whether there is anything. What a link must do is: give what is there, as soon as it is there.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import sys
from contextlib import suppress
from typing import Any, Protocol
from urllib.parse import urlsplit

import serial

__all__ = ["LINK_ERRORS", "Transport", "WriteTimeoutError", "open_transport"]

READ_BYTES = 1 << 16
WRITE_TIMEOUT_S = 1.0
CONNECT_TIMEOUT_S = 5.0

try:
    from termios import error as _termios_error
except ImportError:  # Windows
    _termios_error = OSError  # type: ignore[misc, assignment]

LINK_ERRORS: tuple[type[Exception], ...] = (OSError, TypeError, _termios_error)
"""What a link that has gone away may raise. `SerialException` is an OSError, ``termios.error`` is
none, and a port that another thread has closed raises TypeError."""


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
        """Let go of it; never raises."""


def open_transport(name: str, baud: int) -> Transport:
    """Open a device path or a pyserial URL.

    What waits in the buffer of the port is kept: it may hold the header of a text stream, which is
    said once. Data terminal ready is asserted while opening, because CDC firmware may wait for it;
    pseudo-terminals, which have no such line, are forgiven.

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
    return _Polled(port) if is_url or sys.platform == "win32" else _Posix(port)


class _Port(serial.Serial):
    """A port that keeps what waits in it when it is opened."""

    def _reset_input_buffer(self) -> None:
        """Throw nothing away; pyserial calls this while it opens a port, where not on Windows."""


class _Posix:
    """A serial port on a system where a file descriptor says when there is something to read."""

    def __init__(self, port: Any) -> None:
        self._port = port

    def read(self, timeout_s: float) -> bytes:
        fd = self._port.fileno()
        if not select.select([fd], [], [], timeout_s)[0]:
            return b""
        data = os.read(fd, READ_BYTES)
        if not data:
            raise OSError(errno.EIO, "the device has hung up")
        return data

    def write(self, data: bytes) -> None:
        _write(self._port, data)

    def close(self) -> None:
        _close(self._port)


class _Polled:
    """Any other port that pyserial knows: Windows, rfc2217, loop, spy."""

    def __init__(self, port: Any) -> None:
        self._port = port

    def read(self, timeout_s: float) -> bytes:
        if self._port.timeout != timeout_s:
            self._port.timeout = timeout_s
        data: bytes = self._port.read(self._port.in_waiting or 1)
        return data

    def write(self, data: bytes) -> None:
        _write(self._port, data)

    def close(self) -> None:
        _close(self._port)


class _Socket:
    """A byte stream over TCP, e.g. a serial port of another machine."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        if not parts.hostname or parts.port is None:
            raise ValueError(f"{url} is no address; write socket://HOST:PORT")
        self._socket = socket.create_connection((parts.hostname, parts.port), CONNECT_TIMEOUT_S)
        self._socket.settimeout(WRITE_TIMEOUT_S)

    def read(self, timeout_s: float) -> bytes:
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return b""
        data = self._socket.recv(READ_BYTES)
        if not data:
            raise ConnectionResetError(errno.ECONNRESET, "the other side has hung up")
        return data

    def write(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except TimeoutError as error:
            raise WriteTimeoutError from error

    def close(self) -> None:
        self._socket.close()


def _write(port: Any, data: bytes) -> None:
    try:
        port.write(data)
    except serial.SerialTimeoutException as error:
        raise WriteTimeoutError from error


def _close(port: Any) -> None:
    with suppress(*LINK_ERRORS):  # the device is gone, and the descriptor with it
        port.close()
