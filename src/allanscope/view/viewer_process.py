"""The viewer is a process of its own, which may be closed, killed or never appear.

It is told the address of the server that the measuring process runs on the loopback interface, and
connects to it like anyone else. A window outlives the measurement, so that the last charts can be
looked at; the server of the web page ends with it.
"""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import quote

from allanscope.errors import DeviceError

__all__ = ["ViewerProcess", "free_port", "has_display", "optimise", "rerun_binary"]

LOOPBACK = "127.0.0.1"
MEMORY_LIMIT = "1GiB"


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


def has_display() -> bool:
    """Tell whether a window could be shown here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class ViewerProcess:
    """A native window, or a server of the web viewer's page.

    Parameters
    ----------
    uri : str
        Address of the data, ``rerun+http://127.0.0.1:PORT/proxy``.
    web : bool
        Serve the page instead of opening a window.
    """

    def __init__(self, uri: str, web: bool) -> None:
        self.address = ""
        """Address of the page; empty for a window."""
        command = [str(rerun_binary()), "--bind", LOOPBACK]
        if web:
            port = free_port()
            command += ["--serve-web", "--web-viewer-port", str(port), uri]
            query = f"url={quote(uri, safe='')}&hide_welcome_screen=1"
            self.address = f"http://{LOOPBACK}:{port}/?{query}"
        else:
            command += ["--port", str(free_port()), "--hide-welcome-screen"]
            command += ["--memory-limit", MEMORY_LIMIT, "--connect", uri]
        self._process = subprocess.Popen(
            command,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C in the terminal ends the measurement, not the window
        )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def running(self) -> bool:
        """Tell whether the process is still there."""
        return self._process.poll() is None

    def failed(self) -> bool:
        """Tell whether it ended by itself with an error, as without a graphics driver."""
        return bool(self._process.poll())

    def stop(self) -> None:
        """End the process."""
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


def _environment() -> dict[str, str]:
    """Return the environment of the viewer: quiet, and without telemetry.

    The viewer reports its use to its makers unless it believes to run in a continuous-integration
    job. A laboratory computer has no business to talk to anyone.
    """
    return {**os.environ, "CI": "true", "RUST_LOG": "off"}
