"""RealtimeKit as a bus sees it: the call byte by byte, and every way in which it is not granted."""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from allanscope.sources import isolated_reader, port_reader
from allanscope.sources.rtkit import make_real_time

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there is RealtimeKit on Linux")

RETURN, ERROR, SIGNAL = 2, 3, 4


def parsed(message: bytes) -> dict[str, Any]:
    """Read a call, by the D-Bus Specification's chapter on the message format."""
    kind, version = message[1], message[3]
    body, serial, fields = struct.unpack_from("<III", message, 4)
    found: dict[str, Any] = {"kind": kind, "version": version, "serial": serial}
    names = {1: "path", 2: "interface", 3: "member", 6: "destination", 8: "signature"}
    at = 16
    while at < 16 + fields:
        at += -at % 8
        code, signature = message[at], chr(message[at + 2])
        assert (message[at + 1], message[at + 3]) == (1, 0)
        size = message[at + 4] if signature == "g" else struct.unpack_from("<I", message, at + 4)[0]
        start = at + (5 if signature == "g" else 8)
        found[names[code]] = message[start : start + size].decode()
        assert message[start + size] == 0
        at = start + size + 1
    assert at == 16 + fields
    start = at + -at % 8
    assert len(message) == start + body
    return {**found, "body": message[start:]}


def message(kind: int, order: str = "<", body: bytes = b"") -> bytes:
    """Return an answer with a header field of five bytes, padded to eight."""
    head = struct.pack(f"{order}BBBIII", kind, 0, 1, len(body), 9, 5)
    return (b"l" if order == "<" else b"B") + head + bytes(8) + body


@pytest.fixture
def bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., list[Any]]]:
    """Return what serves one client with given answers, and returns what it was asked."""
    path = tmp_path / "bus"
    monkeypatch.setenv("DBUS_SYSTEM_BUS_ADDRESS", f"unix:path={path},guid=1234")
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()
    threads = []

    def serve(*answers: bytes, welcome: bytes = b"OK 1234\r\n") -> list[Any]:
        asked: list[Any] = []

        def run() -> None:
            client, _ = listener.accept()
            with client, suppress(OSError):
                asked.append(client.recv(256))
                client.sendall(welcome)
                for answer in answers:
                    data = client.recv(4096)
                    if not data:
                        return
                    asked.append(parsed(data.removeprefix(b"BEGIN\r\n")))
                    client.sendall(answer)

        threads.append(threading.Thread(target=run, daemon=True))
        threads[-1].start()
        return asked

    yield serve
    for thread in threads:
        thread.join(10)
    listener.close()


def test_one_call_asks_for_the_priority(bus: Callable[..., list[Any]]) -> None:
    signal = message(SIGNAL, body=b"12345678901234567")
    asked = bus(message(RETURN) + signal, signal + message(RETURN, ">"))
    assert make_real_time(4711, 10)
    who, hello, call = asked
    assert who == b"\0AUTH EXTERNAL " + str(os.getuid()).encode().hex().encode() + b"\r\n"
    assert (hello["member"], hello["destination"]) == ("Hello", "org.freedesktop.DBus")
    assert hello["path"] == "/org/freedesktop/DBus"
    assert call == {
        "kind": 1,
        "version": 1,
        "serial": 2,
        "path": "/org/freedesktop/RealtimeKit1",
        "interface": "org.freedesktop.RealtimeKit1",
        "member": "MakeThreadRealtimeWithPID",
        "destination": "org.freedesktop.RealtimeKit1",
        "signature": "ttu",
        "body": struct.pack("<QQI", 4711, 4711, 10),
    }


def test_what_is_refused_or_not_there_is_no(
    bus: Callable[..., list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    bus(message(RETURN), message(ERROR, body=b"no"))
    assert not make_real_time(1, 10)
    bus(message(ERROR))
    assert not make_real_time(1, 10)
    bus(welcome=b"REJECTED EXTERNAL\r\n")
    assert not make_real_time(1, 10)
    bus(message(RETURN))  # the bus goes away
    assert not make_real_time(1, 10)
    bus(message(RETURN), b"")
    monkeypatch.setattr("allanscope.sources.rtkit._PATIENCE_S", 0.1)
    assert not make_real_time(1, 10)
    monkeypatch.setenv("DBUS_SYSTEM_BUS_ADDRESS", "unix:path=/no/bus")
    assert not make_real_time(1, 10)


def test_a_reader_that_is_not_allowed_it_limits_itself_and_gives_way() -> None:
    """RealtimeKit wants the limit; at its end the priority goes, and the process does not."""
    script = f"""
import os, resource, runpy, signal, sys
asked = []
def refuse(process, policy, parameters):
    asked.append(policy)
    if policy == os.SCHED_RR:
        raise PermissionError
os.sched_setscheduler = refuse
reader = runpy.run_path({str(Path(port_reader.__file__))!r}, run_name="reader")
print(reader["_raise_priority"]())
print(resource.getrlimit(resource.RLIMIT_RTTIME))
os.kill(os.getpid(), signal.SIGXCPU)
print(asked == [os.SCHED_RR, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK])
"""
    ran = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    priority, limits, gave_way = ran.stdout.splitlines()
    assert not priority.startswith(port_reader.REAL_TIME)
    assert limits == "(100000, 200000)"
    assert gave_way == "True"


@pytest.mark.parametrize("granted", [True, False])
def test_a_check_asks_for_a_process_of_its_own(
    monkeypatch: pytest.MonkeyPatch, granted: bool
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    asked = []

    def make(process: int, priority: int) -> bool:
        limits = Path(f"/proc/{process}/limits").read_text("ascii")
        (line,) = (line for line in limits.splitlines() if "realtime timeout" in line)
        asked.append((process, priority, *line.split()[3:5]))
        return granted

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(isolated_reader, "make_real_time", make)
    assert isolated_reader.may_run_in_real_time() == granted
    [(process, priority, soft, hard)] = asked
    assert process != os.getpid()
    assert (priority, soft, hard) == (port_reader.PRIORITY, "100000", "200000")
