"""A command that serves a page, and what listens at which address of this machine."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import psutil
import pytest

__all__ = ["listening", "serving", "wait_for"]

T = TypeVar("T")

_PAGE = re.compile(
    r"charts: (http://127\.0\.0\.1:(\d+)/\?url=rerun%2Bhttp%3A%2F%2F127\.0\.0\.1%3A(\d+)%2Fproxy\S*)"
)


@contextmanager
def serving(
    *arguments: object, seconds: float
) -> Iterator[tuple[subprocess.Popen[str], re.Match[str]]]:
    """Start a command without a screen; end it by Ctrl-C, and by force after some seconds.

    Yields its process, and the match of address, port of the page and port of the data.
    """
    shown = ("DISPLAY", "WAYLAND_DISPLAY")
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "allanscope", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={name: value for name, value in os.environ.items() if name not in shown},
        text=True,
    )
    assert process.stdout is not None
    try:
        yield process, _page_of(process.stdout)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.stdout.close()
        try:
            process.wait(seconds)
        finally:
            process.kill()


def _page_of(lines: Iterator[str]) -> re.Match[str]:
    said = ""
    for line in lines:
        said += line
        if found := _PAGE.search(line):
            return found
    pytest.fail(said)


def listening(process: subprocess.Popen[str]) -> set[tuple[str, int]]:
    """Return the addresses at which a process and its children listen."""
    family = [process.pid, *(child.pid for child in psutil.Process(process.pid).children(True))]
    return {
        (one.laddr.ip, one.laddr.port)
        for one in psutil.net_connections("tcp")
        if one.pid in family and one.status == psutil.CONN_LISTEN
    }


def wait_for(condition: Callable[[], T], seconds: float = 80.0) -> T:
    """Return what a condition says once it is true, or at the end of the time."""
    end = time.monotonic() + seconds
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.2)
    return found
