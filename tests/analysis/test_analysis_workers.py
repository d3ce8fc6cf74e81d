"""The result does not depend on who computes its curves."""

from unittest import mock

import numpy as np

from allanscope.analysis import Analyser, summarise
from allanscope.analysis.curves import curves_of_bank
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
