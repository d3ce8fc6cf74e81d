"""A session in a terminal, with its keys, from the first sample to the files it leaves."""

import json
import re

import numpy as np
import pytest

from allanscope.recording import Recording
from support.readback import read_back
from support.terminal import Terminal

RUN = "from allanscope.__main__ import main\nraise SystemExit(main({arguments!r}))\n"
LABEL = re.compile(r"OADEV  τ = (\S+) s  σ = (\S+) mdps")


def run(*arguments):
    return RUN.format(arguments=list(map(str, arguments)))


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Run a session on 80 columns, set a mark after some seconds, end it; return what is left."""
    folder = tmp_path_factory.mktemp("keys") / "session"
    script = run("live", "sim", "--view", "none", "--out", folder)
    with Terminal(script, 80, 24) as terminal:
        terminal.read_until("q end and report")
        terminal.read_until_row(r"az  \d")
        terminal.type("m")
        terminal.read_until("mark: mark 1")
        terminal.type("q")
        assert terminal.finish() == 0, terminal.process.stderr.read()
        assert terminal.modes == terminal.modes_before
        return folder, terminal.screen()


@pytest.fixture(scope="module")
def result(session):
    return json.loads((session[0] / "result.json").read_text())


def test_q_ends_the_run_and_leaves_everything(session, result):
    folder, screen = session
    assert {"report.html", "result.json", "session.mcap", "session.rrd"} == {
        path.name for path in folder.iterdir()
    }
    assert result["samples"] > 50
    assert "Saved" in screen.text
    assert "report.html" in screen.text


def test_the_last_screen_has_the_verdict_and_every_axis(session):
    _, screen = session
    assert screen.text.count("allanscope  LSM6DSM  sim  native") == 1, "one screen, redrawn"
    assert "Noise matches the datasheet: density √2 N of gyroscope" in screen.text
    rows = [row[:2] for row in screen.rows if re.match(r"[ga][xyz]  \d", row)]
    assert rows == ["gx", "gy", "gz", "ax", "ay", "az"]


def test_a_record_too_short_for_the_loop_says_so_in_plain_words(session):
    _, screen = session
    assert "needed to search" in " ".join(screen.text.split())
    assert re.search(r"record at least \d+ s longer", " ".join(screen.text.split()))
    assert "unexplained" not in screen.text


def test_m_sets_a_mark_in_recording_result_report_and_viewer(session, result):
    folder, _ = session
    kept = [fields for _, fields in Recording(folder).events() if fields.get("kind") == "mark"]
    assert [fields["text"] for fields in kept] == ["mark 1"]
    (mark,) = result["marks"]
    assert mark["text"] == "mark 1"
    assert 0.0 < mark["time_s"] <= result["duration_s"] + 0.5
    report = (folder / "report.html").read_text()
    assert re.search(r"<ol><li>[^<]*: mark 1</li></ol>", report)
    log = [row.values["TextLog:text"][0] for row in read_back(folder / "session.rrd")["/log"]]
    assert "mark: mark 1" in log


def test_what_the_viewer_was_shown_is_what_the_result_says(session, result):
    folder, _ = session
    rows = read_back(folder / "session.rrd")
    for axis in ("gx", "gy", "gz"):
        curve = result["axes"][axis]["curves"]["oadev"]
        labels = rows[f"/{axis}/allan/oadev/points"][-1].values["Points2D:labels"]
        drawn = [tuple(map(float, LABEL.match(text).groups())) for text in labels]
        shown = {round(float(f"{tau:.4g}"), 9): 1e3 * s for tau, s in zip(*pairs(curve), strict=1)}
        assert len(drawn) >= 0.7 * len(shown), "all but what lies off the chart"
        for tau, sigma in drawn:
            assert sigma == pytest.approx(shown[round(tau, 9)], rel=6e-4)
    known = [result["axes"][axis]["coefficients"]["N"] for axis in ("gx", "gy", "gz")]
    plotted = rows["/coefficients/gyro/N"][-1].values["Measurements:values"]
    for one, value in zip(known, plotted, strict=True):
        assert np.isnan(value) or value == pytest.approx(1e3 * one["value"])
    lost = rows["/link/lost"][-1].values["Scalars:scalars"]
    assert lost == [result["lost_samples"], result["unknown_losses"]]
    assert "of gyroscope" in rows["/tables/verdict"][-1].values["TextDocument:text"][0]


def pairs(curve):
    return curve["tau"], curve["deviation"]


def test_a_replay_on_200_columns_takes_keys_too(session):
    script = run("replay", session[0], "--view", "none", "--speed", "0.5")
    with Terminal(script, 200, 50) as terminal:
        terminal.read_until("q end and report")
        terminal.type("m")
        terminal.read_until("mark: mark 1")
        terminal.type("q")
        assert terminal.finish() == 0, terminal.process.stderr.read()
        screen = terminal.screen()
    assert "minimum deviation, mdps" in screen.text
    assert "datasheet" in screen.text
    assert re.search(r" of [\d.]+ s, [\d.]+ s left", terminal.raw)


def test_piped_it_is_plain_lines_and_quiet_is_silent(session):
    script = "import sys, io\n" + run("replay", session[0], "--view", "none").replace(
        "raise", "sys.stdout = io.TextIOWrapper(open('/dev/null', 'wb'))\nraise"
    )
    with Terminal(script, 80, 24) as terminal:
        assert terminal.finish() == 0
        assert "\x1b[?25l" not in terminal.raw, "no screen is drawn where nobody looks"
    with Terminal(run("replay", session[0], "--view", "none", "--quiet"), 80, 24) as terminal:
        assert terminal.finish() == 0
        assert terminal.raw == ""


def test_a_terminal_that_takes_nothing_holds_up_nothing(tmp_path):
    folder = tmp_path / "session"
    script = run("live", "sim", "--view", "none", "--for", "8s", "--out", folder)
    with Terminal(script, 80, 24) as terminal:
        terminal.read_until("receiving")
        terminal.type("\x13")  # Ctrl-S
        assert terminal.process.wait(timeout=100) == 0
        assert terminal.modes == terminal.modes_before
    result = json.loads((folder / "result.json").read_text())
    assert result["samples"] > 7 * 100
    assert result["lost_samples"] == 0
