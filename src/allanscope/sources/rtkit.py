"""Real-time priority from RealtimeKit, where the system gives a user none.

Desktops of Linux run this service for their sound. It lets a process of a user have real-time
priority if that process has limited the time that it runs without a pause (``RLIMIT_RTTIME``). One
call over D-Bus asks for it, written out here because the standard library does not speak D-Bus::

    AUTH EXTERNAL ─▶ OK ─▶ BEGIN ─▶ Hello ─▶ MakeThreadRealtimeWithPID(process, thread, priority)

Facts: the D-Bus Specification (dbus.freedesktop.org), and rtkit's interface
``org.freedesktop.RealtimeKit1``.
"""

from __future__ import annotations

import os
import socket
import struct

__all__ = ["make_real_time"]

_USUAL_BUS = "/run/dbus/system_bus_socket"
_PATIENCE_S = 1.0
_CALL, _RETURN, _ERROR = 1, 2, 3
_PATH, _INTERFACE, _MEMBER, _DESTINATION, _SIGNATURE = 1, 2, 3, 6, 8
_HEADER = 16


def make_real_time(process: int, priority: int) -> bool:
    """Return whether the service gave the first thread of a process real-time priority (SCHED_RR).

    Parameters
    ----------
    process : int
        Of the same user, with limits ``RLIMIT_RTTIME`` of at most 200,000 us, the hard one too.
    priority : int
        1 to 20.
    """
    try:
        with socket.socket(socket.AF_UNIX) as bus:
            bus.settimeout(_PATIENCE_S)
            bus.connect(_address())
            # Who we are the bus knows from the socket; it wants to hear the same of us.
            bus.sendall(b"\0AUTH EXTERNAL " + str(os.getuid()).encode().hex().encode() + b"\r\n")
            if not bus.recv(256).startswith(b"OK "):
                return False
            bus.sendall(b"BEGIN\r\n" + _call(1, "org.freedesktop.DBus", "Hello"))
            if not _succeeded(bus):
                return False
            asked = struct.pack("<QQI", process, process, priority)
            name = "org.freedesktop.RealtimeKit1"
            bus.sendall(_call(2, name, "MakeThreadRealtimeWithPID", "ttu", asked))
            return _succeeded(bus)
    except (OSError, AttributeError):  # no such service, no bus, or no such sockets
        return False


def _address() -> str:
    kind, _, path = os.environ.get("DBUS_SYSTEM_BUS_ADDRESS", "").partition("unix:path=")
    return path.partition(",")[0] if path and not kind else _USUAL_BUS


def _call(
    serial: int, service: str, member: str, signature: str = "", arguments: bytes = b""
) -> bytes:
    """Return a method call to the object of a service that is named after it."""
    texts = (
        (_PATH, "o", "/" + service.replace(".", "/")),
        (_INTERFACE, "s", service),
        (_MEMBER, "s", member),
        (_DESTINATION, "s", service),
    )
    fields = b""
    for code, kind, text in texts:
        fields = _padded(fields) + bytes((code, 1, ord(kind), 0))
        fields += struct.pack("<I", len(text)) + text.encode() + b"\0"
    if signature:
        told = bytes((len(signature),)) + signature.encode() + b"\0"
        fields = _padded(fields) + bytes((_SIGNATURE, 1, ord("g"), 0)) + told
    head = struct.pack("<cBBBIII", b"l", _CALL, 0, 1, len(arguments), serial, len(fields))
    return _padded(head + fields) + arguments


def _succeeded(bus: socket.socket) -> bool:
    """Wait for the answer to the one call that is under way; signals pass by."""
    while True:
        head = _received(bus, _HEADER)
        order = "<" if head[:1] == b"l" else ">"
        body, _, fields = struct.unpack_from(f"{order}III", head, 4)
        _received(bus, fields + -fields % 8 + body)
        if head[1] in (_RETURN, _ERROR):
            return head[1] == _RETURN


def _received(bus: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        more = bus.recv(size - len(data))
        if not more:
            raise ConnectionResetError
        data += more
    return data


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 8)
