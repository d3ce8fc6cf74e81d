"""`analyse` on everything that holds samples: the same result whatever it came in."""

import json

import numpy as np
import pytest

from allanscope import (
    Analysis,
    CurveChoices,
    InputError,
    Recording,
    Simulator,
    UsageError,
    analyse,
)
from allanscope.__main__ import main
from allanscope.allan import deviation
from allanscope.allan.estimators import REGISTRY

RATE = 104.0
TONE = 7.3
SCALE = 8.75e-3


@pytest.fixture(scope="module")
def counts():
    """Return a minute of two gyro axes with a line in gx, in whole counts, (n, 2)."""
    rng = np.random.default_rng(11)
    n = int(60 * RATE)
    rows = 30.0 * rng.standard_normal((n, 2)) + [200.0, -40.0]
    rows[:, 0] += 12.0 * np.sin(2 * np.pi * TONE / RATE * np.arange(n))
    return np.rint(rows).astype(np.int16)


@pytest.fixture(scope="module")
def of_counts(counts):
    """Return the result of the counts as they are."""
    return analyse(counts, RATE, axes=["gx", "gy"], gyro_fs=250.0, part="LSM6DSM")


def curves(result):
    return {name: axis["curves"] for name, axis in result.to_dict()["axes"].items()}


def found(result):
    return {name: axis["effects"] for name, axis in result.to_dict()["axes"].items()}


def test_arrays_go_through_the_whole_loop(of_counts):
    assert isinstance(of_counts, Analysis)
    (line,) = of_counts.axes["gx"].explanation.effects
    assert line.kind == "sinusoid"
    assert line.parameters["frequency"].lower < TONE < line.parameters["frequency"].upper
    assert line.parameters["amplitude"].value == pytest.approx(12.0 * SCALE, rel=0.05)
    assert of_counts.axes["gy"].explanation.effects == ()
    assert set(of_counts.axes["gx"].curves) == set(REGISTRY)
    assert of_counts.axes["gx"].datasheet["density"].verdict == "worse"
    json.dumps(of_counts.to_dict(), allow_nan=False)


def test_a_text_file_of_the_same_counts_gives_the_same_result(counts, of_counts, tmp_path):
    path = tmp_path / "log.csv"
    np.savetxt(path, counts, "%d", ",", header="gx[lsb],gy[lsb]", comments="")
    of_file = analyse(str(path), RATE, gyro_fs=250.0, part="LSM6DSM")
    assert curves(of_file) == curves(of_counts)
    assert found(of_file) == found(of_counts)


def test_the_command_says_what_the_function_says(counts, tmp_path):
    path, out = tmp_path / "log.csv", tmp_path / "out.json"
    np.savetxt(path, counts * SCALE, "%.6g", ";", header="gx[dps];gy[dps]", comments="")
    assert main(["analyse", str(path), "--rate", "104", "--json", str(out), "--quiet"]) == 0
    said = json.loads(out.read_text())
    of_floats = analyse(np.loadtxt(path, delimiter=";", skiprows=1), RATE, axes=["gx", "gy"])
    assert said["axes"]["gx"]["curves"] == of_floats.to_dict()["axes"]["gx"]["curves"]
    assert said["axes"]["gx"]["effects"] == of_floats.to_dict()["axes"]["gx"]["effects"]
    assert [e["kind"] for e in said["axes"]["gx"]["effects"]] == ["sinusoid"]


def test_floats_in_dps_and_counts_agree(counts, of_counts):
    of_floats = analyse(counts * SCALE, RATE, axes=["gx", "gy"])
    for name, axis in of_counts.axes.items():
        np.testing.assert_allclose(
            of_floats.axes[name].curves["oadev"].deviation,
            axis.curves["oadev"].deviation,
            rtol=1e-9,
        )
    assert [e.kind for e in of_floats.axes["gx"].explanation.effects] == ["sinusoid"]


def small(n=3000, seed=5):
    return np.random.default_rng(seed).standard_normal(n)


@pytest.mark.parametrize(
    ("arrays", "arguments", "axes"),
    [
        (small(), {}, ["gx"]),
        (small().tolist(), {}, ["gx"]),
        (small()[:, np.newaxis].astype(np.float32), {}, ["gx"]),
        (small(18000).reshape(-1, 6), {}, ["gx", "gy", "gz", "ax", "ay", "az"]),
        (small(6000).reshape(-1, 2), {"axes": ["az", "gy"]}, ["gy", "az"]),
        ({"ax": small(), "temp": np.full(3000, 24.5)}, {}, ["ax"]),
        (np.rec.fromarrays([small(), small()], names="gz,gx"), {}, ["gx", "gz"]),
    ],
)
def test_shapes_and_names(arrays, arguments, axes):
    result = analyse(arrays, 100.0, **arguments)
    assert list(result.axes) == axes
    assert result.samples == 3000
    assert result.axes[axes[0]].unit == ("g" if axes[0].startswith("a") else "dps")


@pytest.mark.parametrize(
    ("columns", "units", "factor"),
    [
        ({"gx[mdps]": 1e3 * small()}, None, 1.0),
        ({"gx": 1e3 * small()}, {"gyro": "mdps"}, 1.0),
        ({"gx": 1e3 * small()}, {"gx": "mdps"}, 1.0),
        ({"gx": np.deg2rad(small())}, "rad/s", 1.0),
        ({"gx[dps]": 1e3 * small()}, {"gx": "mdps"}, 1.0),
        ({"gx": small()}, {"accel": "mg"}, 1.0),
        ({"gx": small()}, None, 1.0),
        ({"gx": small()}, "lsb", 8.75e-3),
    ],
)
def test_units_are_taken_from_the_name_or_from_the_caller(columns, units, factor):
    curve = analyse(columns, 100.0, units=units).axes["gx"].curves["oadev"]
    plain = analyse(small(), 100.0).axes["gx"].curves["oadev"]
    np.testing.assert_allclose(curve.deviation, factor * plain.deviation, rtol=1e-9)


def test_counts_without_a_full_scale_say_which_one_was_taken():
    result = analyse(np.rint(30 * small()).astype(np.int16), 100.0)
    assert result.input["units"] == "gx lsb of 0.00875 dps"


def test_times_tell_the_rate_and_what_is_missing():
    keep = np.r_[0:1000, 1040:3000]
    result = analyse({"t[ms]": keep * 10.0, "gx": small()[keep]})
    assert (result.lost_samples, result.segments, result.samples) == (40, 2, 2960)
    assert result.rate.nominal_hz == 100.0
    assert result.rate.measured_hz == pytest.approx(100.0, rel=1e-6)


def test_a_quarter_of_the_rows_may_be_missing_singly():
    keep = np.random.default_rng(4).random(3000) > 0.24
    keep[[0, -1]] = True
    result = analyse({"t[ms]": np.flatnonzero(keep) * 10.0, "gx": small()[keep]})
    assert result.rate.nominal_hz == 100.0
    assert result.lost_samples == np.count_nonzero(~keep)


def uneven_bursts(rows):
    """Return times of rows 10 ms apart that a host reads 1 to 30 at a time, 2 ms apart."""
    rng = np.random.default_rng(5)
    times, made = [], 0
    while made < rows:
        burst = int(rng.integers(1, 31))
        made += burst
        late = 0.01 * made + rng.uniform(0, 0.01)
        times += [late + 0.002 * k + rng.uniform(0, 2e-4) for k in range(burst)]
    return np.maximum.accumulate(times[:rows]) + 1e-6 * np.arange(rows)


def test_stamps_of_a_busy_host_are_one_series():
    late = np.random.default_rng(8).gamma(1.5, 0.002, 3000)
    times = np.maximum.accumulate(np.arange(3000) / 101.3 + late)
    result = analyse({"t[s]": times, "gx": small()})
    assert (result.lost_samples, result.segments) == (0, 1)
    assert result.rate.nominal_hz == pytest.approx(101.3, rel=0.002)


@pytest.mark.parametrize("rate", [100.0, None])
def test_uneven_bursts_are_one_series(rate):
    result = analyse({"t[s]": uneven_bursts(3000), "gx": small()}, rate)
    assert (result.lost_samples, result.segments) == (0, 1)
    assert result.rate.nominal_hz == pytest.approx(100.0, rel=0 if rate else 0.02)
    assert any("in bursts" in words for words in result.assumptions)


@pytest.mark.parametrize("rate", [100.0, None])
def test_a_long_gap_among_uneven_bursts_stays_one(rate):
    times = uneven_bursts(3000)
    times[1500:] += 5.0
    result = analyse({"t[s]": times, "gx": small()}, rate)
    assert result.segments == 2
    assert result.lost_samples == pytest.approx(500, abs=40)


def test_a_rate_that_is_given_stands_where_the_times_would_lose_most_samples():
    """Four rows 1 ms apart and then none for a while, again and again."""
    steps = np.ones(3000)
    steps[::4] += np.random.default_rng(6).geometric(1 / 22, 750)
    times = 0.00104 * np.cumsum(steps)
    result = analyse({"t[s]": times, "gx": small()}, 929.0)
    assert (result.lost_samples, result.segments) == (0, 1)
    assert result.rate.nominal_hz == 929.0


def test_rows_that_a_busy_host_hands_over_late_are_not_lost():
    times = uneven_bursts(3000)
    waited = (times > 15.0) & (times < 18.0)
    times[waited] = 18.0 + 1e-4 * np.arange(np.count_nonzero(waited))
    times = np.maximum.accumulate(times) + 1e-6 * np.arange(3000)
    result = analyse({"t[s]": times, "gx": small()}, 100.0)
    assert (result.lost_samples, result.segments) == (0, 1)


def test_a_temperature_may_be_missing_for_a_while():
    warmth = np.where(np.arange(3000) % 3, np.nan, 25.0)
    result = analyse({"gx": small(), "T[degC]": warmth}, 100.0)
    assert result.temperature["last"] == 25.0


@pytest.mark.parametrize(
    ("arrays", "arguments", "message"),
    [
        (small(), {}, "the sample rate is not known; give rate"),
        (small(), {"rate": 0.0}, "a sample rate of 0 Hz is not possible"),
        (small(), {"rate": "104"}, "rate must be a number, in Hz, got '104'"),
        (None, {"rate": 1.0}, "give a path, an array, a table .* got NoneType None"),
        (small(8).reshape(2, 4), {"rate": 1.0}, r"shape \(2, 4\) needs axes"),
        (small(6).reshape(2, 3), {"rate": 1.0, "axes": ["gx"]}, "1 axis names do not fit"),
        (small(6).reshape(2, 3), {"rate": 1.0, "axes": ["gx", "gx", "gy"]}, "gx appears twice"),
        (small(8).reshape(2, 2, 2), {"rate": 1.0}, r"not \(2, 2, 2\)"),
        (small(0), {"rate": 1.0}, "contain no samples"),
        ({"gx": [0.0, np.inf]}, {"rate": 1.0}, "sample 1 of gx is inf"),
        (np.ma.masked_greater(small(), 0.1), {"rate": 1.0}, "gx has masked samples"),
        ({"gx": ["a"]}, {"rate": 1.0}, "column gx must hold integers or floats"),
        ({"gx": [1.0], "gy": [1.0, 2.0]}, {"rate": 1.0}, r"columns differ in length: \[1, 2\]"),
        ({"gx": [1.0], "gx[dps]": [1.0]}, {"rate": 1.0}, r"'gx\[dps\]' appears twice"),
        ({"t": [1.0]}, {"rate": 1.0}, "no axis among the columns"),
        ({"speed": [1.0]}, {"rate": 1.0}, "column 'speed' is unknown"),
        ({"gx": [1.0, 2, 3], "t": [0.0, 2, 1]}, {"rate": 1.0}, "times must go up"),
    ],
)
def test_arrays_that_make_no_sense_are_refused_by_name(arrays, arguments, message):
    with pytest.raises(ValueError, match=message):
        analyse(arrays, **arguments)


def test_words_that_do_not_exist_are_usage_errors(tmp_path):
    for arguments in ({"part": "LSM9DS1"}, {"gyro_fs": 300.0}, {"units": {"gx": "furlong"}}):
        with pytest.raises(UsageError):
            analyse(small(), 100.0, **arguments)
    with pytest.raises(InputError, match=r"missing\.csv"):
        analyse(tmp_path / "missing.csv")
    with pytest.raises(ValueError, match="a file names its axes itself"):
        analyse(tmp_path / "missing.csv", axes=["gx"])


def test_a_recording_is_taken_by_path_and_as_a_recording(tmp_path):
    path = tmp_path / "night.mcap"
    assert main(["simulate", str(path), "--hours", "0.002", "--seed", "4", "--quiet"]) == 0
    by_path, by_recording = analyse(path), analyse(Recording(path))
    assert by_path.to_dict() == by_recording.to_dict()
    # The simulated sensor itself, without wire and recording between, says the same.
    sensor = Simulator(rate=104.0, seed=4)
    block = sensor.read(by_path.samples)
    direct = analyse(block.counts, by_path.rate.best_hz, gyro_fs=125.0, accel_fs=2.0)
    np.testing.assert_allclose(
        direct.axes["gz"].curves["oadev"].deviation,
        by_path.axes["gz"].curves["oadev"].deviation,
        rtol=1e-12,
    )


def test_a_full_scale_that_is_given_counts_for_values_in_units():
    noise = 0.0006 * np.random.default_rng(1).normal(size=3000)
    given = {"rate": 104, "part": "LSM6DSM"}
    bare, named = (analyse({"ax[g]": noise}, **given, **more) for more in ({}, {"accel_fs": 2}))
    assert bare.axes["ax"].datasheet == {}
    assert named.input["full_scales"] == "2 g"
    assert named.axes["ax"].datasheet["density"].verdict == "typical"


def test_a_result_and_a_curve_are_one_line_at_the_prompt():
    result = analyse(0.03 * np.random.default_rng(1).normal(size=3000), rate=104)
    assert repr(result) == "<Analysis arrays: gx, 3000 samples>"
    curve = deviation(np.arange(10.0) ** 2, 2.0, taus=[0.5, 1.0])
    assert repr(curve) == "<Deviation oadev: 2 averaging times, 0.5 to 1 s>"


def test_each_column_of_text_has_its_own_unit(tmp_path):
    """All axes of a sensor had that of its last column: a thousand times too large, unsaid."""
    rng = np.random.default_rng(5)
    columns = {
        "gx[mdps]": 40.0,
        "gy[dps]": 0.04,
        "gz[rad/s]": np.radians(0.04),
        "ax[mg]": 1.0,
        "az[g]": 1e-3,
    }
    path = tmp_path / "mixed.csv"
    rows = rng.normal(size=(4000, 5)) * [*columns.values()]
    np.savetxt(path, rows, "%.7f", ",", header=",".join(columns), comments="")
    axes = analyse(path, rate=100.0).axes
    for axis in ("gx", "gy", "gz"):
        assert axes[axis].coefficients["N"].value == pytest.approx(4e-3, rel=0.05)
    for axis in ("ax", "az"):
        assert axes[axis].coefficients["N"].value == pytest.approx(1e-4, rel=0.05)


def test_a_row_of_zeros_beside_gravity_is_a_lost_sample():
    values = 0.01 * np.random.default_rng(5).normal(size=(4000, 6)) + [0, 0, 0, 0, 0, 1]
    values[[700, 701, 2900]] = 0.0
    result = analyse(values, rate=100.0)
    assert "3 rows have zeros only, taken as lost samples" in result.assumptions
    assert result.axes["az"].coefficients["N"].value == pytest.approx(0.01 / 10, rel=0.05)


def test_nan_in_an_array_is_a_lost_sample(tmp_path, capsys):
    """In memory, in a file on the command line, on one axis of several: the curve of an array."""
    noise = np.random.default_rng(5).normal(size=(4000, 3))
    noise[[0, 700, 701, 2900], 1] = np.nan
    lost = noise.copy()
    lost[[0, 700, 701, 2900]] = np.nan
    result = analyse(noise, rate=100.0, curves=CurveChoices(kinds=("oadev",), taus="octave"))
    assert "4 rows have NaN, taken as lost samples" in result.assumptions
    for column, axis in enumerate(("gx", "gy", "gz")):
        found = result.axes[axis].curves["oadev"]
        exact = deviation(lost[1:, column], 100.0, "oadev", [float(t) for t in found.tau])
        # At the longest a curve goes on across the gaps.
        np.testing.assert_array_equal(found.terms[:-1], exact.terms[:-1])
        np.testing.assert_allclose(found.deviation[:-1], exact.deviation[:-1], rtol=1e-8)
        assert found.terms[-1] > exact.terms[-1]
    np.save(tmp_path / "gaps.npy", noise)
    assert main(["analyse", str(tmp_path / "gaps.npy"), "--rate", "100"]) == 0
    assert "Lost samples: 3" in capsys.readouterr().out
    with pytest.raises(ValueError, match="all 20 rows have NaN"):
        analyse(np.full(20, np.nan), rate=100.0)
    with pytest.raises(ValueError, match=r"sample 1 of gx is inf \(one of 1 not finite\)"):
        analyse(np.array([np.nan, np.inf, 1.0]), rate=100.0)
