"""A device at the other end of a real pseudo-terminal, reachable under a path that stays."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from allanscope.sources import SerialSource
from support.pty_device import Device


@pytest.fixture
def device(tmp_path: Path) -> Iterator[Device]:
    made = Device(tmp_path / "ttySensorTile")
    yield made
    made.unplug()


@pytest.fixture
def source(device: Device) -> Iterator[SerialSource]:
    opened = SerialSource(str(device.path), comports=list)
    yield opened
    opened.close()
