"""The terminal itself: written to whoever reads, read key by key, left as it was found."""

from __future__ import annotations

import atexit
import contextlib
import os
import select
import threading
from collections.abc import Callable, Mapping
from typing import TextIO

from rich.console import Console

from allanscope.sanitize import spell_out

__all__ = ["Keys", "SteadyConsole"]


class SteadyConsole(Console):
    """A console for jobs that go on whether or not somebody reads along.

    A reader that closes the pipe (``allanscope live | head``) silences it, where Rich would end
    the process. Characters that the stream cannot encode are spelled out.

    Parameters
    ----------
    stream : text file
        Where to write.
    soft_wrap : bool
        Leave long lines alone.
    """

    def __init__(self, stream: TextIO, soft_wrap: bool = False) -> None:
        spell_out(stream)
        super().__init__(file=stream, highlight=False, markup=False, soft_wrap=soft_wrap)

    def on_broken_pipe(self) -> None:
        """Stop writing."""
        self.quiet = True
        # Python would complain about the pipe once more when it flushes the stream at its end.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, self.file.fileno())
        except OSError:
            pass
        finally:
            os.close(nowhere)


class Keys:
    """Reads keys in a thread of its own, without echo and without waiting for Enter.

    Ctrl-C and Ctrl-Z keep their meaning. Does nothing where input is no terminal, where this
    process runs in the background (changing the terminal would stop it), and on Windows.

    Parameters
    ----------
    actions : mapping
        Key to what it does.
    fd : int
        File descriptor of the terminal.
    """

    def __init__(self, actions: Mapping[str, Callable[[], None]], fd: int = 0) -> None:
        self.active = False
        self._actions = actions
        self._fd = fd
        if not _ours(fd):
            return
        import termios
        import tty

        self._saved = termios.tcgetattr(fd)
        self._wake_read, self._wake_write = os.pipe()
        atexit.register(self.close)
        tty.setcbreak(fd, termios.TCSANOW)
        self.active = True
        self._thread = threading.Thread(target=self._run, name="keys", daemon=True)
        self._thread.start()

    def close(self, drain: bool = True) -> None:
        """Stop reading and put the terminal back; may be called twice.

        With `drain` what was written is shown first, which a stopped terminal never does.
        """
        if not self.active:
            return
        self.active = False
        import termios

        with contextlib.suppress(OSError, termios.error):  # the terminal may be gone
            when = termios.TCSADRAIN if drain else termios.TCSANOW
            termios.tcsetattr(self._fd, when, self._saved)
        atexit.unregister(self.close)
        os.write(self._wake_write, b"x")
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)
        if not self._thread.is_alive():
            # Not by the thread itself: its numbers could by then be those of other files.
            os.close(self._wake_read)
            os.close(self._wake_write)

    def _run(self) -> None:
        try:
            while self.active:
                ready, _, _ = select.select([self._fd, self._wake_read], [], [])
                if self._wake_read in ready:
                    return
                typed = os.read(self._fd, 64)
                if not typed:
                    return
                for key in typed.decode("ascii", "ignore").lower():
                    if action := self._actions.get(key):
                        action()
        except OSError:
            return  # the terminal is gone, as when a connection drops; the measurement goes on


def _ours(fd: int) -> bool:
    """Return whether this is a terminal that we may read from now."""
    try:
        import termios  # noqa: F401

        return os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp()
    except (ImportError, OSError):
        return False
