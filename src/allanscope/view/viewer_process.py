"""The viewer is a process of its own, which may be closed, killed or never appear.

It is told the address of the server that the measuring process runs on the loopback interface, and
connects to it like anyone else; or it is given a file. A window outlives the measurement, so that
the last charts can be looked at; the server of the web page ends with it. Whatever listens listens
on the loopback interface only, and no use is reported to anyone.

`ViewerProcess` is one such process; `ViewerSupervisor` opens the one that was asked for, and says
so when it is gone. The page of the web viewer is served by `viewer_page`.
"""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from urllib.parse import quote, urlsplit

from allanscope.errors import DeviceError, UsageError

if TYPE_CHECKING:
    from allanscope.view.viewer_page import WebPage

__all__ = [
    "DATA_PORT_AFTER_PAGE",
    "LOOPBACK",
    "ViewMode",
    "ViewerProcess",
    "ViewerSupervisor",
    "free_port",
    "has_display",
    "optimise",
    "port_in_use",
    "require_free_port",
    "rerun_binary",
]

LOOPBACK = "127.0.0.1"


def port_in_use(port: int, error: OSError) -> UsageError:
    """Return what to raise when a port of the user's choice cannot be bound."""
    return UsageError(
        f"port {port} of {LOOPBACK} is not available: {error.strerror}; choose another --port"
    )


MEMORY_LIMIT = "1GiB"

_NO_PROXY_THERE = f"http://{LOOPBACK}:9"  # the port of the discard protocol, where nothing listens

DATA_PORT_AFTER_PAGE = 1
"""Where the port is given, it is that of the page; that of the data comes after it."""

ViewMode = Literal["window", "web", "none", "auto"]


def rerun_binary() -> Path:
    """Return the viewer's program inside the installed rerun-sdk.

    It is started directly and not through the wrapper script ``rerun``, which would be a second
    process whose death the viewer survives.
    """
    spec = importlib.util.find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        for name in ("rerun", "rerun.exe"):
            path = Path(folder) / name
            if path.is_file():
                return path
    raise DeviceError(
        "the Rerun viewer is not installed; pip install rerun-sdk, or use --view none"
    )


def free_port() -> int:
    """Return a port of the loopback interface that could be bound a moment ago.

    Rerun itself only logs an error when its port is taken, and does not tell which port it got
    when asked for any.
    """
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def require_free_port(port: int) -> None:
    """Refuse a port of the user's choice that something else listens on.

    Raises
    ------
    UsageError
        When the port cannot be bound.
    """
    with socket.socket() as probe:
        # As servers do: a port whose last connection is just closed is not taken.
        if os.name == "posix":
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError as error:
            raise port_in_use(port, error) from None


def has_display() -> bool:
    """Return whether a window could be shown here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class ViewerProcess:
    """A native window, or a server of the web viewer's page.

    Parameters
    ----------
    source : str
        Address of the data, ``rerun+http://127.0.0.1:PORT/proxy``, or a file.
    web : bool
        Serve the page instead of opening a window.
    port : int, optional
        Of the page, or of the window's own server; any free one if not given. The data of a file
        are served to the page `DATA_PORT_AFTER_PAGE`.

    Raises
    ------
    UsageError
        When the port is taken.
    """

    def __init__(self, source: str, web: bool, port: int | None = None) -> None:
        self.address = ""
        """Address of the page; empty for a window."""
        self._page: WebPage | None = None
        command = [str(rerun_binary()), "--bind", LOOPBACK]
        if web:
            command += self._web(source, port)
        else:
            if port is not None:
                require_free_port(port)
            command += ["--port", str(port or free_port()), "--hide-welcome-screen"]
            command += ["--memory-limit", MEMORY_LIMIT]
            command += ["--connect", source] if _is_address(source) else [source]
        self._process = subprocess.Popen(
            command,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C in the terminal ends the measurement, not the window
        )

    def _web(self, source: str, port: int | None) -> list[str]:
        """Serve the page, and return how to start what it is fetched from."""
        data, command = source, ["--serve-web"]
        if not _is_address(source):
            after = None if port is None else port + DATA_PORT_AFTER_PAGE
            if after is not None:
                require_free_port(after)
            after = after or free_port()
            command += ["--port", str(after)]
            data = f"rerun+http://{LOOPBACK}:{after}/proxy"
        from allanscope.view.viewer_page import WebPage  # HTTP takes long to load

        original = free_port()
        self._page = WebPage(port or 0, original, urlsplit(data).port or 0)
        query = f"url={quote(data, safe='')}&hide_welcome_screen=1"
        self.address = f"http://{LOOPBACK}:{self._page.port}/?{query}"
        return [*command, "--web-viewer-port", str(original), source]

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def running(self) -> bool:
        """Return whether the process is still there."""
        return self._process.poll() is None

    def wait(self, timeout_s: float) -> bool:
        """Wait for its end; return whether it came."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        return not self.running()

    def failed(self) -> bool:
        """Return whether it ended by itself with an error, as without a graphics driver."""
        return bool(self._process.poll())

    def stop(self) -> None:
        """End the process, and the page."""
        if self._page is not None:
            self._page.close()
        self._process.terminate()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def optimise(path: Path, timeout_s: float = 300.0) -> bool:
    """Rewrite a recording in few large chunks: less than half the size, and it opens at once.

    The old file stays until the new one is complete; return False when that did not come about.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        command = [str(rerun_binary()), "rrd", "optimize", str(path), "-o", str(part)]
        subprocess.run(
            command,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout_s,
            check=True,
        )
        if not part.stat().st_size:
            return False
        part.replace(path)
    except (OSError, subprocess.SubprocessError, DeviceError):
        return False
    finally:
        part.unlink(missing_ok=True)
    return True


def _is_address(source: str) -> bool:
    return source.startswith("rerun+http://")


def _environment() -> dict[str, str]:
    """Return the environment of the viewer: quiet, and with no way to other hosts.

    The viewer reports its use to its makers unless it detects a continuous-integration
    job, and asks for its latest release in any case, but through a proxy where one is named: here
    one that is not there. A laboratory computer has no business to talk to anyone.
    """
    proxies = dict.fromkeys(("ALL_PROXY", "HTTPS_PROXY", "HTTP_PROXY"), _NO_PROXY_THERE)
    direct = {"NO_PROXY": f"{LOOPBACK},localhost"}
    ways = proxies | direct
    lower = {name.lower(): way for name, way in ways.items()}
    return {**os.environ, **ways, **lower, "CI": "true", "RUST_LOG": "off"}


class ViewerSupervisor:
    """Keeps one viewer of the data at an address.

    Parameters
    ----------
    address : str
        Of the server that viewers fetch the data from.
    mode : {'auto', 'window', 'web'}
        ``auto`` is a window where there is a display, else the web viewer.
    say : callable
        Called with a line for the user.
    port : int, optional
        Of the page of the web viewer, or of the window's own server.

    Attributes
    ----------
    process : ViewerProcess
        The viewer; its `address` is that of the web viewer's page, empty for a window.
    """

    process: ViewerProcess

    def __init__(
        self,
        address: str,
        mode: ViewMode,
        say: Callable[[str], None],
        port: int | None = None,
    ) -> None:
        self._address, self._port = address, port
        self._mode = mode
        self._say = say
        self._told = False
        self._open(web=mode == "web" or (mode == "auto" and not has_display()))

    @property
    def is_web(self) -> bool:
        """Whether the page of the web viewer is served now."""
        return bool(self.process.address) and self.process.running()

    def watch(self) -> None:
        """Say once that the viewer is gone; where no window can live, fall back to the web."""
        if self._told or self.process.running():
            return
        if self._mode == "auto" and not self.process.address and self.process.failed():
            self._say("no window can be opened here")
            self._open(web=True)
            return
        self._told = True
        self._say(f"viewer closed, still measuring; to open it again: {self._again}")

    def close(self) -> None:
        """Stop serving the page of the web viewer; a window stays, to look at the last charts."""
        if self.process.address:
            self.process.stop()

    @property
    def _again(self) -> str:
        return f"allanscope open {self._address}"

    def _open(self, web: bool) -> None:
        self.process = ViewerProcess(self._address, web, self._port)
        if not web:
            self._say(f"viewer opened; for another: {self._again}")
            return
        self._say(f"charts: {self.process.address}")
        if has_display():
            webbrowser.open(self.process.address)
