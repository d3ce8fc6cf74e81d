"""How a worker does the analysis of a single run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from allanscope.analysis.row_buffer import WORTH_IT
from allanscope.fleet.worker_tasks import JOINED_ROWS, new_analyser, recorded_events
from allanscope.pipeline import (
    Decoding,
    DeviceSettings,
    SimulatedSettings,
    full_settings,
    recorded_settings,
    simulate_recording,
)
from allanscope.recording import Recording
from allanscope.samples import Block


def test_a_worker_does_the_same_on_one_core() -> None:
    mine, single = new_analyser(DeviceSettings(part="LSM6DSL")).settings, full_settings("LSM6DSL")
    assert mine.processes == 1
    assert mine.buffered_rows < WORTH_IT <= single.buffered_rows
    assert not mine.over_time  # nobody looks at maps of a lot
    more = {"processes": single.processes, "buffered_rows": single.buffered_rows, "over_time": True}
    assert replace(mine, **more) == single


def test_a_worker_takes_the_blocks_between_the_remarks_of_a_device_as_one(tmp_path: Path) -> None:
    path, device = tmp_path / "minute.mcap", DeviceSettings(rate_hz=104.0)
    simulate_recording(path, 1 / 60, device, SimulatedSettings(seed=1), quiet=True)
    recording = Recording(path)
    settings = recorded_settings(recording, device)
    events = recorded_events(recording, Decoding(settings.for_wire(), settings.wire))
    blocks = [event for event in events if isinstance(event, Block)]
    assert sum(map(len, blocks)) < JOINED_ROWS
    assert len(blocks) == 1
