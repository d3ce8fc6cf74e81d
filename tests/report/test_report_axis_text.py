"""Sentences and cells of the report."""

import math
from dataclasses import replace

import pytest

from allanscope.analysis import AxisAnalysis, Level, effect_text
from allanscope.analysis.datasheet import compare
from allanscope.explain import Effect, Parameter
from allanscope.noise import Coefficient
from allanscope.parts import part_named
from allanscope.report import axis_text, coefficient_table


def facts(found):
    return {fact.name: fact.text for fact in found}


def test_a_coefficient_that_is_not_detected_is_a_limit_with_the_time_to_wait(analysis):
    rows = {row.name: row for row in coefficient_table.coefficient_rows(analysis.axes["gx"])}
    assert list(rows) == ["N", "B", "K", "Q", "R"]
    assert rows["K"].value.startswith("< ")
    assert rows["K"].wait == "10 h"
    assert rows["N"].wait == ""
    assert rows["Q"].value.startswith("< ")


def test_a_coefficient_without_an_upper_limit_says_so(analysis):
    open_ended = Coefficient(0.0, 0.0, float("inf"), "", False)
    axis = replace(analysis.axes["gx"], coefficients={"R": open_ended})
    (row,) = coefficient_table.coefficient_rows(axis)
    assert (row.value, row.other) == ("no upper limit", "–")


def test_an_expanded_uncertainty_stands_beside_what_was_detected(analysis):
    known = Coefficient(1e-3, 0.902e-3, 1.098e-3, "", True)
    limit = Coefficient(1e-6, 0.0, 3e-6, "", False)
    axis = replace(analysis.axes["gx"], coefficients={"N": known, "K": limit})
    rows = {row.name: row for row in coefficient_table.coefficient_rows(axis)}
    assert rows["N"].uncertainty == "0.10 mdps/√Hz, 200"
    assert rows["K"].uncertainty == "–"


def test_the_other_unit_is_the_same_quantity(analysis):
    # 1 mdps/sqrt(Hz) is 0.06 deg/sqrt(h); 1 ug/sqrt(Hz) is 9.80665e-6 m/s^2/sqrt(Hz).
    gyro = replace(
        analysis.axes["gx"], coefficients={"N": Coefficient(1e-3, 9e-4, 1.1e-3, "", True)}
    )
    accel = replace(
        analysis.axes["ax"], coefficients={"N": Coefficient(1e-6, 9e-7, 1.1e-6, "", True)}
    )
    assert coefficient_table.coefficient_rows(gyro)[0].other == "0.0600 °/√h"
    assert coefficient_table.coefficient_rows(accel)[0].other == "9.81e-6 m/s²/√Hz"


def test_level_says_how_stable_it_was_or_that_the_run_is_too_short(analysis):
    axis = analysis.axes["gx"]
    assert facts(axis_text.axis_facts(axis))["zero-rate level"] == (
        "310.0 mdps; means over tenths of the run differ by 2.00 mdps (one standard deviation)"
    )
    short = replace(axis, level=Level(0.31, None, "dps"))
    assert "too short" in facts(axis_text.axis_facts(short))["zero-rate level"]


def test_best_averaging_names_samples_time_and_deviation(analysis):
    text = facts(axis_text.axis_facts(analysis.axes["gx"]))["best averaging"]
    best = analysis.axes["gx"].best_averaging
    assert text.startswith(f"{best.samples:,}".replace(",", " ") + " samples (")
    assert "the minimum lies " in text


def test_a_floor_from_which_the_curve_has_not_risen_is_not_called_falling(analysis):
    axis = analysis.axes["gx"]
    best = replace(axis.best_averaging, at_end=True)
    text = facts(axis_text.axis_facts(replace(axis, best_averaging=best)))["best averaging"]
    assert text.endswith("no clear rise beyond it: a longer recording may go lower")


def test_the_datasheet_is_explained_as_print_sets_it():
    white = Coefficient(2.7e-3, 2.6e-3, 2.8e-3, "dps/sqrt(Hz)", True)
    found = compare(part_named("LSM6DSM"), "gx", white, rate_hz=104.0, full_scale=125.0)
    text = facts(axis_text.axis_facts(AxisAnalysis("dps", {}, datasheet=found)))[
        "datasheet: density"
    ]
    assert text.startswith("typical: one-sided density √2 N = 3.82 mdps/√Hz against 3.8 typical")
    assert "ARW √time: 0.162° after one hour" in text


@pytest.mark.parametrize(("segments", "said"), [(1, "per axis, no gaps"), (3, "per axis, 2 gaps")])
def test_the_gaps_of_a_run_are_counted(analysis, segments, said):
    assert said in facts(axis_text.quality(replace(analysis, segments=segments)))["samples"]


def test_the_zero_g_level_is_what_the_length_of_the_mean_tells(analysis):
    level = {"ax": 0.6, "ay": 0.0, "az": 0.81}
    axis = analysis.axes["ax"]
    axes = {name: replace(axis, level=Level(value, None, "g")) for name, value in level.items()}
    away = 1e3 * (math.hypot(*level.values()) - 1)
    assert f"{away:.2f} mg longer than 1 g" in axis_text.zero_g(replace(analysis, axes=axes)).text
    assert axis_text.zero_g(analysis) is None, "one axis cannot tell"


def test_an_error_of_the_clock_is_not_seen_once():
    relative = Parameter(-0.0143, -0.0144, -0.0142)
    clock = Effect("clock_error", {"relative": relative}, evidence={"replicated": "not replicated"})
    assert "once" not in axis_text.effect_words(clock).words


@pytest.mark.parametrize(
    ("replicated", "said"),
    [
        (True, "seen in independent parts of the recording"),
        (False, "not seen in other parts of the recording"),
        ("not replicated", "seen once; confirm with a second recording"),
        ("on gy", "on gy"),
    ],
)
def test_evidence_says_what_convinced(replicated, said):
    effect = Effect(
        "step",
        {"time": Parameter(3000.0, 2999.0, 3001.0, "s")},
        equivalent=("random_telegraph",),
        axes=("gx", "gy"),
        evidence={
            "words": "the level jumps by 0.009 dps",
            "p_value": 3e-20,
            "held_out_design": "interleaved blocks of 1 s",
            "replicated": replicated,
        },
    )
    found = axis_text.effect_words(effect)
    assert found.kind == "step (the same on gx gy)"
    assert found.equivalent == "random telegraph"
    assert found.words == (
        "the level jumps by 0.009 dps; false-alarm probability below 1e-12; "
        f"held-out test: interleaved blocks of 1 s; {said}"
    )


def test_the_error_table_has_every_measure_before_and_after(analysis):
    rows = axis_text.error_rows(analysis.axes["gx"].explanation)
    loop = analysis.axes["gx"].explanation
    assert [row.before for row in rows[:1]] == [f"{loop.before.chi2_per_dof:.2f}"]
    assert len(rows) == 6
    assert "±" in rows[-1].after


def test_quality_tells_rate_losses_link_and_temperature(analysis):
    known = facts(axis_text.quality(analysis))
    assert known["lost samples"] == "1 998"
    assert known["rate"].startswith("6664.2000 Hz ±0.11 ppm; 6660.00 Hz nominal, 0.0631 % off")
    assert "between 24.1 and 31.7 °C" in known["temperature"]
    assert "3 checksum errors" in known["link"]


@pytest.mark.parametrize(("lost", "told"), [(0, "1 min 40 s"), (1_000, "1 min 40 s within 2 min")])
def test_where_much_is_lost_the_time_within_which_it_was_recorded_is_told(analysis, lost, told):
    rate = replace(analysis.rate, nominal_hz=50.0, measured_hz=None)
    record = replace(analysis, rate=rate, duration_s=100.0, lost_samples=lost)
    assert facts(axis_text.quality(record))["duration"] == told


def test_a_rate_within_its_uncertainty_is_not_off_and_a_file_of_arrays_has_no_link(analysis):
    known = replace(analysis.rate, nominal_hz=100.0, measured_hz=100.0 + 1e-12, uncertainty_ppm=1.1)
    found = facts(
        axis_text.quality(
            replace(analysis, rate=known, link=replace(analysis.link, bytes=0, frames=0))
        )
    )
    assert found["rate"] == "100.00000 Hz ±1.1 ppm; 100.000 Hz nominal"
    assert "link" not in found


def test_a_p_value_has_a_floor(analysis):
    loop = analysis.axes["gx"].explanation
    worst = replace(loop, before=replace(loop.before, p_value=5.7e-246))
    rows = {row.name: row for row in axis_text.error_rows(worst)}
    assert rows["p-value of χ²"].before == "below 1e-12"


def test_a_command_that_is_known_replaces_the_plain_one(analysis):
    given = facts(axis_text.provenance(analysis, "allanscope analyse x --rate 104"))
    assert given["to reproduce"] == "allanscope analyse x --rate 104"
    assert "to reproduce" not in facts(axis_text.provenance(analysis, ""))


def test_what_has_no_name_is_told_in_its_own_words_alone():
    """Its parameters are where it was looked for, which no one can read."""
    band = {"frequency_low": Parameter(0.0, unit="Hz"), "share": Parameter(0.0423)}
    said = "lighter tails than a Gaussian (excess kurtosis -0.12)"
    effect = Effect("unexplained", band, evidence={"words": said})
    found = axis_text.effect_words(effect)
    assert (found.kind, found.parameters, found.words) == ("unexplained", "", said)
    assert effect_text(effect) == f"unexplained: {said}"
    assert "share" in axis_text.effect_words(Effect("unexplained", band)).parameters
