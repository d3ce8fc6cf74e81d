"""How a worker does the analysis of a single run."""

from __future__ import annotations

from dataclasses import replace

from allanscope.analysis.row_buffer import WORTH_IT
from allanscope.fleet.worker_tasks import new_analyser
from allanscope.pipeline import DeviceSettings, full_settings


def test_a_worker_does_the_same_on_one_core() -> None:
    mine, single = new_analyser(DeviceSettings(part="LSM6DSL")).settings, full_settings("LSM6DSL")
    assert mine.processes == 1
    assert mine.buffered_rows < WORTH_IT <= single.buffered_rows
    assert not mine.over_time  # nobody looks at maps of a lot
    more = {"processes": single.processes, "buffered_rows": single.buffered_rows, "over_time": True}
    assert replace(mine, **more) == single
