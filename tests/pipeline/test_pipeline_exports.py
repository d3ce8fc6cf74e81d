"""Files for others: keys, units and which convention each follows."""

import json
import os
import re

import numpy as np
import pytest

from allanscope import __version__
from allanscope.__main__ import main
from allanscope.allan import deviation
from allanscope.noise import Coefficient, bound_model
from allanscope.pipeline.exports import LAYOUTS, NotDetected, bound_yaml, coefficients_file
from allanscope.pipeline.import_export import stored_result

RATE = 104.0
DEGREE, G = np.pi / 180, 9.80665


def known(value):
    return Coefficient(value, 0.9 * value, 1.1 * value, "", True)


def limited(upper):
    return Coefficient(0.3 * upper, 0.0, upper, "", False)


AXES = {
    "gx": {"N": known(4e-3), "B": known(1e-3), "K": known(1e-4)},
    "gy": {"N": known(5e-3), "B": known(1e-3), "K": limited(3e-4)},
    "gz": {"N": known(3e-3), "B": limited(1e-3), "K": known(2e-4)},
    "ax": {"N": known(80e-6), "B": known(20e-6), "K": known(5e-6)},
    "ay": {"N": known(90e-6), "B": known(20e-6), "K": known(6e-6)},
    "az": {"N": known(85e-6), "B": known(20e-6), "K": known(7e-6)},
}


def numbers(text):
    """Return the keys and numbers of plain ``key: value`` lines."""
    found = re.findall(r"^(\w+): ([-+.\de]+)(?:\s+#.*)?$", text, re.MULTILINE)
    return {key: float(value) for key, value in found}


def test_kalibr_gets_its_six_keys_in_si_and_continuous_time():
    text = coefficients_file("kalibr", AXES, RATE, source="LSM6DSM", upper_limits="include")
    keys = re.findall(r"^(\w+):", text, re.MULTILINE)
    assert keys == [
        "accelerometer_noise_density",
        "accelerometer_random_walk",
        "gyroscope_noise_density",
        "gyroscope_random_walk",
        "rostopic",
        "update_rate",
    ]
    values = numbers(text)
    assert values["gyroscope_noise_density"] == pytest.approx(5e-3 * DEGREE)
    assert values["accelerometer_noise_density"] == pytest.approx(90e-6 * G)
    assert values["accelerometer_random_walk"] == pytest.approx(7e-6 * G)
    assert values["update_rate"] == RATE
    assert "rostopic: /imu0\n" in text
    assert "Continuous" in text
    assert "LSM6DSM" in text


@pytest.mark.parametrize("layout", sorted(set(LAYOUTS) - {"ros"}))
def test_an_upper_limit_is_never_written_unasked(layout):
    with pytest.raises(NotDetected, match="K on gy"):
        coefficients_file(layout, AXES, RATE)
    for choice in ("include", "zero"):
        assert "Not detected: " in coefficients_file(layout, AXES, RATE, upper_limits=choice)
    with pytest.raises(ValueError, match="choose refuse, include or zero"):
        coefficients_file(layout, AXES, RATE, upper_limits="keep")


def test_a_limit_stands_in_for_a_walk_that_was_not_detected_when_asked_to():
    text = coefficients_file("kalibr", AXES, RATE, upper_limits="include")
    assert numbers(text)["gyroscope_random_walk"] == pytest.approx(3e-4 * DEGREE)
    assert "# Not detected: K on gy; the upper limit is given instead." in text
    text = coefficients_file("kalibr", AXES, RATE, upper_limits="zero")
    assert numbers(text)["gyroscope_random_walk"] == pytest.approx(2e-4 * DEGREE)
    assert "# Not detected: K on gy; 0 is given instead." in text


@pytest.mark.parametrize("choice", ["refuse", "include", "zero"])
def test_a_limit_below_what_another_axis_has_changes_nothing(choice):
    axes = {**AXES, "gy": {**AXES["gy"], "K": limited(1.5e-4)}}
    text = coefficients_file("kalibr", axes, RATE, upper_limits=choice)
    assert numbers(text)["gyroscope_random_walk"] == pytest.approx(2e-4 * DEGREE)
    assert "Not detected" not in text


@pytest.mark.parametrize("layout", LAYOUTS)
def test_white_noise_that_was_not_detected_is_treated_alike(layout):
    axes = {axis: {name: known(1e-4) for name in "NBK"} for axis in AXES}
    axes["az"] = {**axes["az"], "N": limited(2e-4)}
    assert "Not detected" not in coefficients_file(layout, {**axes, "az": axes["ay"]}, RATE)
    with pytest.raises(NotDetected, match="N on az"):
        coefficients_file(layout, axes, RATE)
    assert "N on az" in coefficients_file(layout, axes, RATE, upper_limits="include")


def test_openvins_gets_the_numbers_of_kalibr_in_a_chain_of_one_imu():
    text = coefficients_file("openvins", AXES, RATE, upper_limits="include")
    assert text.startswith("%YAML:1.0\n"), "OpenCV reads the type of the file from its first line"
    assert "\nimu0:\n  T_i_b:\n    - [1.0, 0.0, 0.0, 0.0]\n" in text
    inside = numbers(re.sub("(?m)^  ", "", text))
    for key, value in numbers(
        coefficients_file("kalibr", AXES, RATE, upper_limits="include")
    ).items():
        assert inside[key] == value


def test_orb_slam3_gets_continuous_values_of_the_worst_axis():
    text = coefficients_file("orb-slam3", AXES, RATE, upper_limits="include").replace("IMU.", "")
    assert numbers(text) == pytest.approx(
        {
            "NoiseGyro": 5e-3 * DEGREE,
            "NoiseAcc": 90e-6 * G,
            "GyroWalk": 3e-4 * DEGREE,
            "AccWalk": 7e-6 * G,
            "Frequency": RATE,
        },
        rel=1e-6,
    )


def test_every_axis_by_itself():
    text = coefficients_file("axes", {k: AXES[k] for k in ("gx", "gz")}, RATE, upper_limits="zero")
    first, second = (numbers(part.replace("  ", "")) for part in text.split("gx:")[1].split("gz:"))
    assert first["noise_density"] == pytest.approx(4e-3 * DEGREE)
    assert first["bias_instability"] == pytest.approx(1e-3 * DEGREE)
    assert second["random_walk"] == pytest.approx(2e-4 * DEGREE)
    assert second["bias_instability"] == 0.0
    assert "ax:" not in text
    assert "gy:" not in text


def a_session(folder, **other):
    """Make a session folder whose result is newer than its (empty) recording."""
    fields = ("value", "lower", "upper", "unit", "detected", "wait_s")
    axes = {
        name: {"coefficients": {k: {f: getattr(c, f) for f in fields} for k, c in known.items()}}
        for name, known in AXES.items()
    }
    rate = {"nominal_hz": 104.0, "measured_hz": 105.5}
    result = {"allanscope": __version__, "part": "LSM6DSM", "duration_s": 60.0, "rate": rate}
    (folder / "session.mcap").write_bytes(b"")
    (folder / "result.json").write_text(json.dumps({**result, "axes": axes, **other}))
    os.utime(folder / "session.mcap", (1e9, 1e9))
    os.utime(folder / "result.json", (1e9 + 1, 1e9 + 1))
    return folder


def test_a_result_that_is_up_to_date_is_not_computed_again(tmp_path, capsys):
    out = tmp_path / "imu.yaml"
    arguments = ["export", str(a_session(tmp_path)), str(out), "--upper-limits", "include"]
    assert main([*arguments, "--layout", "orb-slam3"]) == 0
    assert "IMU.Frequency: 105.5" in out.read_text()
    said = capsys.readouterr().out
    assert said.startswith(f"Saved: {out}: N and K of the worst axis for ORB-SLAM3")
    assert f"6 axes, from {tmp_path / 'result.json'}" in said
    assert main([*arguments, "--rate", "104"]) == 3, "other settings need a new analysis"


def test_a_result_that_is_older_than_the_recording_is_not_used(tmp_path):
    folder = a_session(tmp_path)
    assert stored_result(folder).coefficients["gx"]["N"] == AXES["gx"]["N"]
    os.utime(folder / "session.mcap", (1e9 + 2, 1e9 + 2))
    assert stored_result(folder) is None


@pytest.mark.parametrize("other", [{"allanscope": "0.0.1"}, {"axes": None}, {"rate": {}}])
def test_a_result_of_another_version_or_damaged_is_not_used(tmp_path, other):
    assert stored_result(a_session(tmp_path, **other)) is None


def test_vins_gets_discrete_values():
    text = coefficients_file("vins", AXES, RATE, upper_limits="include")
    values = numbers(text)
    assert values["gyr_n"] == pytest.approx(5e-3 * DEGREE * np.sqrt(RATE))
    assert values["acc_w"] == pytest.approx(7e-6 * G * np.sqrt(RATE))
    assert values["g_norm"] == G
    assert "Discrete" in text


def test_ros_gets_the_variance_of_one_sample_on_the_diagonal():
    text = coefficients_file("ros", AXES, RATE)
    rows = dict(re.findall(r"^(\w+): \[(.*)\]", text, re.MULTILINE))
    matrix = np.array([float(v) for v in rows["angular_velocity_covariance"].split(",")])
    expected = np.diag([(n * DEGREE) ** 2 * RATE for n in (4e-3, 5e-3, 3e-3)])
    np.testing.assert_allclose(matrix.reshape(3, 3), expected)
    assert set(rows) == {"angular_velocity_covariance", "linear_acceleration_covariance"}


def test_matlab_gets_double_sided_densities_axis_by_axis():
    text = coefficients_file("matlab", AXES, RATE, upper_limits="zero")
    row = re.search(r"imu\.Gyroscope\.NoiseDensity = \[(.*)\];", text).group(1)
    np.testing.assert_allclose(
        [float(v) for v in row.split()], np.array([4e-3, 5e-3, 3e-3]) * DEGREE
    )
    walk = re.search(r"imu\.Gyroscope\.RandomWalk = \[(.*)\];", text).group(1)
    # What was not detected is not simulated.
    assert float(walk.split()[1]) == 0.0
    assert "double-sided" in text


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_says_what_it_is_and_keeps_a_name_in_its_comment(layout):
    text = coefficients_file(
        layout, AXES, RATE, source="night\nupdate_rate: 1", upper_limits="include"
    )
    assert "ontinuous" in text or "iscrete" in text
    assert "Source: night?update_rate: 1" in text
    assert not re.search("^update_rate: 1$", text, re.MULTILINE)


def test_an_axis_without_coefficients_is_no_axis():
    partly = {**AXES, "gy": {}, "ay": {}}
    assert numbers(coefficients_file("kalibr", partly, RATE, upper_limits="zero"))[
        "gyroscope_noise_density"
    ] == pytest.approx(4e-3 * DEGREE)
    assert "[0.000000e+00" not in coefficients_file("ros", partly, RATE)
    row = re.search(
        r"Gyroscope\.NoiseDensity = \[(.*)\];",
        coefficients_file("matlab", partly, RATE, upper_limits="zero"),
    )
    assert float(row.group(1).split()[1]) == 0.0
    with pytest.raises(ValueError, match="no gyro axis was measured for long enough"):
        coefficients_file("kalibr", {name: {} for name in AXES}, RATE)


def test_a_sensor_that_was_not_measured_is_an_error():
    gyro = {name: found for name, found in AXES.items() if name.startswith("g")}
    with pytest.raises(ValueError, match="no accelerometer axis"):
        coefficients_file("kalibr", gyro, RATE)
    with pytest.raises(ValueError, match="no accelerometer axis"):
        coefficients_file("vins", gyro, RATE)
    assert "linear_acceleration_covariance: [0.0" in coefficients_file("ros", gyro, RATE)


def test_a_bound_lies_above_the_curve_and_covers_what_was_not_seen(tmp_path, capsys):
    rng, hz = np.random.default_rng(6), 10.0
    walk = np.cumsum(rng.standard_normal((40_000, 2)), axis=0) * 2e-3
    noise = rng.standard_normal((40_000, 2)) + walk
    noise[:, 1] *= 1e-3
    log, out = tmp_path / "log.csv", tmp_path / "bound.yaml"
    head = "gx[dps],ax[g]"
    np.savetxt(log, noise, fmt="%.7f", delimiter=",", header=head, comments="")
    assert main(["export", str(log), str(out), "--bound", "--rate", f"{hz:g}"]) == 0
    assert "2 axes" in capsys.readouterr().out
    text = out.read_text()
    assert "Not in this bound, as a record at rest does not show them" in text
    found = [float(x) for x in re.findall(r"noise_density: (\S+)", text)]
    # White noise of unit variance at 10 Hz; the bound is above, by as much as it says at most.
    assert 0.95 < found[0] / (DEGREE / np.sqrt(hz)) < 1.3
    assert 0.95 < found[1] / (1e-3 * G / np.sqrt(hz)) < 1.3
    ends = [float(x) for x in re.findall(r"  to: ([\d.e+]+)", text)]
    assert all(200 < end < 1000 for end in ends)
    assert all(1.0 < float(x) < 1.4 for x in re.findall(r"inflation: ([\d.]+)", text))
    assert main(["export", str(log), str(tmp_path / "x.m"), "--bound", "--rate", "10"]) == 2


def test_a_bound_covers_held_out_records_with_little_inflation():
    """Of 15 sensors; `benchmarks/bound.py` has more."""
    rng, hz, n = np.random.default_rng(3), 1.0, 40_000
    covered, inflation = [], []
    for _ in range(15):
        curves = []
        for _ in range(2):
            walk = np.cumsum(rng.standard_normal(n)) * 5e-3
            noise = rng.standard_normal(n) + walk
            curves.append(deviation(noise, hz, "oadev", 3, noise="RWFM"))
        bound = bound_model(curves[0])
        inside = (curves[1].tau >= bound.shortest_s) & (curves[1].tau <= bound.longest_s)
        assert np.all(bound.variance(curves[0].tau[inside]) >= curves[0].deviation[inside] ** 2)
        below = curves[1].deviation ** 2 <= bound.variance(curves[1].tau)
        covered.append(below[inside].mean())
        inflation.append(bound.inflation)
    assert np.mean(covered) > 0.88
    assert 1.0 < np.mean(inflation) < 1.3


def test_a_bound_has_white_noise_whatever_steps_there_are():
    """A step makes the curve rise from 1 s on: a random walk alone would be above it."""
    rate, n = 104.0, 75_000
    noise = 4e-3 * np.sqrt(rate) * np.random.default_rng(8).standard_normal(n)
    noise[n // 2 :] += 0.1
    bound = bound_model(deviation(noise, rate, "oadev", 4))
    assert 0.8 * 4e-3 < bound.N < 1.5 * 4e-3


def test_a_run_of_seconds_gives_no_bound():
    curve = deviation(np.random.default_rng(1).standard_normal(100), 10.0, "oadev")
    assert bound_model(curve) is None
    with pytest.raises(ValueError, match="long enough"):
        bound_yaml({"gx": curve})
