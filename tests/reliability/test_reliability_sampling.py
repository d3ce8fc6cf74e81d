"""Rows that repeat and samples that are skipped are told as what they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from allanscope.analysis import Analysis, Rate
from allanscope.analysis.remarks import sampling_remarks
from allanscope.parts import PARTS
from allanscope.pipeline import DeviceSettings, analyse_input
from allanscope.samples import AXES, Block, StreamInfo, Ticks
from allanscope.wire import format_named

ROWS = 3600


def polled(path: Path, sensor_hz: float, poll_hz: float, nominal_hz: float) -> Analysis:
    """Return the analysis of a gyroscope that makes samples at one pace and is read at another."""
    samples = np.random.default_rng(8).normal(0.0, 12.0, (ROWS * 3, 3)).round().astype(int)
    times = np.arange(ROWS) / poll_hz
    seen = samples[np.floor(times * sensor_hz + 1e-6).astype(int)]
    rows = [f"{1e3 * t:.0f},{x},{y},{z}" for t, (x, y, z) in zip(times, seen, strict=True)]
    path.write_text("\n".join(["t[ms],gx[lsb],gy[lsb],gz[lsb]", *rows]))
    device = DeviceSettings(part="LSM6DSM", gyro_fs=125.0, rate_hz=nominal_hz)
    return analyse_input(path, device, quiet=True)


def test_a_sensor_that_is_slower_than_its_reader_repeats_rows(tmp_path: Path) -> None:
    """Set to 52 Hz, off by -6.5 %, read 50 times a second: 2.8 % of the rows come twice."""
    analysis = polled(tmp_path / "a.csv", 48.62, 50.0, 52.0)
    expected = 1.0 - 48.62 / 50.0
    for axis in analysis.axes.values():
        assert axis.explanation is not None
        (effect,) = [e for e in axis.explanation.effects if e.kind == "repeated_samples"]
        fraction = effect.parameters["fraction"]
        assert fraction.lower < expected < fraction.upper
    (told,) = [remark for remark in analysis.remarks if "repeat" in remark]
    assert told.startswith("2.8 % of the rows repeat the row before: 50.00 rows arrive per second")
    assert "but the gyroscope made only about 48.6" in told


def test_two_sensors_that_repeat_rows_are_told_apart() -> None:
    def repeated(share: float) -> SimpleNamespace:
        traits = SimpleNamespace(repeats_rows=True)
        effect = SimpleNamespace(
            traits=traits, parameters={"fraction": SimpleNamespace(value=share)}
        )
        return SimpleNamespace(explanation=SimpleNamespace(effects=(effect,)))

    rate = Rate(100.0, measured_hz=100.0, uncertainty_ppm=20.0)
    alike = sampling_remarks({"gx": repeated(0.5), "ax": repeated(0.5)}, rate)
    assert [remark.split("but ")[1] for remark in alike] == [
        "the gyroscope and accelerometer made only about 50.00 samples."
    ]
    apart = sampling_remarks({"gx": repeated(0.5), "ax": repeated(0.75)}, rate)
    assert [remark.split("but ")[1] for remark in apart] == [
        "the gyroscope made only about 50.00 samples.",
        "the accelerometer made only about 25.00 samples.",
    ]


def test_a_sensor_that_is_faster_than_its_reader_is_skipped(tmp_path: Path) -> None:
    """Set to 104 Hz and read 50 times a second: every second sample is never seen."""
    rate = Rate(104.0, measured_hz=50.0, uncertainty_ppm=20.0)
    (told,) = sampling_remarks({}, rate)
    assert "slower than the sensor" in told
    assert "reads one sample in 2.08" in told


def test_a_rate_that_the_user_gave_is_above_times_that_disagree(tmp_path: Path) -> None:
    """Whose rate is right nobody can tell but the user: both are said, first of all."""
    analysis = polled(tmp_path / "a.csv", 104.0, 50.0, 104.0)
    assert analysis.rate.best_hz == 104.0
    assert analysis.rate.measured_hz is None
    (told,) = analysis.assumptions
    assert told.startswith("the times show 50 rows per second, not the given 104 Hz")
    assert not [remark for remark in analysis.remarks if "repeat" in remark]


def test_a_sensor_that_is_little_faster_than_its_reader_is_skipped(tmp_path: Path) -> None:
    """Set to 52 Hz and read 50 times a second: every 26th sample is never seen."""
    analysis = polled(tmp_path / "a.csv", 52.0, 50.0, 52.0)
    (told,) = [remark for remark in analysis.remarks if "rows arrive" in remark]
    assert told.startswith("50.00 rows arrive per second, in step with a timer of 20 ms")
    assert "about 3.8 % of the samples of a sensor set to 52.00 Hz are never sent (skipped)" in told


def test_an_oscillator_that_is_off_as_much_is_none_of_a_timer(tmp_path: Path) -> None:
    analysis = polled(tmp_path / "a.csv", 50.1, 50.1, 52.0)
    assert not [remark for remark in analysis.remarks if "rows arrive" in remark]


def test_stock_firmware_skips_and_says_so(tmp_path: Path) -> None:
    """DataLog says no rate; 50 rows a second are no setting of its sensor."""
    counts = np.random.default_rng(8).normal(0.0, 60.0, (ROWS, 6)).round().astype(np.int16)
    encoder = format_named("datalog").encoder()
    encoder.describe(StreamInfo(AXES, (4.375e-3,) * 3 + (0.061e-3,) * 3, 50.0))
    (tmp_path / "a.txt").write_bytes(encoder.encode(Block(0, counts, Ticks.none())))
    analysis = analyse_input(tmp_path / "a.txt", DeviceSettings(), quiet=True)
    (told,) = [remark for remark in analysis.remarks if "rows arrive" in remark]
    assert "a rate that the sensor does not have" in told


def test_a_pace_is_called_a_timers_only_where_all_is_known() -> None:
    rate = Rate(50.0, measured_hz=49.999, uncertainty_ppm=30.0)
    offered = PARTS["LSM6DSM"].rates_hz
    axes = {"gx": SimpleNamespace(explanation=SimpleNamespace(effects=()))}
    (told,) = sampling_remarks(axes, rate, offered)
    assert "a rate that the sensor does not have" in told
    assert "about 3.8 % of the samples of a sensor set to 52.00 Hz" in told
    assert sampling_remarks(axes, rate) == ()
    assert sampling_remarks(axes, replace(rate, uncertainty_ppm=300.0), offered) == ()
    in_step = Rate(52.0, measured_hz=52.0, uncertainty_ppm=1.0)
    assert sampling_remarks(axes, in_step, offered) == ()
    not_looked = {"gx": SimpleNamespace(explanation=None)}
    assert sampling_remarks(not_looked, rate, offered) == (), "rows may still turn out to repeat"


@pytest.mark.parametrize("sensor_hz", [50.0, 51.7])
def test_a_reader_in_step_is_not_complained_about(tmp_path: Path, sensor_hz: float) -> None:
    analysis = polled(tmp_path / "a.csv", sensor_hz, sensor_hz, 50.0)
    assert not [remark for remark in analysis.remarks if "rows arrive" in remark]
