"""The result does not depend on who computes its curves, and nobody is left waiting."""

import subprocess
import sys
from unittest import mock

import numpy as np
import pytest

from allanscope.analysis import Analyser, summarise
from allanscope.analysis.curves import curves_of_bank
from allanscope.errors import InputError
from allanscope.pipeline import DeviceSettings, analyse_file, analyse_input, process
from allanscope.samples import Block, StreamInfo, Ticks
from allanscope.wire import LinkStats
from allanscope.worker_process import WorkerProcess


def test_curves_are_computed_by_a_worker_or_here_if_it_has_ended():
    analyser = Analyser()
    analyser.feed(StreamInfo(("gx", "gy"), (0.004375, 0.004375), nominal_hz=104.0))
    counts = np.rint(np.random.default_rng(5).normal(0.0, 10.0, (3000, 2))).astype(np.int16)
    analyser.feed(Block(0, counts, Ticks.none()))

    def result(*workers):
        return summarise(analyser, LinkStats(), "full", {}, workers=workers)

    here = result()
    with WorkerProcess() as worker:
        with mock.patch.object(worker, "call", wraps=worker.call) as call:
            there = result(worker)
        assert curves_of_bank in [asked.args[0] for asked in call.call_args_list]
        worker.close()
        assert result(worker).to_dict() == here.to_dict()
    assert there.to_dict() == here.to_dict()


def test_a_process_that_loads_while_a_file_is_read_changes_nothing_and_ends(tmp_path, monkeypatch):
    started = []

    class Watched(WorkerProcess):
        def __init__(self, preload=""):
            super().__init__(preload)
            started.append(self)

    for module in (analyse_file, process):
        monkeypatch.setattr(module, "usable_processes", lambda: 2)
    monkeypatch.setattr(process, "WorkerProcess", Watched)
    path, empty = tmp_path / "rows.csv", tmp_path / "empty.csv"
    rows = np.random.default_rng(6).normal(0.0, 0.04, (7000, 2)).round(6)
    path.write_text("gx,gy\n" + "".join(f"{x},{y}\n" for x, y in rows))
    empty.write_text("gx,gy\n" + "nan,nan\n" * 20)
    device = DeviceSettings(rate_hz=104.0)
    plain = analyse_input(path, device, quiet=True)
    assert not started, "a short file is read before a process has started"
    monkeypatch.setattr(process, "LONG", 0)
    assert analyse_input(path, device, quiet=True).to_dict() == plain.to_dict()
    with pytest.raises(InputError):
        analyse_input(empty, device, quiet=True)
    assert len(started) == 2
    assert all(one._process.poll() is not None for one in started)


FIRST_PROCESS = """
import os, sys
from allanscope.pipeline import process
def started(preload):
    print(preload, "numpy" in sys.modules, flush=True)
    os._exit(0)
process.usable_processes, process.WorkerProcess = lambda: 2, started
from allanscope.__main__ import main
main(["analyse", sys.argv[1]])
"""


@pytest.mark.parametrize("as_folder", [False, True])
def test_it_is_started_before_anything_heavy_is_loaded(tmp_path, as_folder):
    """It loads, and at a first run compiles, what the search takes while this process reads."""
    file = tmp_path / "session.mcap"
    file.write_bytes(bytes(process.LONG + 1))
    command = [sys.executable, "-c", FIRST_PROCESS, str(tmp_path if as_folder else file)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["allanscope.analysis.summary", "allanscope.explain.loop", "False"]
