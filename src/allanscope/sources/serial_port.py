"""A serial port that survives being unplugged.

A night on the bench outlives a loose cable. When the link fails, whatever it says, the port is
closed first (on some systems the old handle keeps the name busy), and then the same device is
looked for until it is back: by USB and serial number, else by its path. It
may come back under another name, and another board may have taken the old one. Refusals are
tolerated while waiting: after plugging in, udev sets permissions and ModemManager probes.
"""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Callable

from allanscope.errors import DeviceError, UsageError
from allanscope.recording import Chunk, LinkEvent
from allanscope.sources.base import SourceSettings
from allanscope.sources.discovery import Comports, PortDescription, find_ports
from allanscope.sources.isolated_reader import A_THREAD, IsolatedReader, isolated_reader_of
from allanscope.sources.port_reader import LATE_BYTES, ReadPacer
from allanscope.sources.transport import (
    LINK_ERRORS,
    PosixPort,
    Transport,
    WriteTimeoutError,
    open_error,
    open_transport,
)

__all__ = ["SerialSource"]

WAIT_S = 0.05
"""A read returns after this much silence."""

TAKE_EVERY_S = 0.08
"""What a process of its own has read is taken so often: it knows when each read came."""

READ_BYTES, FULL_BYTES = 4095, 15_000
"""What one read of a tty of Linux brings at most, and what it and the queue behind it hold at
least before more is thrown away: a port that had so many waiting when it was opened has a gap
behind them."""

FIRST_RETRY_S = 0.1
LAST_RETRY_S = 2.0


class _OpeningBacklog:
    """What waited in a port when it was opened: where that was a full buffer, a gap lies behind it.

    Parameters
    ----------
    queued : int
        Bytes that can be read at once after the opening.
    """

    def __init__(self, queued: int = 0) -> None:
        self._taken = 0
        self._is_open = queued >= READ_BYTES
        self._was_short = False

    def ends_with_gap(self, size: int) -> bool:
        """Take the size of a read; return whether bytes are missing behind it."""
        if not self._is_open:
            return False
        self._taken += size
        has_gap = size < READ_BYTES and self._taken >= FULL_BYTES
        # A busy computer may pass on what waited in two goes: one short read is not its end.
        is_short = size < LATE_BYTES
        self._is_open = not (has_gap or (is_short and self._was_short))
        self._was_short = is_short
        return has_gap


class SerialSource:
    """Bytes from a serial port or a pyserial URL.

    Parameters
    ----------
    name : str
        Device path, port name or URL.
    settings : SourceSettings
        Line rate, stall and patience.
    comports : callable, optional
        Lists ports as pyserial does.
    opener : callable
        Opens a link.
    clock : callable
        Host monotonic time in nanoseconds.
    sleep : callable
        Passes that many seconds, a tenth at most.

    Raises
    ------
    DeviceError
        If the port cannot be opened; the one line says what to do.
    UsageError
        If the URL is none.
    """

    def __init__(
        self,
        name: str,
        settings: SourceSettings | None = None,
        *,
        comports: Comports | None = None,
        opener: Callable[[str, int], Transport] = open_transport,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self._name = name
        self._settings = settings or SourceSettings()
        self._comports = comports
        self._opener = opener
        self._clock = clock
        self._port = self._described(name)
        self.trouble = ""
        """Why the device cannot be reopened just now; empty while all is well."""
        self._reading = threading.Lock()
        self._writing = threading.Lock()
        self._closing = threading.Event()
        self._sleep = sleep
        self._pace = ReadPacer()
        self.reader = A_THREAD
        """Who reads the port, a separate process at some priority or a thread of this one, and
        whether its driver hands on bytes at once."""
        self._latency = ""
        self._last_ns = 0
        self._streaming = False
        self._backlog = _OpeningBacklog()
        self._overrun = False
        self._stalled = False
        self._pause_s = 0.0
        self._retry_s = FIRST_RETRY_S
        self._next_try_ns = 0
        self._lost_ns = 0
        self._link: Transport | None = self._open_first(name)
        self._last_data_ns = clock()

    @property
    def name(self) -> str:
        """The port as it is called at present."""
        return self._port.device

    @property
    def identity(self) -> dict[str, str]:
        """What the USB descriptors say of the device."""
        return self._port.facts()

    def read(self) -> Chunk:
        """Return what has arrived, or an empty chunk after a tenth of a second.

        The chunk on which the link breaks has the event ``disconnected``; reads go on returning
        empty chunks until the device is back, with ``reconnected``.

        Raises
        ------
        DeviceError
            When the device has been disconnected for longer than the settings allow.
        """
        with self._reading:
            if self._closing.is_set():
                return Chunk(self._clock(), event="end")
            return self._listen(self._link) if self._link is not None else self._try_reopen()

    def write(self, data: bytes) -> None:
        """Send bytes; nothing happens while the device is gone.

        Raises
        ------
        DeviceError
            If the device does not take them within a second.
        """
        with self._writing:
            if self._link is None:
                return
            try:
                self._link.write(data)
            except WriteTimeoutError as error:
                raise DeviceError(
                    f"{self.name} does not take what is written to it; is it the right port?"
                ) from error
            except LINK_ERRORS:
                return  # the reader sees it too, and reports it

    def close(self) -> None:
        """Stop; waits for a read in another thread, which takes a moment. The next says ``end``."""
        self._closing.set()
        with self._reading:
            self._close_link()

    # --- while the link is there --------------------------------------------------------------

    def _listen(self, link: Transport) -> Chunk:
        isolated = link if isinstance(link, IsolatedReader) else None
        if self._pause_s and not (isolated and isolated.waiting):
            self._sleep(self._pause_s)
        try:
            data = link.read(WAIT_S)
        except LINK_ERRORS:
            return self._disconnect()
        # A read of the other process may be older than the silence that was just told of.
        now = self._last_ns = max((isolated and isolated.read_ns) or self._clock(), self._last_ns)
        self.reader = (isolated.description if isolated else A_THREAD) + self._latency
        if isolated:
            self._overrun |= isolated.missed
            isolated.missed = False
        if not data:
            self._pause_s = 0.0
            return Chunk(now, event=self._stall(now))
        if isolated and isolated.is_reading:
            self._pause_s = TAKE_EVERY_S
        else:
            pause_s = self._pace.after(len(data), now - self._last_data_ns)
            self._pause_s = self._pace.unevenly(pause_s)
        event: LinkEvent = "resumed" if self._stalled else "overrun" if self._overrun else ""
        self._overrun = self._backlog.ends_with_gap(len(data))
        self._streaming, self._stalled, self._last_data_ns = True, False, now
        self._retry_s = FIRST_RETRY_S
        return Chunk(now, data, event)

    def _stall(self, now: int) -> LinkEvent:
        """Report once that a streaming device stopped sending: one that hangs raises no error."""
        silent = now - self._last_data_ns > self._settings.stall_s * 1e9
        if not silent or not self._streaming or self._stalled:
            return ""
        self._stalled = True
        return "stalled"

    def _disconnect(self) -> Chunk:
        self._close_link()
        self._lost_ns = self._clock()
        self._next_try_ns = self._lost_ns + int(self._retry_s * 1e9)
        self._stalled = False
        return Chunk(self._lost_ns, event="disconnected")

    def _close_link(self) -> None:
        with self._writing:
            link, self._link = self._link, None
            if link is not None:
                link.close()

    # --- while it is gone ---------------------------------------------------------------------

    def _try_reopen(self) -> Chunk:
        """Wait a little; when it is time, look for the device and open it."""
        wait_s = (self._next_try_ns - self._clock()) * 1e-9
        if wait_s > 0.0:
            self._sleep(min(wait_s, WAIT_S))
            return Chunk(self._clock())
        try:
            self._reopen()
        except LINK_ERRORS as error:
            self.trouble = str(open_error(self.name, error, find_ports(self._comports)))
            self._retry_s = min(2.0 * self._retry_s, LAST_RETRY_S)
            now = self._clock()
            self._next_try_ns = now + int(self._retry_s * 1e9)
            if now - self._lost_ns > self._settings.give_up_s * 1e9:
                raise DeviceError(
                    f"{self.name} has been disconnected for {self._settings.give_up_s:g} s: "
                    f"{self.trouble}"
                ) from error
            return Chunk(now)
        self.trouble = ""
        self._retry_s = min(2.0 * self._retry_s, LAST_RETRY_S)  # until it proves to be alive
        self._last_data_ns = self._clock()
        return Chunk(self._last_data_ns, event="reconnected")

    def _reopen(self) -> None:
        name, port = self._name, self._port
        if self._port.vendor is not None:
            back = [one for one in find_ports(self._comports) if self._port.is_same_device(one)]
            if not back:
                raise FileNotFoundError(errno.ENOENT, "the device is not connected")
            port = back[0]
            name = port.device
        self._link = self._opened(name)
        self._port = port

    # --- opening ------------------------------------------------------------------------------

    def _open_first(self, name: str) -> Transport:
        try:
            return self._opened(name)
        except LINK_ERRORS as error:
            raise open_error(name, error, find_ports(self._comports)) from error
        except ValueError as error:
            raise UsageError(f"cannot open {name}: {error}") from error

    def _opened(self, name: str) -> Transport:
        """Open a port, and have it read by a process of its own where there can be one."""
        link = self._opener(name, self._settings.baud)
        # A port that was full has a whole read waiting: what comes from here on is no sign of it.
        self._backlog = _OpeningBacklog(link.queued() if isinstance(link, PosixPort) else 0)
        if not isinstance(link, PosixPort):
            return link
        self._latency = "; low latency" if link.low_latency else "; no low-latency mode"
        return isolated_reader_of(link) if self._settings.own_process else link

    def _described(self, name: str) -> PortDescription:
        if "://" not in name:
            path = os.path.realpath(name)
            for port in find_ports(self._comports):
                if os.path.realpath(port.device) == path:
                    return port
        return PortDescription(name)
