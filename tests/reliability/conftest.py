"""A device in another process at a real pseudo-terminal, and the live session that watches it."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from allanscope.analysis.analyser import Analyser
from allanscope.analysis.result import Analysis
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.live import run_live
from allanscope.pipeline.session import Session
from allanscope.pipeline.settings import DeviceSettings, SessionSettings, SimulatedSettings
from allanscope.recording import Recorder, Recording
from allanscope.samples import Block, Gap, StreamInfo
from allanscope.sources import open_source
from allanscope.wire.base import WireSettings

SCRIPT = Path(__file__).with_name("device_process.py")


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


@pytest.fixture
def plug_in(tmp_path: Path) -> Iterator[Callable[..., DeviceProcess]]:
    """Return a function that starts a device with one life, or several, in other processes."""
    with ExitStack() as stack:

        def start(*lives: dict[str, Any], name: str = "ttySensorTile") -> DeviceProcess:
            return stack.enter_context(closing(DeviceProcess(tmp_path / name, list(lives))))

        yield start


def watch_in_full(port: str, out: Path | None, seconds: float, **more: Any) -> Analysis:
    """Run ``allanscope live`` in this process, with nobody looking: result, report and all."""
    settings = SessionSettings(out=out, view="none", quiet=True, duration_s=seconds)
    return run_live(port, DeviceSettings(), settings, SimulatedSettings(), **more)


def watch(port: str, out: Path, seconds: float) -> Analysis:
    """Run the same session without what a full result, a report and a view cost."""
    out.mkdir()
    source = open_source(port)
    recorder = Recorder(out, {})
    decoding = Decoding(WireSettings())

    def write(data: bytes) -> None:
        recorder.tx(data, time.monotonic_ns())
        source.write(data)

    decoding.resume(write)
    session = Session(source, decoding, Analyser(), ledger=recorder, duration_s=seconds)
    try:
        session.run()
    finally:
        recorder.close()
    return session.result("live")


@dataclass
class Stretch:
    """What came under one StreamInfo: where it begins and ends, and what came of it."""

    info: StreamInfo
    first: int = -1
    stop: int = -1
    received: int = 0
    lost: int = 0
    unknown: int = 0


def survey(folder: Path) -> list[Stretch]:
    """Decode what a session holds."""
    decoding, stretches = Decoding(WireSettings()), []
    for chunk in Recording(folder).chunks():
        for event in decoding.take(chunk):
            match event:
                case StreamInfo():
                    stretches.append(Stretch(event))
                case Block():
                    here = stretches[-1]
                    here.first = event.index if here.first < 0 else here.first
                    here.stop = event.index + len(event)
                    here.received += len(event)
                case Gap(lost=None):
                    stretches[-1].unknown += 1
                case Gap(lost=lost):
                    stretches[-1].lost += lost or 0
    return stretches


def missing(ledger: dict[str, Any], stretch: Stretch) -> int:
    """Return how many samples of a stretch the device knows not to have arrived."""
    return sum(
        max(0, min(first + count, stretch.stop) - max(first, stretch.first))
        for epoch, first, count, _ in ledger["losses"]
        if epoch == stretch.info.epoch
    )
