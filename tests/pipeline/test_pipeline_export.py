"""Coefficients leave for Kalibr, ROS, VINS and MATLAB by one command."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from allanscope.__main__ import main

RATE, SIGMA = 100.0, 0.02
DEGREE = np.pi / 180


def write_log(path, names):
    """Write white noise in dps and g."""
    noise = SIGMA * np.random.default_rng(4).standard_normal((1500, len(names)))
    units = ["dps" if name.startswith("g") else "g" for name in names]
    header = ",".join(f"{name}[{unit}]" for name, unit in zip(names, units, strict=True))
    np.savetxt(path, noise, fmt="%.7f", delimiter=",", header=header, comments="")
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "log.csv"
    return write_log(path, ("gx", "ax"))


def export(*arguments):
    return main(["export", *map(str, arguments), "--rate", f"{RATE:g}", "--quiet"])


@pytest.mark.parametrize(
    ("name", "layout", "key", "times"),
    [
        ("imu.yaml", [], "gyroscope_noise_density: ", DEGREE / np.sqrt(RATE)),
        ("vins.yaml", ["--layout", "vins"], "gyr_n: ", DEGREE),
        ("imu.m", [], "imu.Gyroscope.NoiseDensity = [", DEGREE / np.sqrt(RATE)),
    ],
)
def test_white_noise_arrives_in_the_units_of_each(log, tmp_path, name, layout, key, times):
    assert export(log, tmp_path / name, *layout, "--upper-limits", "zero") == 0
    text = (tmp_path / name).read_text()
    number = float(text.partition(key)[2].split()[0])
    assert number == pytest.approx(SIGMA * times, rel=0.1)
    assert "log.csv" in text


def test_ros_is_given_the_variance_of_a_sample(log, tmp_path):
    assert export(log, tmp_path / "ros.yaml", "--layout", "ros") == 0
    text = (tmp_path / "ros.yaml").read_text()
    first = float(text.partition("angular_velocity_covariance: [")[2].partition(",")[0])
    assert first == pytest.approx((SIGMA * DEGREE) ** 2, rel=0.2)


@pytest.mark.parametrize("name", ["imu.yaml", "vins.yaml", "imu.m"])
def test_an_upper_limit_is_written_only_when_asked_for(log, tmp_path, capsys, name):
    """Fifteen seconds of white noise have no K: its limit is no estimate of it."""
    out, layout = tmp_path / name, ["--layout", "vins"] if name.startswith("vins") else []
    assert export(log, out, *layout) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "K on gx ax" in said
    assert "--upper-limits include" in said
    assert not out.exists()
    written = {}
    for choice in ("include", "zero"):
        assert export(log, out, *layout, "--upper-limits", choice) == 0
        written[choice] = out.read_text()
        assert "Not detected: " in written[choice]
    key = {"imu.yaml": "gyroscope_random_walk: ", "vins.yaml": "gyr_w: "}.get(
        name, "imu.Gyroscope.RandomWalk = ["
    )
    limit, zero = (float(t.partition(key)[2].split()[0]) for t in written.values())
    assert limit > 0.0
    assert zero == 0.0


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("log-copy.csv", ["--layout", "vins"]),
        ("log-copy.parquet", ["--layout", "kalibr"]),
        ("imu.m", ["--layout", "kalibr"]),
        ("bound.yaml", ["--bound", "--layout", "kalibr"]),
        ("log-copy.csv", ["--upper-limits", "refuse"]),
        ("bound.yaml", ["--bound", "--upper-limits", "zero"]),
    ],
)
def test_a_choice_that_would_change_nothing_is_refused(log, tmp_path, capsys, name, options):
    assert export(log, tmp_path / name, *options) == 2
    said = capsys.readouterr().err
    assert options[-2] in said
    assert said.count("\n") == 1
    assert not (tmp_path / name).exists()


def test_a_place_that_cannot_be_written_to_is_refused_before_the_work(tmp_path, capsys):
    assert export("nothing.mcap", tmp_path / "no" / "imu.yaml") == 2
    assert "cannot write" in capsys.readouterr().err


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_samples_leave_at_the_measured_rate(tmp_path, ending):
    night, table = tmp_path / "night.mcap", tmp_path / f"night.{ending}"
    fast = ["--hours", "0.02", "--effect", "clock_error:relative=0.04"]
    assert main(["simulate", str(night), "--quiet", *fast]) == 0
    assert main(["export", str(night), str(table), "--quiet"]) == 0
    if ending == "csv":
        times = np.loadtxt(table, delimiter=",", skiprows=1, usecols=0)
    else:
        read = pq.read_table(table)
        times = read["t[s]"].to_numpy()
        facts = json.loads(read.schema.metadata[b"allanscope"])
        assert facts["measured"]
        assert facts["rate_hz"] == pytest.approx(1.04 * 104.0, rel=1e-3)
    assert 1.0 / np.diff(times).mean() == pytest.approx(1.04 * 104.0, rel=1e-3)


def test_a_recording_without_samples_makes_no_table(tmp_path, capsys):
    night, table = tmp_path / "night.mcap", tmp_path / "night.csv"
    assert main(["simulate", str(night), "--quiet", "--hours", "1e-7"]) == 0
    assert main(["export", str(night), str(table), "--quiet"]) == 3
    assert "contains no samples" in capsys.readouterr().err
    assert not table.exists()


def test_a_missing_sensor_is_one_line(tmp_path, capsys):
    log = write_log(tmp_path / "gyro.csv", ("gx",))
    assert export(log, tmp_path / "imu.yaml") == 3
    assert "no accelerometer axis was measured" in capsys.readouterr().err
    assert not (tmp_path / "imu.yaml").exists()


def test_an_unknown_ending_is_one_line(log, tmp_path, capsys):
    assert export(log, tmp_path / "imu.txt") == 2
    assert ".yaml or .m" in capsys.readouterr().err
