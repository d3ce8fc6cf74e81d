"""The terminal view, on real terminals of 80 and 200 columns, through a pipe, and in silence."""

import io
import os
import signal
import subprocess
import sys
import termios
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from allanscope.analysis import VerdictLine, verdict
from allanscope.noise import Coefficient
from allanscope.samples import Gap, Notice
from allanscope.view import TerminalView, summary_lines, terminal_screen
from allanscope.view.change_log import Trends
from allanscope.view.palette import AXIS
from allanscope.view.terminal_screen import Screen, curve_lines
from support.demo_analysis import demo_analysis
from support.demo_session import INFO, blocks
from support.terminal import Screen as TerminalScreen
from support.terminal import Terminal

RUN = """
from support.demo_analysis import demo_analysis
from support.demo_session import INFO
from allanscope.samples import Gap, Notice
from allanscope.view import TerminalView
view = TerminalView("auto")
view.info(INFO)
view.snapshot(demo_analysis(60.0))
view.gap(Gap("link", 27))
view.notice(Notice("text", "firmware \\x1b[2J\\x07 2.1"))
for seconds in (600.0, 3000.0, 7300.0):
    view.snapshot(demo_analysis(seconds))
view.close()
"""
WAIT = """
import time
from support.demo_analysis import demo_analysis
from allanscope.view import TerminalView
done = []
mark = lambda text: view.line(f"set {text}")
view = TerminalView("auto", on_mark=mark, on_quit=lambda: done.append(1))
view.snapshot(demo_analysis(60.0))
print("ready", flush=True)
while not done:
    time.sleep(0.01)
view.close()
"""

LONG_UNTIL_THE_NEXT_RESULT = """
from support.demo_analysis import demo_analysis
from support.demo_session import INFO, blocks
from allanscope.view import TerminalView
now = [0.0]
view = TerminalView("auto", clock=lambda: now[0])
view.snapshot(demo_analysis(60.0))
for now[0], block in zip((0.5, 1.5, 2.0), blocks(3.0)):
    view.samples(INFO, block)
    view._worker.settle(30.0)
"""


class Clock:
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self):
        return self.now


@pytest.mark.parametrize("columns", [80, 200])
def test_the_screen_is_readable_and_calm(columns):
    with Terminal(RUN, columns, 24) as terminal:
        assert terminal.finish() == 0, terminal.process.stderr.read()
        screen = terminal.screen()
    text = screen.text
    assert text.count("allanscope  LSM6DSM  /dev/ttyACM0  native") == 1, "one screen, redrawn"
    assert "2 h 1 min" in text
    assert "6664.2000 Hz ±0.11 ppm" in text
    assert "48 648 660 samples" in text
    assert "lost samples: 1 998" in text
    assert "31.6 °C" in text
    rows = {row[:2]: row for row in screen.rows if row[:2] in demo_analysis(1.0).axes}
    assert len(rows) == 6
    value = "2.900 ±0.026" if columns == 80 else "2.900 [2.874, 2.926]"
    assert value in rows["gx"]
    assert "= " not in rows["gx"], "at the end nothing changes any more"
    assert "95 % intervals, < upper limit" in text
    assert "< 28" in rows["gx"]
    assert "10 h" not in rows["gx"], "a time to wait is no part of a limit"
    assert "K to ±20 % in about 10 h" in text
    assert ("typical" in rows["gx"]) == (columns == 200)
    assert "line at 49.98 Hz, 20 mdps, on gx gy" in " ".join(text.split())
    assert "gap (link): 27 samples lost" in text
    assert "…" not in "".join(rows.values()), "nothing in the table is cut off"


def test_control_characters_of_a_device_never_reach_the_terminal():
    with Terminal(RUN, 80, 24) as terminal:
        terminal.finish()
        assert "\x1b[2J" not in terminal.raw
        assert "\x07" not in terminal.raw
        assert "firmware \ufffd[2J\ufffd 2.1" in terminal.screen().text


def test_a_long_list_of_findings_leaves_room_for_the_numbers():
    analysis = demo_analysis(7300.0)
    many = replace(analysis, remarks=tuple(f"remark {i}" for i in range(30)))
    for lines in (24, 40):
        console = Console(file=io.StringIO(), width=80, height=lines)
        console.print(Screen(many, Trends(), "keys"))
        shown = console.file.getvalue().splitlines()
        assert len(shown) <= lines - 1, "one line is left for what is typed"
        assert len(shown) >= lines - 6
        assert any(line.startswith("gx  2.900") for line in shown)
        assert any(line.endswith("more lines: see the report") for line in shown)
        assert shown[-1].rstrip() == "keys"
    left = next(line for line in shown if line.startswith("and ") and "more" in line)
    details = shown[shown.index("") + 1 :]
    details = details[details.index("") + 1 : details.index(left)]
    assert int(left.split()[1]) + len(details) == len(verdict(many).details)


@pytest.mark.parametrize("columns", [60, 80])
def test_a_narrow_screen_cuts_no_sentence_and_leaves_out_what_matters_least(columns):
    analysis = demo_analysis(7300.0)
    console = Console(file=io.StringIO(), width=columns, height=40)
    console.print(
        Screen(
            analysis,
            Trends(),
            "m mark   q end   ? help   arrows and other signs that are explained",
        )
    )
    shown = [line.rstrip() for line in console.file.getvalue().splitlines()]
    assert max(map(len, shown)) <= columns
    assert not any(line.endswith("…") for line in shown)
    assert "lost samples" in shown[1]
    whole = " ".join(" ".join(shown).split())
    for line in verdict(analysis).lines:
        assert " ".join(f"{line.head}: {line.text}".split()) in whole
    assert shown[-1].startswith("m mark   q end   ? help")
    assert ("arrows" in shown[-1]) == (columns == 80)


def test_it_is_seen_that_the_run_goes_on_while_the_next_result_is_awaited():
    with Terminal(LONG_UNTIL_THE_NEXT_RESULT, 120, 40) as terminal:
        assert terminal.finish() == 0
        header = [row for row in terminal.screen().rows if row.startswith("allanscope")][-1]
        # Half a second is not worth a redraw, and neither is the half second after one.
        assert header.endswith("recorded 1 min 2 s")
        assert "413 180 samples" in terminal.screen().text, "those of the result and 13 328 more"


def test_a_small_terminal_is_not_overrun():
    with Terminal(RUN, 80, 12) as terminal:
        assert terminal.finish() == 0
        assert terminal.screen().text.count("allanscope  LSM6DSM") >= 1


def test_no_color_is_respected():
    x = "38;2;{};{};{}".format(*AXIS["gx"])
    with Terminal(RUN, 80, 24, NO_COLOR="1") as terminal:
        assert terminal.finish() == 0
        assert "\x1b[38;" not in terminal.raw
        assert x not in terminal.raw
    with Terminal(RUN, 80, 24) as terminal:
        terminal.finish()
        assert x in terminal.raw, "the colour of x, otherwise"


def test_m_sets_a_mark_q_ends_and_the_terminal_is_as_before():
    with Terminal(WAIT, 80, 24) as terminal:
        terminal.read_until("ready")
        assert terminal.modes != terminal.modes_before
        assert not terminal.modes[3] & termios.ECHO
        terminal.type("mxM")
        terminal.read_until("set mark 2")
        terminal.type("q")
        assert terminal.finish() == 0
        assert terminal.modes == terminal.modes_before
        assert "\x1b[?25h" in terminal.raw, "the cursor is back"
        assert "m mark" in terminal.raw
        assert "m mark" not in terminal.screen().rows[-2], "keys are gone from the last screen"


def test_marks_of_a_session_that_is_taken_up_are_counted_on():
    marks: list[str] = []
    view = TerminalView("quiet", on_mark=marks.append)
    view._mark()
    view.snapshot(replace(demo_analysis(7200.0), marks=((1.0, "a"), (2.0, "b"), (3.0, "c"))))
    view._mark()
    view._mark()
    assert marks == ["mark 1", "mark 4", "mark 5"]


def test_the_terminal_is_restored_when_the_program_fails():
    script = WAIT.replace("while not done:", "raise SystemExit(7)\nwhile not done:")
    with Terminal(script, 80, 24) as terminal:
        assert terminal.finish() == 7
        assert terminal.modes == terminal.modes_before


def test_ctrl_c_still_interrupts():
    with Terminal(WAIT, 80, 24) as terminal:
        terminal.read_until("ready")
        terminal.type("\x03")
        assert terminal.finish() in (-signal.SIGINT, 130, 1)
        assert terminal.modes == terminal.modes_before


def test_in_the_background_the_terminal_is_left_alone():
    script = "import os\nif os.fork():\n    os.wait()\n    raise SystemExit\nos.setpgid(0, 0)\n"
    script += WAIT.replace("while not done:", "done = [1]\nwhile not done:")
    with Terminal(script, 80, 24) as terminal:
        assert terminal.finish() == 0
        assert terminal.modes == terminal.modes_before
        assert "ready" in terminal.raw


def test_through_a_pipe_there_is_a_line_a_minute_and_every_event():
    out, clock = io.StringIO(), Clock()
    view = TerminalView("auto", stream=out, clock=clock)
    view.info(INFO)
    result = demo_analysis(100.0)
    for second in range(1, 151):
        clock.now = float(second)
        view.snapshot(replace(result, duration_s=float(second)))
    view.gap(Gap("device", None))
    view.notice(Notice("mark", "fan off"))
    view.notice(Notice("status", "not worth a line", {"dropped": 0}))
    view.notice(Notice("error", "sensor overran"))
    view.close()
    lines = out.getvalue().splitlines()
    status = [
        line.split("  6664")[0].strip()
        for line in lines
        if "lost samples" in line and "N gx" in line
    ]
    assert status == ["1.0 s", "1 min 1 s", "2 min 1 s"]
    assert any(line.startswith("gx  2.9") for line in lines), "a summary at the end"
    assert sum("found on gx gy: line" in line for line in lines) == 1
    assert any(line.endswith("gap (device): length unknown") for line in lines)
    assert any(line.endswith("mark: fan off") for line in lines)
    assert any(line.endswith("device: sensor overran") for line in lines)
    assert not any("not worth" in line for line in lines)
    assert "\x1b" not in out.getvalue()


def test_a_replay_says_how_much_is_left():
    out, clock = io.StringIO(), Clock()
    view = TerminalView("plain", stream=out, clock=clock, whole_s=7200.0)
    clock.now = 10.0
    view.snapshot(replace(demo_analysis(60.0), duration_s=1800.0))
    # A quarter took 10 s, so the rest takes 30 s.
    assert out.getvalue().splitlines()[-1].endswith(" µg/√Hz, 30 s left")


def test_what_happens_between_two_results_has_its_own_time():
    """Results are minutes apart in a night; a hole is not where the last of them was."""
    out = io.StringIO()
    view = TerminalView("plain", stream=out)
    view.snapshot(demo_analysis(60.0))
    for block in blocks(3.0):
        view.samples(INFO, block)
    view.gap(Gap("disconnected", 324))
    assert "1 min 3 s  gap (disconnected): 324 samples lost" in out.getvalue()


def test_the_first_seconds_have_one_decimal():
    out, clock = io.StringIO(), Clock()
    view = TerminalView("plain", stream=out, clock=clock)
    for clock.now in (0.0004, 0.66, 9.9, 12.3):
        view.line("hello")
    times = [line.split("  hello")[0].strip() for line in out.getvalue().splitlines()]
    assert times == ["0.0 s", "0.7 s", "9.9 s", "12 s"]


def test_what_changes_has_an_arrow_while_the_run_lasts(monkeypatch):
    monkeypatch.setattr(Trends, "direction", lambda *_: "up")
    analysis, trends = demo_analysis(60.0), Trends()
    for is_final in (False, True):
        console = Console(file=io.StringIO(), width=80, height=40)
        console.print(Screen(analysis, trends, is_final=is_final))
        assert ("↑" in console.file.getvalue()) != is_final


def test_quiet_says_nothing(capsys):
    view = TerminalView("quiet")
    view.info(INFO)
    view.snapshot(demo_analysis(60.0))
    view.line("hello", "error")
    view.close()
    assert capsys.readouterr() == ("", "")


def test_a_dumb_terminal_gets_plain_lines():
    with Terminal(RUN, 80, 24, TERM="dumb") as terminal:
        assert terminal.finish() == 0
        assert "\x1b" not in terminal.raw
        assert "samples, lost samples: none" in terminal.raw


def test_a_reader_that_goes_away_does_not_end_the_measurement():
    script = RUN.replace("view.close()", "") + (
        "for _ in range(3000):\n    view.line('x' * 100)\nview.close()\n"
        "import pathlib; pathlib.Path(sys.argv[1]).write_text('went on')\n"
    )
    here = str(Path(__file__).parents[1])
    script = f"import sys; sys.path.insert(0, {here!r})\n{script}"
    out = Path(os.environ.get("TMPDIR", "/tmp")) / f"allanscope-pipe-{os.getpid()}"
    try:
        run = subprocess.Popen(
            [sys.executable, "-c", script, str(out)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        run.stdout.readline()
        run.stdout.close()
        errors = run.stderr.read()
        run.stderr.close()
        assert run.wait(60) == 0
        assert errors == b""
        assert out.read_text() == "went on"
    finally:
        out.unlink(missing_ok=True)


class FragileTerminal(io.StringIO):
    """A terminal whose connection can drop."""

    gone = False

    def isatty(self):
        return True

    def write(self, text):
        if self.gone:
            raise OSError(5, "Input/output error")
        return super().write(text)


@pytest.mark.parametrize("mode", ["live", "plain"])
def test_a_terminal_that_is_gone_does_not_end_the_measurement(mode):
    stream = FragileTerminal()
    view = TerminalView(mode, stream=stream)
    view.snapshot(demo_analysis(10.0))
    stream.gone = True
    view.line("one")
    view.snapshot(demo_analysis(60.0))
    view.gap(Gap("link", 1))
    view.close()


def test_units_are_spelled_out_where_the_terminal_has_no_letters_for_them():
    out = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    view = TerminalView("plain", stream=out)
    view.snapshot(demo_analysis(7300.0))
    view.close()
    out.flush()
    text = out.buffer.getvalue().decode("ascii")
    assert "6664.2000 Hz +-0.11 ppm" in text
    assert "mdps/sqrt Hz" in text
    assert "?" not in text


def test_the_summary_is_plain_and_complete():
    lines = summary_lines(demo_analysis(7300.0))
    assert max(map(len, lines)) <= 160
    assert "\x1b" not in "".join(lines)
    assert any(line.startswith("gx  2.900 [2.874, 2.926]") for line in lines)
    assert any("warm-up" in line for line in lines)
    assert any("partly unexplained" in line for line in lines)


@pytest.mark.parametrize("columns", [80, 200])
def test_power_laws_that_were_asked_for_are_printed(columns):
    known = demo_analysis(7300.0)
    walk = Coefficient(3e-4, 2.6e-4, 3.4e-4, "dps/s", True)
    none = Coefficient(0.0, 0.0, 1e-6, "dps/s/sqrt(s)", False)
    axes = dict(known.axes)
    axes["gy"] = replace(axes["gy"], power_laws={"N": walk, "F": walk, "D": none})
    page = io.StringIO()
    Console(file=page, width=columns, height=100).print(
        Screen(replace(known, axes=axes), Trends()), end=""
    )
    (head,) = [i for i, x in enumerate(page.getvalue().splitlines()) if "power laws" in x]
    names, row = (page.getvalue().splitlines()[i].split() for i in (head, head + 1))
    assert names == ["power", "laws", "N", "mdps/√Hz", "F", "°/h/h", "D", "°/h/h/√h"]
    assert row[0] == "gy"
    assert row[-2:] == ["<", "780"]  # 1e-6 * 3600^2 * 60
    assert "3890" in row or "3900" in row  # 3e-4 * 3600^2


def test_where_there_are_rows_enough_no_sentence_is_cut():
    analysis = demo_analysis(7300.0)
    console = Console(file=io.StringIO(), width=44, height=1000)
    console.print(Screen(analysis, Trends()))
    whole = " ".join(console.file.getvalue().split())
    for line in [*verdict(analysis).lines, *verdict(analysis).details]:
        assert " ".join(f"{line.head}: {line.text}".split()) in whole


CURVES = WAIT.replace("demo_analysis(60.0)", "demo_analysis(7300.0)")


def braille(text):
    return sum(0x2800 < ord(letter) <= 0x28FF for letter in text)


def test_the_curves_are_drawn_where_there_is_room_and_c_chooses_them():
    with Terminal(CURVES, 120, 48) as terminal:
        terminal.read_until("? help")
        shown = [row for row in terminal.screen().rows if row.count("σ(τ)") == 2]
        assert len(shown) == 1, "both sensors, beside each other"
        for press, titles in (("c", ["mdps"]), ("c", ["µg"]), ("c", []), ("c", ["mdps", "µg"])):
            drawn = terminal.raw.count("? help")
            terminal.type(press)
            terminal.wait_for(lambda raw, drawn=drawn: raw.count("? help") > drawn)
            page = terminal.raw.rsplit("allanscope  ", 1)[1]
            assert [unit for unit in ("mdps", "µg") if f"σ(τ), {unit}" in page] == titles
            assert bool(braille(page)) == bool(titles)
        terminal.type("q")
        assert terminal.finish() == 0
        assert braille(terminal.screen().text), "they stay on the last screen"
    with Terminal(CURVES, 80, 24) as terminal:
        terminal.read_until("m mark")
        assert not braille(terminal.raw), "the numbers are more important"


def test_a_question_mark_explains_the_keys():
    with Terminal(CURVES, 80, 40) as terminal:
        terminal.read_until("? help")
        assert "c  curves: both sensors" not in terminal.raw
        terminal.type("?")
        terminal.read_until("c  curves: both sensors")
        assert all(len(row) <= 80 for row in terminal.screen().rows)


def test_the_keys_are_explained_in_full_in_a_narrow_terminal():
    with Terminal(CURVES, 60, 40) as terminal:
        terminal.read_until("? help")
        terminal.type("?")
        terminal.read_until("=  stable")
        rows = [row.strip() for row in terminal.screen().rows]
        assert "c  curves: both sensors, one of them, none" in rows
        assert "95 % intervals, < upper limit" in rows


def test_a_terminal_that_is_made_narrower_gets_a_clean_page():
    with Terminal(CURVES, 120, 48) as terminal:
        terminal.read_until("m mark")
        terminal.resize(70, 30)
        terminal.raw = ""
        terminal.type("?")
        terminal.read_until("c  curves: both sensors")
        terminal.type("q")
        assert terminal.finish() == 0
        _, page = terminal.raw.split("\r\n" * 29, 1)
        assert page.startswith("\x1b[29A")
        rows = TerminalScreen(page.removeprefix("\x1b[29A"), 70, 30).rows
        assert sum(row.startswith("allanscope  LSM6DSM") for row in rows) == 1
        assert all(len(row) <= 70 for row in rows)


def test_a_curve_lies_where_its_numbers_are():
    analysis = demo_analysis(7300.0)
    axes = {"gx": analysis.axes["gx"]}
    title, *rows, axis, labels = (line.plain for line in curve_lines(axes, 67, 23))
    assert title == "σ(τ), mdps   gx"
    assert labels.endswith(" s")
    ticks = {row[:5].strip(): k for k, row in enumerate(rows) if "┤" in row}
    across = [k for k, letter in enumerate(axis) if letter == "┬"]
    decades = round(len(ticks) - 1), len(across) - 1
    curve = axes["gx"].curves["oadev"]
    near = np.argmin(abs(np.log10(curve.tau)))  # 1 s
    place = (np.log10(curve.tau[near]) + 4) / decades[1]  # the chart begins at 1e-4 s
    column = across[0] + place * (across[-1] - across[0])
    low, high = ticks["0.1"], ticks["10³"]
    sigma = np.log10(1e3 * curve.deviation[near])
    expected = low - (sigma + 1.0) / decades[0] * (low - high)
    drawn = [k for k, row in enumerate(rows) if braille(row[round(column)])]
    assert min(abs(k - expected) for k in drawn) <= 1.0
    assert len(drawn) <= 2, "a line, and no cloud"


def test_the_summary_cuts_no_sentence_however_long(monkeypatch):
    known = verdict(demo_analysis(7300.0))
    text = " ".join(f"line at {hz} Hz;" for hz in range(200))
    lines = (VerdictLine("note", "Additional effects found", text), *known.lines[1:])
    monkeypatch.setattr(terminal_screen, "verdict", lambda _: replace(known, lines=lines))
    shown = " ".join(summary_lines(demo_analysis(7300.0)))
    assert text in " ".join(shown.split())
    assert "95 % intervals, < upper limit" in shown
    assert "as of" not in shown, "all is as of the end"
