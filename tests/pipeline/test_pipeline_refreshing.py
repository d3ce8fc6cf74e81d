"""How old a result may grow while a run goes on, with and without anybody to look at it."""

import threading
from itertools import pairwise

import numpy as np
import pytest

from allanscope.analysis import Analyser
from allanscope.pipeline import Decoding, session
from allanscope.pipeline.refreshing import IN_TERMINAL, IN_VIEWER, UNWATCHED, Refresher, _pause
from allanscope.samples import Block, StreamInfo, Ticks
from allanscope.wire import WireSettings


def results(until_s, took_s, policy):
    """Return when results come that each take so long and as much of the processor."""
    shown, now = [], 0.0
    while now < until_s:
        now += took_s
        shown.append(now)
        now += _pause(now, took_s, took_s, policy)
    return shown


@pytest.mark.parametrize("policy", [IN_VIEWER, IN_TERMINAL])
@pytest.mark.parametrize("took_s", [0.05, 0.4, 2.0])
def test_no_result_on_a_screen_grows_older_than_promised(policy, took_s):
    shown = results(4 * 3600.0, took_s, policy)
    for before, after in pairwise(shown):
        # Two thousand reads a second offer it: it is taken at once.
        assert after - before <= max(5.0, min(60.0, 0.1 * before)) + 1e-9
    assert len([t for t in shown if t <= 60.0]) >= 12


def test_what_no_viewer_shows_costs_little_after_the_first_minutes():
    shown = results(3600.0, 0.5, IN_TERMINAL)
    assert 0.5 * len([t for t in shown if t > 600.0]) < 0.011 * 3000.0


@pytest.mark.parametrize("took_s", [0.05, 0.4, 2.0])
def test_where_nobody_looks_results_come_when_the_run_is_three_times_as_long(took_s):
    shown = results(4 * 3600.0, took_s, UNWATCHED)
    for before, after in pairwise(shown):
        assert after - before <= max(5.0, min(60.0, 2.0 * before)) + 1e-9
    assert 2 <= len([t for t in shown if 5.0 < t <= 60.0]) <= 4
    assert took_s * len([t for t in shown if t > 600.0]) < 0.034 * 4 * 3600.0


def test_a_slow_machine_keeps_half_of_its_time():
    shown = results(600.0, 8.0, IN_TERMINAL)
    assert min(b - a for a, b in pairwise(shown)) >= 16.0


def test_the_first_result_comes_with_the_first_samples():
    shown = threading.Event()
    refresher = Refresher(lambda frozen: shown.set(), IN_TERMINAL)
    refresher.offer(Analyser())
    assert shown.wait(30.0)
    refresher.close()


@pytest.mark.parametrize(("rows", "after_s", "has_one"), [(63, 0.0, 0), (64, 0.0, 1), (63, 1.1, 1)])
def test_a_result_waits_for_the_rows_of_a_curve_but_not_long(rows, after_s, has_one, monkeypatch):
    class Silent:
        name, reader = "none", "nobody"

        def close(self):
            """Nothing is open."""

    now_s = [100.0]
    monkeypatch.setattr(session.time, "monotonic", lambda: now_s[0])
    one = session.Session(Silent(), Decoding(WireSettings()), Analyser())
    one.analyser.feed(StreamInfo(("gx",), (0.004375,), nominal_hz=12.5))
    assert not one._has_result()
    one.analyser.feed(Block(0, np.zeros((rows, 1), np.int16), Ticks.none()))
    one._has_result()  # the first samples have come
    now_s[0] += after_s
    assert one._has_result() == bool(has_one)
    one._refresher.close()
