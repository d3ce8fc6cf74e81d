"""A terminal for tests: a real pty with a size, and what stands on its screen afterwards."""

from __future__ import annotations

import codecs
import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path

__all__ = ["Screen", "Terminal"]

_PREAMBLE = """
import fcntl, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)  # the pty becomes the terminal of this process
sys.path.insert(0, {here!r})
"""
_UNFINISHED = re.compile(r"\x1b(\[[?0-9;]*)?$")
_TOKEN = re.compile(r"\x1b\[([?0-9;]*)([A-Za-z])|(\x1b.)|([\x00-\x1f])|([^\x1b\x00-\x1f]+)")


class Terminal:
    """Runs a Python script whose standard input and output are a terminal of a given size."""

    def __init__(self, script: str, columns: int, lines: int, **environment: str) -> None:
        self.raw = ""
        self._decoder = codecs.getincrementaldecoder("utf-8")()
        self._size = (columns, lines)
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
        self.modes_before = termios.tcgetattr(slave)
        self._slave = slave
        kept = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "COLUMNS", "LINES")}
        here = str(Path(__file__).parents[1])
        self.process = subprocess.Popen(
            [sys.executable, "-c", _PREAMBLE.format(here=here) + script],
            stdin=slave,
            stdout=slave,
            stderr=subprocess.PIPE,
            start_new_session=True,
            env={**kept, "TERM": "xterm-256color", "COLORTERM": "truecolor", **environment},
        )

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stderr is not None
        self.process.stderr.close()
        os.close(self._master)
        os.close(self._slave)

    @property
    def modes(self) -> list:
        """Settings of the terminal now."""
        return termios.tcgetattr(self._slave)

    def type(self, text: str) -> None:
        """Press keys."""
        os.write(self._master, text.encode())

    def resize(self, columns: int, lines: int) -> None:
        """Make the window another size."""
        self._size = (columns, lines)
        fcntl.ioctl(self._slave, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))

    def read_until(self, text: str, timeout_s: float = 60.0) -> None:
        """Read what is written until a text has appeared."""
        self.wait_for(lambda raw: text in raw, timeout_s)

    def wait_for(self, shown: Callable[[str], bool], timeout_s: float = 60.0) -> None:
        """Read what is written until all of it together satisfies a condition."""
        end = time.monotonic() + timeout_s
        while not shown(self.raw):
            assert time.monotonic() < end, repr(self.raw)
            self._read()

    def read_until_row(self, pattern: str, timeout_s: float = 60.0) -> None:
        """Read what is written until a row of the screen begins with a pattern."""
        end = time.monotonic() + timeout_s
        while not any(re.match(pattern, row) for row in self.screen().rows):
            assert time.monotonic() < end, f"no row {pattern!r} in {self.screen().text!r}"
            self._read()

    def finish(self, timeout_s: float = 60.0) -> int:
        """Read until the script has ended; return its exit code."""
        end = time.monotonic() + timeout_s
        while self.process.poll() is None:
            assert time.monotonic() < end, self.raw
            self._read()
        while self._read():
            pass
        return self.process.returncode

    def screen(self) -> Screen:
        """Return what stands on the screen."""
        return Screen(self.raw, *self._size)

    def _read(self) -> bool:
        ready, _, _ = select.select([self._master], [], [], 0.05)
        if ready:
            self.raw += self._decoder.decode(os.read(self._master, 1 << 16))
        return bool(ready)


class Screen:
    """As much of a terminal emulator as a live display needs; scrolls like one."""

    def __init__(self, raw: str, columns: int, lines: int) -> None:
        self.columns = columns
        self.rows = [""]
        self._row = self._column = 0
        for parameters, command, _, control, text in _TOKEN.findall(_UNFINISHED.sub("", raw)):
            if text:
                self._put(text)
            elif control == "\n":
                self._row += 1
                if self._row == len(self.rows):
                    self.rows.append("")
            elif control == "\r":
                self._column = 0
            elif command == "A":
                self._row -= int(parameters or 1)
                assert self._row >= len(self.rows) - lines, "moved above the top of the screen"
            elif command == "K" and parameters == "2":
                self.rows[self._row] = ""
            else:
                assert command in ("m", "h", "l", "K"), f"unexpected {command!r}"
        self.text = "\n".join(row.rstrip() for row in self.rows)

    def _put(self, text: str) -> None:
        row = self.rows[self._row].ljust(self._column)
        end = self._column + len(text)
        assert end <= self.columns, f"{end} columns: {text!r}"
        self.rows[self._row] = row[: self._column] + text + row[end:]
        self._column = end
