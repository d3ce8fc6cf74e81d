"""The verdict: good or not, what is wrong, how much longer to wait."""

from dataclasses import replace

import pytest

from allanscope.analysis import verdict
from allanscope.explain import ResidualError
from allanscope.noise import DatasheetVerdict
from support.demo_analysis import demo_analysis

UNKNOWN = ResidualError(*[float("nan")] * 5)
NOT_KNOWN = DatasheetVerdict(3.8e-3, None, "dps/sqrt(Hz)", "not known yet", "")
TOO_SHORT = "6 s are too short to look for effects: run at least 54 s longer"


def changed(analysis, names=None, **fields):
    """Return the result with fields of some axes, all by default, replaced."""
    axes = {
        name: replace(axis, **fields) if names is None or name in names else axis
        for name, axis in analysis.axes.items()
    }
    return replace(analysis, axes=axes)


def clean(analysis):
    """Return the result as if every axis were like gx, without effects and losses."""
    axis = analysis.axes["gx"]
    good = replace(axis, explanation=replace(axis.explanation, effects=()))
    accel = analysis.axes["ax"]
    axes = {name: good if name[0] == "g" else accel for name in analysis.axes}
    return replace(analysis, axes=axes, lost_samples=0, remarks=())


@pytest.fixture(scope="module")
def analysis():
    return demo_analysis(7300.0)


def heads(result):
    known = verdict(result)
    return {line.head: line for line in (*known.lines, *known.details)}


def test_a_good_sensor_is_called_good(analysis):
    known = verdict(clean(analysis))
    assert known.grade == "good"
    assert known.title == "Noise matches the datasheet"
    assert [line.grade for line in known.lines] == ["good", "good", "note"]
    assert [line.head for line in known.lines] == [
        "Noise matches the datasheet",
        "No additional effects",
        "Keep recording",
    ]
    assert not known.details


def test_the_axes_that_miss_the_datasheet_are_named_first(analysis):
    known = verdict(analysis)
    assert known.grade == "bad"
    assert known.title.startswith("Noisier than the datasheet; partly unexplained on az")
    assert known.lines[0].text.startswith(
        "density √2 N of gyroscope gy 4.72 mdps/√Hz (datasheet 3.80); accelerometer az 1"
    )


def test_noise_below_half_a_step_matches_no_datasheet(analysis):
    hidden = DatasheetVerdict(3e-4, 4e-3, "dps/sqrt(Hz)", "hidden by the step", "")
    first = verdict(changed(clean(analysis), datasheet={"density": hidden})).lines[0]
    assert (first.grade, first.head) == ("note", "Noise not compared with a datasheet")
    assert "the noise of the gyroscope is hidden by the step" in first.text


def test_an_effect_is_told_once_for_all_axes_that_have_it(analysis):
    gyro = replace(analysis, axes={k: a for k, a in analysis.axes.items() if k[0] == "g"})
    told = heads(gyro)["Additional effects found"].text
    assert told.startswith("line at 49.98 Hz, 20 mdps, on gx gy; warm-up, ")
    assert verdict(analysis).lines[1].text.count("line at 49.98 Hz") == 1


def test_what_no_effect_explains_is_bad(analysis):
    assert heads(analysis)["Partly unexplained on az"].grade == "bad"
    assert "partly unexplained" in verdict(analysis).title


def test_a_record_that_is_too_short_for_the_loop_says_how_much_longer(analysis):
    short = analysis.axes["gx"].explanation
    short = replace(
        short, effects=(), before=UNKNOWN, after=UNKNOWN, explained=False, remarks=(TOO_SHORT,)
    )
    known = heads(changed(clean(analysis), explanation=short))
    assert known["Effects not searched"].text == TOO_SHORT
    assert "Effects not searched on all axes" not in known  # once is enough
    assert not any(head.startswith("Partly") for head in known)


def test_a_run_that_was_not_looked_at_yet_is_not_called_free_of_effects(analysis):
    known = verdict(changed(clean(analysis), explanation=None))
    assert known.title == "Noise matches the datasheet; effects not searched yet"


def constant(axis):
    """Return an axis all of whose samples are equal."""
    curve = axis.curves["oadev"]
    flat = replace(axis, coefficients={}, datasheet={"density": NOT_KNOWN}, explanation=None)
    return replace(flat, curves={"oadev": replace(curve, deviation=0.0 * curve.deviation)})


def test_a_constant_axis_is_called_constant_and_asks_for_no_longer_recording(analysis):
    good = clean(analysis)
    some = verdict(replace(good, axes={**good.axes, "gy": constant(good.axes["gy"])}))
    assert "gy constant" in some.lines[0].text
    assert some.lines[2].head == "Keep recording"
    assert "too short" not in some.lines[2].text
    none = verdict(replace(good, axes={k: constant(axis) for k, axis in good.axes.items()}))
    assert none.lines[0].text == (
        "the gyroscope is constant: no noise to measure; "
        "the accelerometer is constant: no noise to measure"
    )
    assert (none.lines[2].head, none.lines[2].text) == (
        "Check the sensor",
        "every axis is constant",
    )


def test_the_wait_is_that_of_the_slowest_axis(analysis):
    assert heads(analysis)["Keep recording"].text == (
        "B to ±20 % in about 7 min, K to ±20 % in about 10 h (12 h in all)"
    )
    axis = analysis.axes["gx"]
    later = {**axis.coefficients, "B": replace(axis.coefficients["B"], wait_s=7210.0)}
    slow = heads(changed(analysis, ["gy"], coefficients=later))
    assert slow["Keep recording"].text.startswith("B to ±20 % in about 2 h,")
    done = {k: replace(c, wait_s=None) for k, c in axis.coefficients.items()}
    long = heads(changed(analysis, coefficients=done))
    assert "Keep recording" not in long
    assert long["Recording is long enough"].text.startswith("N, B and K are known")


def test_a_part_without_a_name_is_not_judged(analysis):
    nameless = replace(changed(clean(analysis), datasheet={}), part="")
    known = verdict(nameless)
    assert known.grade == "note"
    assert known.title == "Noise not compared with a datasheet"
    assert "--part" in known.lines[0].text


@pytest.mark.parametrize(("lost", "grade"), [(100, "note"), (1_000_000, "bad")])
def test_losses_count_against_a_run_when_they_are_many(analysis, lost, grade):
    known = verdict(replace(clean(analysis), lost_samples=lost))
    told = {line.head: line.grade for line in known.details}
    assert told.get("Lost samples") == ("note" if grade == "note" else None), "said once"
    assert known.lines[2].head == ("Check the link" if grade == "bad" else "Keep recording")
    assert ("1 000 000 (" in known.lines[2].text) == (grade == "bad")
    assert known.grade == ("bad" if grade == "bad" else "good")


def test_losses_that_leave_nothing_to_fit_ask_for_no_longer_recording(analysis):
    lossy = replace(changed(clean(analysis), coefficients={}), lost_samples=1_000_000_000)
    line = verdict(lossy).lines[2]
    assert line.head == "Check the link"
    assert "recording" not in line.text


def test_why_there_is_no_verdict_against_a_datasheet_is_said(analysis):
    unknown = changed(analysis, datasheet={})
    for part, why in (
        ("", "the part is unknown (--part)"),
        ("LSM6DSM", "full scale"),
        ("LSM9DS1", "LSM9DS1"),
    ):
        told = heads(replace(unknown, part=part))["Noise not compared with a datasheet"]
        assert why in told.text
        assert told.text.count(why) == 1, "both sensors have one reason"


def test_a_remark_that_all_axes_share_is_said_once(analysis):
    known = verdict(changed(clean(analysis), remarks=("saturated",)))
    assert [line.text for line in known.details].count("saturated") == 1


def test_nothing_at_all_is_a_verdict_too(analysis):
    known = verdict(replace(analysis, axes={}, lost_samples=0, remarks=()))
    assert (known.grade, len(known.lines)) == ("note", 3)
