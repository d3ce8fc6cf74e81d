"""Opens the viewer that was asked for, and says so when it is gone."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from typing import Literal

from allanscope.view.viewer_process import ViewerProcess, has_display

__all__ = ["ViewMode", "ViewerKeeper"]

ViewMode = Literal["window", "web", "none", "auto"]


class ViewerKeeper:
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
