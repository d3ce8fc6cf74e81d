"""A port that a host can open, as its device sees it: written without ever waiting for the host.

It is a pseudo-terminal (`pty_port`); where there are none, a TCP port of this machine, which
pyserial opens as ``socket://``.
"""

from __future__ import annotations

import os
import select
import socket
import time
from pathlib import Path
from typing import Protocol

__all__ = ["TcpPort", "VirtualPort", "open_port"]


class VirtualPort(Protocol):
    """The device's end. One thread uses it; no method waits, except `wait`."""

    url: str
    """What a host opens with pyserial."""

    def attached(self) -> bool:
        """Return whether a host has it open."""

    def read(self) -> bytes:
        """Return what the host wrote; empty when nothing."""

    def write(self, data: bytes) -> int:
        """Hand over bytes and return how many the port took: 0 when it is full."""

    def wait(self, timeout_s: float) -> None:
        """Wait until the host writes, or for `timeout_s`."""

    def forget(self) -> int:
        """Throw away what the host has not read, and return how many bytes that was."""

    def unplug(self) -> int:
        """Pull the cable: the host's end fails. Returns how many bytes the host never read."""

    def replug(self) -> None:
        """Put the cable back: the same `url` can be opened again."""

    def close(self) -> None:
        """Remove the port for good."""


class TcpPort:
    """One listening socket, one host at a time.

    What a connection that closed had not read yet cannot be known, so `forget` and `unplug`
    return 0: losses on hang-up are exact to the sample only on a pty.
    """

    def __init__(self) -> None:
        self._address = ("127.0.0.1", 0)
        self._listener: socket.socket | None = None
        self._host: socket.socket | None = None
        self.replug()
        self.url = f"socket://{self._address[0]}:{self._address[1]}"

    def attached(self) -> bool:
        """Return whether a host is connected; takes in one that waits."""
        if self._host is None and self._listener is not None:
            try:
                self._host, _ = self._listener.accept()
            except OSError:
                return False
            self._host.setblocking(False)
            self._host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._host is not None

    def read(self) -> bytes:
        """Return what the host wrote; empty when nothing."""
        if self._host is None:
            return b""
        try:
            data = self._host.recv(4096)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop_host()
        return data

    def write(self, data: bytes) -> int:
        """Hand over bytes and return how many the port took: 0 when it is full."""
        if self._host is None:
            return 0
        try:
            return self._host.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._drop_host()
            return 0

    def wait(self, timeout_s: float) -> None:
        """Wait until the host writes or comes, or for `timeout_s`."""
        end = self._host or self._listener
        if end is None:
            time.sleep(timeout_s)
        else:
            select.select([end], [], [], timeout_s)

    def forget(self) -> int:
        """Return 0: what a closed connection had not read is unknown."""
        return 0

    def unplug(self) -> int:
        """Pull the cable: the connection ends and none is taken."""
        self._drop_host()
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        return 0

    def replug(self) -> None:
        """Put the cable back: the same `url` can be opened again."""
        if self._listener is None:
            self._listener = socket.create_server(self._address, backlog=1)
            self._listener.setblocking(False)
            self._address = self._listener.getsockname()

    def close(self) -> None:
        """Remove the port for good."""
        self.unplug()

    def _drop_host(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None


def open_port(path: Path | None = None) -> VirtualPort:
    """Return a pseudo-terminal at `path`, or a TCP port where the system has none (Windows)."""
    if hasattr(os, "openpty"):
        from allanscope.simulator.pty_port import PtyPort

        return PtyPort(path)
    return TcpPort()
