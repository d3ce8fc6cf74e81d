"""Another interpreter: what it is asked, what it holds, and how it ends."""

from __future__ import annotations

import operator
import os
import re
import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from allanscope.errors import UsageError
from allanscope.median import median
from allanscope.worker_process import WorkerError, WorkerProcess, place_of

REFUSING = """
from allanscope.errors import UsageError
raise UsageError("no such place; choose another")
"""
FREED = """
import resource
import numpy as np
np.ones(5 << 20)  # 40 MB; the first one is taken from the system
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    np.ones(5 << 20)
more = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
assert more < 200, more
"""
UNREADABLE = "[type('', (), {'__reduce__': lambda _: (divmod, (1, 0))})(), bytes(1 << 20)]"
"""Fails when it is read, with more to come than a pipe holds."""
ODD = """
class Odd(Exception):
    pass
raise Odd("three")
"""


def test_it_is_another_process_that_computes_the_same():
    with WorkerProcess() as worker:
        assert worker.call(os.getpid) != os.getpid()
        assert worker.call(np.arange, 3, dtype="u1").tolist() == [0, 1, 2]


def test_what_is_held_is_not_sent_again_and_comes_back_as_itself():
    large, small = np.arange(1_000_000.0), np.arange(3.0)
    with WorkerProcess() as worker:
        worker.share(large, small)
        first, second = worker.call(list, (large, small, large))[:2]
        assert first is large
        assert second is small
        assert worker.call(operator.itemgetter(-1), large) == 999_999.0


def test_an_error_there_is_raised_here_and_the_next_call_is_answered():
    with WorkerProcess() as worker:
        with pytest.raises(ZeroDivisionError):
            worker.call(operator.truediv, 1, 0)
        with pytest.raises(UsageError, match="choose another"):
            worker.call(exec, REFUSING)
        with pytest.raises(RuntimeError, match="Odd: three"):
            worker.call(exec, ODD)
        with pytest.raises(TypeError) as raised:
            worker.call(median, None)
        assert re.fullmatch(r"median\.py:\d+", place_of(raised.value))
        assert worker.call(operator.add, 1, 2) == 3


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux is told")
def test_it_takes_again_the_memory_that_it_has_freed():
    with WorkerProcess() as worker:
        worker.call(exec, FREED)


def test_a_call_from_another_thread_waits_for_its_turn():
    with WorkerProcess("json csv") as worker, ThreadPoolExecutor(1) as beside:
        earlier = beside.submit(worker.call, operator.mul, 3, 5)
        assert [worker.call(operator.add, 1, k) for k in range(50)] == list(range(1, 51))
        assert earlier.result() == 15


def test_what_is_shared_while_another_thread_calls_does_not_mix_with_the_call():
    large = [np.arange(1_000_000.0) + k for k in range(4)]
    with WorkerProcess() as worker, ThreadPoolExecutor(1) as other:
        coming = other.submit(worker.call, np.concatenate, large)
        worker.share(*large[1:])
        assert np.array_equal(coming.result(timeout=60.0), np.concatenate(large))
        assert worker.call(operator.is_, large[1], large[1])


def test_nobody_waits_until_a_process_that_computes_takes_what_is_shared():
    with ThreadPoolExecutor(1) as beside, WorkerProcess() as worker:
        worker.ask(time.sleep, 600.0)
        beside.submit(worker.share, np.zeros(1_000_000)).result(timeout=60.0)


def test_what_is_printed_there_is_no_answer(capfd):
    with WorkerProcess() as worker:
        assert worker.call(print, "not an answer") is None
    assert capfd.readouterr() == ("", "")


def test_a_process_that_was_killed_is_an_error_with_its_code():
    with WorkerProcess() as worker:
        os.kill(worker.call(os.getpid), signal.SIGKILL)
        with pytest.raises(WorkerError, match="ended with code -9"):
            worker.call(os.getpid)
    with WorkerProcess() as worker:
        worker.ask(time.sleep, 600.0)
        worker.close()
        with pytest.raises(WorkerError, match="was ended"):
            worker.answer()


def test_a_process_whose_answer_cannot_be_taken_is_ended_and_answers_nothing_more():
    with WorkerProcess() as worker:
        with pytest.raises(WorkerError, match="ZeroDivisionError"):
            worker.call(eval, UNREADABLE)
        with pytest.raises(WorkerError, match="ended"):
            worker.call(operator.add, 1, 2)


def test_a_module_that_is_not_there_is_an_error_with_its_name():
    with (
        WorkerProcess("allanscope.no_such_module") as worker,
        pytest.raises(WorkerError, match="no_such_module"),
    ):
        worker.call(os.getpid)


def test_no_process_outlives_its_pipe():
    worker = WorkerProcess()
    pid = worker.call(os.getpid)
    assert worker._process is not None
    assert worker._process.stdin is not None
    worker._process.stdin.close()  # as when the parent is killed
    assert worker._process.wait(60.0) == 0
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    worker.close()
