"""The native viewer without a window, to take pictures of what a user would see."""

from __future__ import annotations

import io
import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from allanscope.view.viewer_process import LOOPBACK, free_port, rerun_binary

__all__ = ["HeadlessViewer", "why_no_viewer"]


def why_no_viewer() -> str:
    """Return why no picture can be taken here, or an empty text."""
    folders = [Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d")]
    if not any(folder.glob("*.json") for folder in folders if folder.is_dir()):
        return "no Vulkan driver is installed (on Debian: libvulkan1 mesa-vulkan-drivers)"
    return ""


class HeadlessViewer:
    """Starts a viewer on a file or the address of a server; ends it with the ``with`` block."""

    def __init__(self, source: str, size: str = "1600x900") -> None:
        self._folder = tempfile.TemporaryDirectory()
        port = free_port()
        connect = ["--connect"] if source.startswith("rerun") else []
        # A home of its own, so that nothing persists; only errors are logged, because the viewer
        # shows its log as toasts over the picture.
        home = {"HOME": self._folder.name, "XDG_RUNTIME_DIR": self._folder.name}
        environment = {**os.environ, **home, "CI": "true", "RUST_LOG": "error"}
        environment.pop("DISPLAY", None)
        command = [str(rerun_binary()), "--headless", "--bind", LOOPBACK, "--port", str(port)]
        command += ["--window-size", size, "--hide-welcome-screen", *connect, source]
        self._process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.client = self._connected(f"rerun+http://{LOOPBACK}:{port}/proxy")

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def __enter__(self) -> HeadlessViewer:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(10)
        self._folder.cleanup()

    def wait(self, elapsed_s: float = 0.0, timeout_s: float = 60.0):
        """Wait until views are laid out and the data up to `elapsed_s` are there."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            state = self.client.get_state()
            if state.views and not state.loading and self._end_s(state) >= elapsed_s:
                time.sleep(0.5)
                return self.client.get_state()
            time.sleep(0.1)
        raise TimeoutError(f"the viewer shows {state}")

    def picture(self, view_id: str | None = None) -> NDArray[np.uint8]:
        """Return the whole window, or one view, as (height, width, 3)."""
        png = self.client.take_screenshot(view_id) if view_id else self.client.take_screenshot()
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))

    @staticmethod
    def _end_s(state) -> float:
        ends = [
            timeline.end * 1e-9
            for recording in state.recordings
            for timeline in recording.timelines
            if timeline.name == "elapsed"
        ]
        return max(ends, default=-1.0)

    def _connected(self, address: str):
        from rerun.experimental import ViewerClient

        end = time.monotonic() + 30.0
        while True:
            try:
                client = ViewerClient.connect(address)
                client.get_state()
            except Exception:
                if time.monotonic() > end or self._process.poll() is not None:
                    raise
                time.sleep(0.1)
            else:
                return client
