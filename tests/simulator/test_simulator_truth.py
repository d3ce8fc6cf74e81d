"""Where the truth comes from: a datasheet, a fitted result, a file."""

from __future__ import annotations

import json

import pytest

from allanscope.errors import InputError, UsageError
from allanscope.samples import AXES
from allanscope.simulator import AxisTruth, Simulator, Truth

RESULT = {
    "schema": "allanscope/1",
    "rate": {"nominal_hz": 104.0, "measured_hz": 106.08},
    "axes": {
        "gx": {
            "unit": "dps",
            "level": {"mean": 0.25, "stability": None, "unit": "dps"},
            "coefficients": {
                "N": {"value": 0.0028, "lower": 0.0027, "upper": 0.0029, "detected": True},
                "B": {"value": 0.001, "detected": True},
                "K": {"value": 0.5, "detected": False},
                "Q": {"value": None, "detected": False},
            },
            "effects": [
                {
                    "kind": "sinusoid",
                    "parameters": {
                        "frequency": {"value": 5.0, "unit": "Hz"},
                        "amplitude": {"value": 0.01, "unit": "dps"},
                    },
                    "equivalent": ["narrowband"],
                },
                {"kind": "step", "parameters": {"time": {"value": 60.0}, "size": {"value": 0.1}}},
                {"kind": "unexplained", "parameters": {"share": {"value": 0.1}}},
                {
                    "kind": "repeated_samples",
                    "parameters": {"fraction": {"value": 0.01}},
                    "axes": ["gx", "ax"],
                },
            ],
        },
        "ax": {
            "coefficients": {"N": 6e-5},
            "effects": [
                {
                    "kind": "repeated_samples",
                    "parameters": {"fraction": {"value": 0.01}},
                    "axes": ["gx", "ax"],
                },
                {
                    "kind": "cross_coupling",
                    "parameters": {"source": {"value": "gx"}, "slope": {"value": 0.1}},
                },
            ],
        },
    },
}


def test_typical_sensor_has_the_datasheet_density_over_root_two():
    for part, gyro, accel in (("LSM6DSM", 3.8e-3, 90e-6), ("LSM6DSL", 4e-3, 80e-6)):
        truth = Truth.typical(part)
        densities = [truth.axes[axis].N * 2**0.5 for axis in AXES]
        assert densities == pytest.approx([gyro] * 3 + [accel] * 3)
        assert truth.axes["az"].offset == pytest.approx(1.0, abs=0.041)
        assert not truth.effects
    assert Truth.typical("LSM6DS3H").axes["gy"].N > 0.0


def test_levels_differ_from_specimen_to_specimen_within_the_tolerance():
    levels = [Truth.typical(seed=seed).axes["gx"].offset for seed in range(20)]
    assert len(set(levels)) == 20
    assert all(abs(level) <= 3.0 for level in levels)


def test_a_fitted_result_becomes_a_sensor():
    truth = Truth.from_result(RESULT)
    assert truth.axes["gx"] == AxisTruth(N=0.0028, B=0.001, offset=0.25)  # K was not detected
    assert truth.axes["ax"] == AxisTruth(N=6e-5)
    assert [(e.kind, e.axes) for e in truth.effects] == [
        ("sinusoid", ("gx",)),
        ("step", ("gx",)),
        ("repeated_samples", ("gx", "ax")),  # once, though both axes list it
        ("cross_coupling", ("ax",)),
        ("clock_error", ()),
    ]
    assert truth.effects[1].time == 60.0
    assert truth.effects[3].source == "gx"
    assert truth.clock_error == pytest.approx(0.02)
    Simulator(truth=truth).read(10)


def test_json_and_toml_files_say_the_same(tmp_path):
    (tmp_path / "sensor.json").write_text(
        json.dumps({"axes": {"gx": {"coefficients": {"N": 0.003}, "effects": ["step:size=1"]}}})
    )
    (tmp_path / "sensor.toml").write_text(
        '[axes.gx]\neffects = ["step:size=1"]\n[axes.gx.coefficients]\nN = 0.003\n'
    )
    assert Truth.load(tmp_path / "sensor.json") == Truth.load(tmp_path / "sensor.toml")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("missing.json", None),
        ("broken.json", "{"),
        ("broken.toml", "axes = "),
        ("list.json", "[]"),
        ("empty.json", "{}"),
        ("other.json", '{"axes": {"mx": {}}}'),
        ("binary.json", "\udcff"),
        ("number.json", '{"axes": {"gx": 5}}'),
        ("coefficients.json", '{"axes": {"gx": {"coefficients": [1]}}}'),
        ("effects.json", '{"axes": {"gx": {"effects": [5]}}}'),
        ("level.json", '{"axes": {"gx": {"level": {"mean": "high"}}}}'),
        ("rate.json", '{"axes": {"gx": {}}, "rate": 7}'),
    ],
)
def test_files_that_hold_no_sensor_are_refused_in_one_line(tmp_path, name, content):
    path = tmp_path / name
    if content is not None:
        path.write_text(content, errors="surrogateescape")
    with pytest.raises(InputError, match=r"sensor|no JSON or TOML|no result") as caught:
        Truth.load(path)
    assert "\n" not in str(caught.value)


def test_a_coefficient_that_is_no_number_is_refused():
    with pytest.raises(UsageError, match="N must be a number"):
        Truth.from_result({"axes": {"gx": {"coefficients": {"N": "much"}}}})
    with pytest.raises(UsageError, match=r"N must be at least 0 .*, got -1"):
        AxisTruth(N=-1.0)


def test_an_effect_that_no_simulator_knows_is_refused():
    with pytest.raises(UsageError, match="cannot simulate the effect 'wobble'"):
        Truth.from_result({"axes": {"gx": {"effects": [{"kind": "wobble"}]}}})


def test_last_clock_error_counts():
    truth = Truth({}).with_effects(["clock_error:relative=0.01", "clock_error:relative=0.02"])
    assert truth.clock_error == 0.02
    assert Truth({}).clock_error is None
    assert set(Truth.typical().axes) == set(AXES)
