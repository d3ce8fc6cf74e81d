"""Axes that are searched in several processes: the result of one, whatever happens to them."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from allanscope.explain import Explanation, explain
from allanscope.history import Record
from allanscope.worker_process import WorkerProcess

SIGMA = 4e-3 * 52.0**0.5


@pytest.fixture
def record(bench: Callable[..., Any]) -> Record:
    """Return three axes: one with a line, two with the same step."""
    b = bench(5, 120.0)
    line = 0.6 * SIGMA * np.sin(2 * np.pi * 3.3 * b.t)
    step = 0.5 * SIGMA * (b.t > 60.0)
    return b.record(b.noise() + line, b.noise() + step, b.noise() + step)


def described(found: Explanation) -> str:
    return repr((found.axes, found.fits, found.models_before, found.models_after, found.row_s))


def test_the_result_does_not_depend_on_the_processes(record: Record) -> None:
    alone = explain(record)
    assert {e.kind for one in alone.axes.values() for e in one.effects} >= {"sinusoid", "step"}
    with WorkerProcess("allanscope.explain.loop") as worker:
        shared = explain(record, workers=[worker])
        again = explain(record, workers=[worker])
    assert described(shared) == described(again) == described(alone)
    for axis in record.axes:
        np.testing.assert_array_equal(shared.cleaned[axis], alone.cleaned[axis])


def test_axes_of_a_process_that_is_killed_are_searched_here(record: Record) -> None:
    with WorkerProcess("allanscope.explain.loop") as worker:
        os.kill(worker.call(os.getpid), signal.SIGKILL)
        assert described(explain(record, workers=[worker])) == described(explain(record))
