"""Devices in other processes, switched off when a test is over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from support.device_process import DeviceProcess


@pytest.fixture
def plug_in(tmp_path: Path) -> Iterator[Callable[..., DeviceProcess]]:
    """Return a function that starts a device with one life, or several, in other processes."""
    with ExitStack() as stack:

        def start(*lives: dict[str, Any], name: str = "ttySensorTile") -> DeviceProcess:
            return stack.enter_context(closing(DeviceProcess(tmp_path / name, list(lives))))

        yield start
