"""A device in another process at a real pseudo-terminal."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).with_name("simulated_device.py")


class DeviceProcess:
    """A board on a cable, in a process of its own."""

    def __init__(self, path: Path, lives: list[dict[str, Any]]) -> None:
        self.path = path
        command = [sys.executable, str(SCRIPT), str(path), json.dumps(lives)]
        self._child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._child.stdout is not None
        assert self._child.stdout.readline() == "ready\n"
        self.url = str(path)

    def ledgers(self) -> list[dict[str, Any]]:
        """Switch it off for good and return what became of every sample, life by life."""
        out, _ = self._child.communicate(timeout=60.0)
        return json.loads(out.splitlines()[-1])

    def close(self) -> None:
        if self._child.poll() is None:
            self._child.kill()
        self._child.communicate()
