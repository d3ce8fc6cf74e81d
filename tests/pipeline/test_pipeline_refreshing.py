"""How old a result may grow while a run goes on, with and without anybody to look at it."""

import threading
from itertools import pairwise

import pytest

from allanscope.analysis import Analyser
from allanscope.pipeline.refreshing import Refresher, _pause
from allanscope.pipeline.session import UNWATCHED_SHARE, WATCHED_SHARE


def results(until_s, took_s, share):
    """Return when results come that each take so long and as much of the processor."""
    shown, now = [], 0.0
    while now < until_s:
        now += took_s
        shown.append(now)
        now += _pause(now, took_s / share, took_s)
    return shown


@pytest.mark.parametrize("share", [WATCHED_SHARE, UNWATCHED_SHARE])
@pytest.mark.parametrize("took_s", [0.05, 0.4, 2.0])
def test_no_result_grows_older_than_promised(share, took_s):
    shown = results(4 * 3600.0, took_s, share)
    for before, after in pairwise(shown):
        # Two thousand reads a second offer it: it is taken at once.
        assert after - before <= max(5.0, min(60.0, 0.1 * before)) + 1e-9
    assert len([t for t in shown if t <= 60.0]) >= 12


def test_what_nobody_looks_at_costs_little_after_the_first_minutes():
    shown = results(3600.0, 0.5, UNWATCHED_SHARE)
    assert 0.5 * len([t for t in shown if t > 600.0]) < 0.011 * 3000.0


def test_a_slow_machine_keeps_half_of_its_time():
    shown = results(600.0, 8.0, UNWATCHED_SHARE)
    assert min(b - a for a, b in pairwise(shown)) >= 16.0


def test_the_first_result_comes_with_the_first_samples():
    shown = threading.Event()
    refresher = Refresher(lambda frozen: shown.set(), UNWATCHED_SHARE)
    refresher.offer(Analyser())
    assert shown.wait(30.0)
    refresher.close()
