"""The live session that watches a device, in this process and with nobody looking."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from allanscope.analysis import Analyser, Analysis
from allanscope.pipeline import (
    Decoding,
    DeviceSettings,
    SessionSettings,
    SimulatedSettings,
    run_live,
)
from allanscope.pipeline.session import Session
from allanscope.recording import Recorder
from allanscope.sources import open_source
from allanscope.wire import WireSettings


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
    session = Session(source, decoding, Analyser(), recorder=recorder, duration_s=seconds)
    try:
        session.run()
    finally:
        recorder.close()
    return session.result("live")
