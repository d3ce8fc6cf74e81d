"""A curve against that of an earlier session, or against a mask over averaging time."""

import json

import numpy as np
import pytest

import allanscope
from allanscope.analysis import ReferenceCurve, read_reference, verdict, with_comparison
from allanscope.analysis.comparison import compare_curve
from allanscope.errors import InputError

RATE = 100.0


def curve(seed, sigma=1.0, n=20_000):
    noise = np.random.default_rng(seed).normal(0.0, sigma, n)
    return allanscope.deviation(noise, RATE, "oadev")


def reference(known):
    kept = known.trusted
    return ReferenceCurve("before", known.tau[kept], known.deviation[kept], known.edf[kept])


def test_equal_sensors_are_seldom_called_higher():
    """1 % an axis is promised; of 400 pairs at most 9 is the 98 % quantile of a binomial."""
    higher = sum(
        not compare_curve(curve(seed, n=5000), reference(curve(1000 + seed, n=5000))).passed
        for seed in range(400)
    )
    assert higher <= 9


def test_a_noisier_sensor_is_called_higher_where_it_is():
    rng = np.random.default_rng(3)
    walk = np.cumsum(rng.normal(0.0, 3e-3, 100_000))
    walking = allanscope.deviation(rng.normal(size=100_000) + walk, RATE, "oadev")
    found = compare_curve(walking, reference(curve(4, n=100_000)))
    assert not found.passed
    assert 0.5 < found.higher[0] < 10.0, "the walk is seen at long times only"
    assert found.higher[1] == found.tau[1]
    assert found.ratio > 3.0
    assert "times higher at τ = " in found.words


def test_a_mask_has_no_error_of_its_own():
    """3 % above is far beyond chance at 20,000 samples against a line, not against a record."""
    louder = curve(5, 1.03)
    mask = ReferenceCurve("mask", np.array([0.01, 1.0]), np.array([1.0, 0.1]))
    assert not compare_curve(louder, mask).passed
    assert compare_curve(curve(5, 0.97), mask).passed
    assert compare_curve(louder, mask).tau[1] <= 1.0 + 1e-9, "nothing is said beyond the mask"


def test_nothing_in_common_is_no_comparison():
    assert compare_curve(curve(1), ReferenceCurve("mask", np.array([1e4]), np.array([1.0]))) is None


def test_a_session_and_a_mask_are_read(tmp_path):
    record = np.random.default_rng(2).normal(0.0, 0.05, (3000, 3))
    analysis = allanscope.analyse(record, rate=RATE)
    session = tmp_path / "first"
    session.mkdir()
    (session / "result.json").write_text(json.dumps(analysis.to_dict()))
    found = read_reference(session)
    assert list(found) == ["gx", "gy", "gz"]
    assert found["gx"].name == "first"
    known = analysis.axes["gy"].curves["oadev"]
    np.testing.assert_allclose(found["gy"].deviation, known.deviation[known.trusted])
    mask = tmp_path / "mask.csv"
    mask.write_text("tau, gyro, gz, ax\n0.01, 0.1, 0.2, \n1, 0.01, 0.02, 1e-3\n")
    found = read_reference(mask)
    assert list(found["gx"].deviation) == [0.1, 0.01]
    assert list(found["gz"].deviation) == [0.2, 0.02], "an axis overrules its sensor"
    assert list(found["ax"].tau) == [1.0]
    assert "ay" not in found


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "columns tau"),
        ("time,gx\n1,2\n", "columns tau"),
        ("tau,gx\n1,2\n0.5,1\n", "ascend"),
        ("tau,gx\n1,-2\n", "positive"),
        ("tau,gx\n1\n", "2 columns"),
        ("tau,gx\n1,two\n", "two"),
        ("tau,gx\n1,\n", "no curve"),
        ("{}", "no curve"),
        ('{"axes": []}', "cannot compare"),
        ('{"axes": {"gx": {"curves": {"oadev": {"tau": [1]}}}}}', "cannot compare"),
        ("{", "cannot compare"),
        ("{" * 100_000, "cannot compare"),
    ],
)
def test_what_is_no_curve_is_refused_in_one_line(tmp_path, text, why):
    file = tmp_path / "mask.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=why) as caught:
        read_reference(file)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="cannot compare"):
        read_reference(tmp_path / "missing")


def compared(**masks):
    """Return the verdict on three axes of 0.05 dps white noise against a mask."""
    record = np.random.default_rng(6).normal(0.0, 0.05, (5000, 3))
    tau = np.array([0.01, 1.0])
    references = {
        axis: ReferenceCurve("mask.csv", factor * tau, height * np.array([0.05, 0.005]))
        for axis, (factor, height) in masks.items()
    }
    return verdict(with_comparison(allanscope.analyse(record, rate=RATE), references))


def test_the_verdict_says_pass_above_what_to_do_next():
    found = compared(gx=(1, 1.2), gy=(1, 1.2), gz=(1, 1.2))
    assert [line.head for line in found.lines][2] == "PASS against mask.csv"
    assert found.lines[2].text == "no axis higher at τ = 0.010 s to 0.90 s"
    assert found.lines[2].grade == "good"
    assert found.lines[3].head == "Keep recording"
    assert "mask.csv" not in found.title


def test_the_verdict_says_fail_and_names_axes_ratio_and_times():
    found = compared(gx=(1, 0.5), gy=(1, 1.2))
    assert found.lines[2].head == "FAIL against mask.csv"
    higher, passed, late = found.lines[2].text.split("; ")
    assert higher.startswith("gx up to 2.")
    assert higher.endswith("at τ = 0.010 s to 0.90 s")
    assert (passed, late) == ("gy not higher", "gz not compared")
    assert found.grade == found.lines[2].grade == "bad"
    assert found.title.endswith("; higher than mask.csv")


def test_axes_that_are_higher_at_the_same_times_share_a_phrase():
    found = compared(gx=(1, 0.5), gy=(1, 0.25), gz=(1, 0.5))
    assert found.lines[2].text.startswith("all axes up to 4.")
    assert ";" not in found.lines[2].text


def test_a_reference_without_common_averaging_times_is_no_pass():
    found = compared(gx=(1e4, 1.0))
    assert (found.lines[2].grade, found.lines[2].head) == ("note", "Not compared with mask.csv")
    assert len(compared().lines) == 3, "nothing is said of a reference that was not named"
