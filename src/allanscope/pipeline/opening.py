"""The charts of a session again, from its ``.rrd``: in a window or in the browser."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from allanscope.errors import DeviceError, InputError, UsageError
from allanscope.pipeline.settings import ViewMode
from allanscope.pipeline.signals import stopped_by_signals
from allanscope.view import ViewerProcess, has_display

__all__ = ["charts_of", "open_charts"]

_LOOK_EVERY_S = 0.2


def open_charts(source: str, view: ViewMode, port: int | None, say: Callable[[str], None]) -> None:
    """Show what a session has drawn, until the window is closed or Ctrl-C ends the page.

    Parameters
    ----------
    source : str
        The folder of a session, a ``.rrd``, or the address of a session that runs on this machine.
    view : {'auto', 'window', 'web'}
        ``auto`` is a window where there is a display, else the web viewer.
    port : int or None
        Of the page, with the data at the one after it; None for any free ones.
    say : callable
        Called with a line for the user.

    Raises
    ------
    InputError
        When there are no charts to open.
    UsageError
        When an address is not of this machine, or the port is taken.
    DeviceError
        When no window can be opened, or the viewer is not installed.
    """
    charts = charts_of(source)
    web = view == "web" or (view == "auto" and not has_display())
    stopped = threading.Event()
    with stopped_by_signals(stopped.set):
        if not web:
            if not _shown(ViewerProcess(charts, web=False, port=port), stopped):
                return
            if view == "window":
                raise DeviceError("no window can be opened here; use --view web")
            say("no window can be opened here")
        viewer = ViewerProcess(charts, web=True, port=port)
        say(f"charts: {viewer.address}  (Ctrl-C ends)")
        if has_display():
            webbrowser.open(viewer.address)
        if _shown(viewer, stopped):
            raise DeviceError(f"the viewer could not show {charts}")


def charts_of(source: str) -> str:
    """Return what the viewer is to open: a file, or an address on the loopback interface."""
    if "://" in source:
        address = urlsplit(source)
        if address.scheme != "rerun+http" or address.hostname not in ("127.0.0.1", "localhost"):
            raise UsageError(
                f"{source} is no address of this machine; write rerun+http://127.0.0.1:PORT/proxy, "
                "or the folder of a session"
            )
        return source
    path = Path(source)
    if path.is_dir():
        path /= "session.rrd"
    if not path.exists():
        raise InputError(f"there is no {path}; allanscope replay draws the charts of a recording")
    if path.suffix != ".rrd":
        raise InputError(f"{path} is no .rrd; allanscope replay draws the charts of a recording")
    return str(path)


def _shown(viewer: ViewerProcess, stopped: threading.Event) -> bool:
    """Wait until the viewer ends or is to end; return whether it failed."""
    try:
        while not stopped.is_set():
            if viewer.wait(_LOOK_EVERY_S):
                return viewer.failed()
        return False
    finally:
        viewer.stop()
