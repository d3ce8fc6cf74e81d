"""Tables, log lines and trends: what is told, and that devices cannot forge it."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from allanscope.analysis import best_text, coefficient_text, rate_text, wait_text
from allanscope.noise import Coefficient
from allanscope.samples import Gap
from allanscope.sanitize import markdown, one_line
from allanscope.view.change_log import ChangeLog, GapThrottle, Trends
from allanscope.view.tables import (
    axis_table,
    coefficients_table,
    findings_table,
    loop_table,
    run_table,
)
from support.demo_analysis import demo_analysis

HOSTILE = "gyro\x1b[2J\x07\r\n\u202etxet | [x](http://y) ![p](http://z) <b> `c` \u2028"


@given(st.text())
def test_no_control_character_survives(text):
    shown = one_line(text)
    assert all(character.isprintable() for character in shown)
    assert len(shown) <= 404


@given(st.text(max_size=300).filter(str.isprintable))
def test_visible_text_is_shown_as_it_is(text):
    assert one_line(text) == text


def test_markdown_from_a_device_is_only_text():
    shown = markdown(HOSTILE)
    for mark in "|[]`<>!":
        assert shown.count(mark) == shown.count(f"\\{mark}")


def test_a_hostile_name_stays_one_cell_of_the_table(analysis):
    table = run_table(replace(analysis, input={"name": HOSTILE, "wire": HOSTILE}), {"s": HOSTILE})
    for line in table.splitlines():
        unescaped = line.replace("\\|", "")
        assert unescaped.count("|") == 3, line


def test_the_table_of_coefficients_shows_values_limits_and_the_verdict(analysis):
    lines = coefficients_table(analysis).splitlines()
    (gx,) = [line for line in lines if line.startswith("| gx")]
    assert "| 2.900 [2.874, 2.926] |" in gx
    assert "| < 28 |" in gx, "K is not detected: an upper limit"
    assert gx.endswith("| typical |")
    assert any("N, mdps/√Hz" in line for line in lines)
    assert any("N, µg/√Hz" in line for line in lines)


def test_the_table_of_an_axis_says_how_long_to_wait(analysis):
    table = axis_table("gx", analysis.axes["gx"])
    (k,) = [line for line in table.splitlines() if line.startswith("| **K**")]
    assert k.endswith("| 10 h |")
    assert "found: **line**: frequency 49.980 \\[49.969, 49.991\\] Hz" in table


def test_findings_name_the_effect_its_twins_and_its_equivalents(analysis):
    text = findings_table(analysis)
    assert "- **gx gy** line at 49.98 Hz, 20 mdps" in text
    assert "    - **gy** **line**" in text
    assert "or temperature" in text
    assert "az: a rise near tau = 300 s is left that no effect explains" in text


def test_the_loop_shows_the_error_before_and_after(analysis):
    lines = loop_table(analysis, "dps").splitlines()
    (gx,) = [line for line in lines if line.startswith("| gx")]
    assert "7.40 → **1.05**" in gx
    assert "481 ± 22" in gx
    assert len(lines) == 2 + 3, "only the axes of this sensor"
    (az,) = [line for line in loop_table(analysis, "g").splitlines() if line.startswith("| az")]
    assert "partly unexplained" in az


def test_a_run_that_has_just_begun_has_tables_too(analysis):
    axes = {
        name: replace(axis, coefficients={}, explanation=None, best_averaging=None, datasheet={})
        for name, axis in analysis.axes.items()
    }
    young = replace(analysis, axes=axes, remarks=(), temperature={})
    assert "no fit yet" in axis_table("gx", young.axes["gx"])
    assert "no effects found" in findings_table(young)
    assert "not searched yet" in loop_table(young, "g")
    assert "| gx | - | - | - | - | - |" in coefficients_table(young)


def test_a_coefficient_that_is_not_detected_is_a_limit_and_a_wait():
    known = Coefficient(1e-6, 0.0, 40e-6, "g", detected=False, wait_s=4800.0)
    assert coefficient_text("g", "B", known) == "< 40"
    assert wait_text(known) == "80 min"
    assert coefficient_text("g", "B", None) == "-"


def test_a_rate_that_is_not_measured_is_labelled_nominal(analysis):
    assert rate_text(replace(analysis.rate, measured_hz=None)) == "6660 Hz nominal"
    assert rate_text(replace(analysis.rate, measured_hz=None, nominal_hz=0.0)) == (
        "rate not known yet"
    )


def test_the_diary_tells_every_thing_once(analysis):
    log = ChangeLog()
    first = log.update(analysis)
    assert ("warn", "the device dropped 1998 samples once") in first
    assert sum(text.startswith("found on gx gy: line") for _, text in first) == 1
    assert any(text.startswith("gx: N = 2.900 [2.874, 2.926] mdps/√Hz") for _, text in first)
    assert log.update(analysis) == []
    assert log.update(demo_analysis(7400.0)) == [], "better known is no news"


def test_a_remark_whose_number_grows_is_told_again_at_ten_times_as_much(analysis):
    log, told = ChangeLog(), []
    for count in [*range(3, 4000), 4000]:
        remark = f"saturated: {count} samples at the end of the range"
        axes = {"gx": replace(analysis.axes["gx"], remarks=(remark,))}
        told += [text for _, text in log.update(replace(analysis, axes=axes)) if "satur" in text]
    counts = [int(text.split()[2]) for text in told]
    assert counts == [3, 30, 300, 3000]


def test_remarks_of_other_words_and_of_other_axes_are_told_each(analysis):
    log = ChangeLog()
    remarks = ("saturated: 3 samples", "every sample is 3 counts: 12 345 in all")
    axes = {name: replace(analysis.axes["gx"], remarks=remarks) for name in ("gx", "gy")}
    told = [text for _, text in log.update(replace(analysis, axes=axes, remarks=()))]
    assert [text for text in told if "ample" in text] == [
        f"{name}: {remark}" for name in ("gx", "gy") for remark in remarks
    ]
    axes["gy"] = replace(axes["gy"], remarks=("every sample is 4 counts: 23 456 in all",))
    later = replace(analysis, axes=axes, remarks=())
    assert not [text for _, text in log.update(later) if "ample" in text]


def test_the_diary_tells_when_an_effect_is_gone_and_when_it_is_back(analysis):
    log = ChangeLog()
    log.update(analysis)
    gx = analysis.axes["gx"]
    without = replace(gx, explanation=replace(gx.explanation, effects=()))
    gone = log.update(replace(analysis, axes={**analysis.axes, "gx": without}))
    assert [text.partition(" [")[0] for _, text in gone] == [
        "no longer found on gx: line: frequency 49.980"
    ]
    assert len(log.update(analysis)) == 1


def test_two_lines_on_one_axis_are_two_findings(analysis):
    gx = analysis.axes["gx"]
    twice = replace(gx, explanation=replace(gx.explanation, effects=gx.explanation.effects * 2))
    log = ChangeLog()
    log.update(analysis)
    news = log.update(replace(analysis, axes={**analysis.axes, "gx": twice}))
    assert len(news) == 1


@pytest.mark.parametrize(("factor", "direction"), [(1.5, "down"), (0.5, "up"), (1.0001, "settled")])
def test_a_trend_compares_with_half_the_run(analysis, factor, direction):
    gx = analysis.axes["gx"]
    n = gx.coefficients["N"]
    before = replace(gx, coefficients={"N": replace(n, value=factor * n.value)})
    trends = Trends()
    trends.update(replace(analysis, duration_s=3000.0, axes={"gx": before}))
    trends.update(analysis)
    assert trends.direction(analysis, "gx", "N") == direction


def test_a_trend_is_unknown_without_a_value_then_and_now(analysis):
    trends = Trends()
    trends.update(analysis)
    assert trends.direction(analysis, "gx", "N") == ""
    assert trends.direction(replace(analysis, duration_s=1e6), "gx", "K") == ""


def test_trends_of_a_night_stay_small(analysis):
    trends = Trends()
    for t in range(1, 43200, 10):
        trends.update(replace(analysis, duration_s=float(t)))
    assert len(trends._times) < 250


def test_a_flood_of_gaps_is_told_once_a_second():
    throttle = GapThrottle()
    told = [throttle.update(Gap("link", 27), 0.01 * i) for i in range(200)]
    assert [text for text in told if text] == [
        "gap (link): 27 samples lost",
        "gap (link): 27 samples lost; 99 more since the last",
    ]


def test_a_minimum_from_which_the_curve_has_not_risen_says_so():
    axis = demo_analysis(7300.0).axes["gx"]
    for at_end in (True, False):
        best = replace(axis.best_averaging, at_end=at_end)
        told = best_text(replace(axis, best_averaging=best))
        assert told.endswith(", no rise yet") == at_end
    curve = axis.curves["oadev"]
    constant = {"oadev": replace(curve, deviation=0.0 * curve.deviation)}
    assert best_text(replace(axis, curves=constant)) == "-"


def test_a_remark_of_several_axes_is_listed_once(analysis):
    axes = {name: replace(axis, remarks=("saturated",)) for name, axis in analysis.axes.items()}
    text = findings_table(replace(analysis, axes=axes))
    assert text.count("saturated") == 1
    assert f"- {' '.join(axes)}: saturated" in text
