"""What a device needs of a port that a host can open: written without ever waiting for the host."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Protocol

__all__ = ["VirtualPort", "open_port"]


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


def open_port(path: Path | None = None) -> VirtualPort:
    """Return a pseudo-terminal at `path`, or a TCP port where the system has none (Windows)."""
    if hasattr(os, "openpty"):
        from allanscope.simulator.pty_port import PtyPort

        return PtyPort(path)
    from allanscope.simulator.tcp_port import TcpPort

    return TcpPort()
