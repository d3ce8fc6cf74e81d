"""Progress: silent when short, a bar on a terminal, lines in a log."""

import io
import sys
from types import ModuleType

import pytest

import allanscope.view.progress_bar as module
from allanscope.view import is_notebook, progress
from support.terminal import Terminal

LONG = """
import time
import allanscope.view.progress_bar as module
module._SILENT_FOR_S = 0.0
with module.progress(100.0, "replaying\\x07", unit="samples", stream=sys.stdout) as advance:
    for _ in range(10):
        advance(5.0)
        time.sleep(0.03)
    advance(25.0)
    time.sleep(0.6)
print("done")
"""
SILENT = """
import time
import allanscope.view.progress_bar as module
module._SILENT_FOR_S = 0.0
with module.progress(None, "searching for effects", stream=sys.stdout):
    time.sleep(0.7)
print("done")
"""


def test_a_bar_shows_share_rate_and_time_left_and_leaves_no_trace():
    with Terminal(LONG, 80, 24) as terminal:
        assert terminal.finish() == 0, terminal.process.stderr.read()
        assert "75 %" in terminal.raw
        assert "samples/s" in terminal.raw
        assert "left" in terminal.raw
        assert "\x07" not in terminal.raw
        assert terminal.screen().text.strip() == "done"


def test_a_short_job_shows_nothing():
    script = LONG.replace("_SILENT_FOR_S = 0.0", "_SILENT_FOR_S = 60.0")
    with Terminal(script, 80, 24) as terminal:
        assert terminal.finish() == 0
        assert terminal.raw.strip() == "done"


def test_a_log_gets_a_line_now_and_then(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    out = io.StringIO()
    with progress(200e6, "reading", unit="B", stream=out) as advance:
        for _ in range(10):
            now[0] += 10.0
            advance(10e6)
    assert out.getvalue().splitlines() == [
        "reading: 15 %, 1.00 MB/s, 2 min 50 s left",
        "reading: 30 %, 1.00 MB/s, 2 min 20 s left",
        "reading: 45 %, 1.00 MB/s, 1 min 50 s left",
    ]


def test_quiet_shows_nothing(capsys):
    with progress(None, "reading", quiet=True) as advance:
        advance(1.0)
    assert capsys.readouterr() == ("", "")


def test_an_unknown_total_has_a_rate_but_no_share(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    out = io.StringIO()
    with progress(None, "reading", unit="B", stream=out) as advance:
        now[0] = 100.0
        advance(12300.0)
    assert out.getvalue() == "reading: 123 B/s\n"


def test_the_pace_of_a_recording_is_a_multiple_of_real_time(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    out = io.StringIO()
    with progress(43200.0, "analysing", unit="s", stream=out) as advance:
        now[0] = 40.0
        advance(21600.0)
    assert out.getvalue() == "analysing: 50 %, 540 times real time, 40 s left\n"


def test_a_job_that_says_nothing_meanwhile_still_shows_a_bar():
    with Terminal(SILENT, 80, 24) as terminal:
        assert terminal.finish() == 0, terminal.process.stderr.read()
        assert "searching for effects" in terminal.raw
        assert "/s" not in terminal.raw
        assert terminal.screen().text.strip() == "done"


def test_an_error_inside_comes_out_and_the_bar_is_gone():
    script = LONG.replace("advance(25.0)", "raise SystemExit(3)")
    with Terminal(script, 80, 24) as terminal:
        assert terminal.finish() == 3
        assert "\x1b[?25h" in terminal.raw


def test_progress_is_only_shown_for_what_is_done():
    with pytest.raises(ZeroDivisionError), progress(1.0, "x", quiet=True):
        raise ZeroDivisionError


class Shell:
    """What IPython gives in a notebook, as far as it is used."""

    kernel = object()


class Output:
    """The output of a cell."""

    def __init__(self):
        self.shown = []

    def update(self, html):
        self.shown.append(html)


def test_a_notebook_shows_a_bar_that_is_gone_at_the_end(monkeypatch):
    output = Output()

    def display(html, *, display_id):
        assert display_id
        output.update(html)
        return output

    package, module = ModuleType("IPython"), ModuleType("IPython.display")
    package.get_ipython = Shell
    module.HTML, module.display = str, display
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    monkeypatch.setattr("allanscope.view.progress_bar._NOTEBOOK_EVERY_S", 0.0)
    assert is_notebook()
    with progress(200.0, "reading <b>", unit="B") as advance:
        advance(50.0)
    began, half, end = output.shown
    assert 'max="200" value="0"' in began
    assert 'max="200" value="50"' in half
    assert "&lt;b&gt;" in half
    assert "B/s" in half
    assert end == ""
    with progress(None, "searching for effects", quiet=True):
        assert len(output.shown) == 3


def test_a_terminal_is_no_notebook():
    assert not is_notebook()
