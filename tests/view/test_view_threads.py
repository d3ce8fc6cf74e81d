"""The worker and the pace of results: who measures never waits."""

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from allanscope.view.decimator import LONGEST_S, LogSpacing
from allanscope.view.worker import Worker


@pytest.fixture
def stuck():
    """Return a worker whose first task does not end until the event is set."""
    worker, release, started = Worker("stuck", room=4), threading.Event(), threading.Event()

    def block():
        started.set()
        release.wait(30.0)

    worker.submit(block)
    started.wait(10.0)
    yield worker, release
    release.set()


def test_tasks_are_done_in_order():
    worker, done = Worker("test"), []
    for i in range(100):
        worker.submit(lambda i=i: done.append(i))
    assert worker.settle(10.0)
    assert done == list(range(100))
    assert worker.close(lambda: done.append("last"), 10.0)
    assert done[-1] == "last"


def test_a_full_queue_drops_and_counts_instead_of_waiting(stuck):
    worker, _ = stuck
    assert [worker.submit(lambda: None) for _ in range(6)] == [True] * 4 + [False] * 2
    assert worker.dropped == 2


def test_a_worker_that_hangs_cannot_hold_up_the_end(stuck):
    worker, _ = stuck
    assert worker.close(lambda: None, timeout_s=0.05) is False
    for _ in range(4):
        worker.submit(lambda: None)
    assert worker.close(lambda: None, timeout_s=0.05) is False
    assert worker.settle(0.05) is False


def test_work_that_takes_up_all_there_is_waits_only_once(stuck):
    worker, release = stuck
    done = []
    assert all(worker.submit(lambda: done.append(1), once="rows") for _ in range(50))
    assert worker.dropped == 0
    release.set()
    assert worker.settle(10.0)
    assert done == [1]
    worker.submit(lambda: done.append(2), once="rows")
    assert worker.settle(10.0)
    assert done == [1, 2]


def test_what_was_dropped_can_be_queued_again(stuck):
    worker, release = stuck
    for _ in range(4):
        worker.submit(lambda: None)
    assert not worker.submit(lambda: None, once="rows")
    release.set()
    assert worker.settle(10.0)
    done = []
    assert worker.submit(lambda: done.append(1), once="rows")
    assert worker.settle(10.0)
    assert done == [1]


def test_a_task_that_fails_is_counted_and_the_next_is_done():
    worker, done = Worker("test"), []
    worker.submit(lambda: 1 / 0)
    worker.submit(lambda: done.append(1))
    assert worker.settle(10.0)
    assert (done, worker.failed) == ([1], 1)
    assert isinstance(worker.error, ZeroDivisionError)


def test_twelve_hours_at_one_result_a_second_keep_about_eleven_hundred():
    pace = LogSpacing()
    kept = [t for t in range(1, 43201) if pace.due(float(t))]
    assert 1000 < len(kept) < 1200
    assert kept[:60] == list(range(1, 61)), "every second at first"
    assert max(np.diff(kept)) <= LONGEST_S + 1
    late = np.diff([t for t in kept if 1000 < t < 5000])
    assert late.min() >= 10
    assert late.max() <= 51


def test_a_stretched_pace_keeps_fewer():
    pace = LogSpacing(5.0)
    assert [t for t in range(1, 30) if pace.due(float(t))] == [1, 6, 11, 16, 21, 26]


def test_a_run_that_begins_anew_is_shown_at_once():
    pace = LogSpacing()
    assert pace.due(5000.0)
    assert pace.due(1.0)


@given(st.lists(st.floats(0.01, 200.0), min_size=1, max_size=50))
def test_no_stretch_of_a_run_longer_than_a_minute_is_without_a_result(steps):
    pace, last = LogSpacing(), None
    for t in np.cumsum(steps):
        if pace.due(float(t)):
            last = t
        assert last is not None
        assert t - last < LONGEST_S
