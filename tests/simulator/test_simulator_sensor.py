"""The sensor as a whole: coefficients through to the counts, clocks, converter, reproducibility."""

from __future__ import annotations

import math

import numpy as np
import pytest

from allanscope.errors import UsageError
from allanscope.samples import AXES
from allanscope.simulator import AxisTruth, Simulator, TemperatureTruth, Truth
from allanscope.simulator.effects import Run
from allanscope.simulator.signals import Thermometer


def physical(sensor, n, axis):
    column = sensor.info.axes.index(axis)
    return sensor.read(n).counts[:, column] * sensor.info.scale[column]


def test_counts_show_the_sum_of_all_coefficients(avar):
    """AVAR of the int16 counts against the sum of closed forms, rounding included."""
    rate, n = 104.0, 1 << 19
    own = AxisTruth(N=0.02, B=0.005, K=0.003, Q=2e-4)
    sensor = Simulator(rate=rate, seed=2, truth=Truth({"gx": own}), clock_error=0.0)
    samples = physical(sensor, n, "gx")
    rounding = (4.375e-3) ** 2 / 12 / rate
    for m in (16, 64, 256, 1024, 4096):
        tau = m / rate
        closed = (
            (own.N**2 + rounding) / tau
            + 2 * math.log(2) / math.pi * own.B**2
            + own.K**2 * tau / 3
            + 3 * own.Q**2 / tau**2
        )
        tolerance = 5 * math.sqrt(2 * 1.5 * m / n) + 0.005
        assert avar(samples, m) == pytest.approx(closed, rel=tolerance)


def test_ramp_and_offset_are_exact():
    truth = Truth({"gx": AxisTruth(R=0.01, offset=-0.5)})
    samples = physical(Simulator(rate=104.0, truth=truth, clock_error=0.0), 10400, "gx")
    assert samples == pytest.approx(-0.5 + 0.01 * np.arange(10400) / 104.0, abs=0.0025)


def test_noise_is_a_property_of_true_time_not_of_the_nominal_rate():
    """At a true rate 40 % above nominal the white noise of a sample is sqrt(1.4) larger."""
    truth = Truth({"gx": AxisTruth(N=0.05)})
    spread = physical(Simulator(rate=104.0, truth=truth, clock_error=0.4), 100_000, "gx").std()
    assert spread == pytest.approx(0.05 * math.sqrt(104.0 * 1.4), rel=0.015)


def test_converter_saturates_at_int16():
    truth = Truth({"gx": AxisTruth(offset=500.0), "ax": AxisTruth(offset=-9.0)})
    counts = Simulator(truth=truth).read(3).counts
    assert counts[0, 0] == 32767
    assert counts[0, 3] == -32768


@pytest.mark.parametrize(
    ("gyro_fs", "accel_fs", "scales"),
    [(125.0, 2.0, (4.375e-3, 61e-6)), (2000.0, 16.0, (70e-3, 488e-6))],
)
def test_full_scales_set_the_unit_per_count_and_nothing_else(gyro_fs, accel_fs, scales):
    sensor = Simulator(seed=3, gyro_fs=gyro_fs, accel_fs=accel_fs)
    assert sensor.info.scale == pytest.approx((scales[0],) * 3 + (scales[1],) * 3)
    fine = Simulator(seed=3).read(1000)
    coarse = sensor.read(1000)
    same = coarse.counts * sensor.info.scale - fine.counts * Simulator().info.scale
    assert np.abs(same[:, :3]).max() <= (scales[0] + 4.375e-3) / 2 + 1e-12


def test_same_seed_same_samples_and_other_seed_other_samples():
    first, again, other = (Simulator(seed=seed).read(5000) for seed in (4, 4, 5))
    assert np.array_equal(first.counts, again.counts)
    assert np.array_equal(first.ticks.device_s, again.ticks.device_s)
    assert np.array_equal(first.ticks.temperature_c, again.ticks.temperature_c)
    correlation = np.corrcoef(first.counts[:, 0], other.counts[:, 0])[0, 1]
    assert abs(correlation) < 0.1


def test_another_run_is_the_same_specimen_with_other_noise():
    first, second = Simulator(seed=4), Simulator(seed=4, run=1)
    assert first.clock == second.clock
    assert first.truth == second.truth
    assert not np.array_equal(first.read(100).counts, second.read(100).counts)


def test_leaving_axes_out_changes_no_other():
    whole = Simulator(seed=6).read(5000).counts
    part = Simulator(seed=6, axes=("az", "gy"))
    assert part.info.axes == ("gy", "az")  # always in the order of every table
    assert np.array_equal(part.read(5000).counts, whole[:, [1, 5]])


def test_axes_are_independent_of_one_another():
    counts = Simulator(seed=7).read(20_000).counts
    correlation = np.corrcoef(counts.T) - np.eye(len(AXES))
    assert np.abs(correlation).max() < 0.1  # the slow noises have few degrees of freedom


def test_clocks_of_specimens_are_off_by_some_per_cent():
    errors = [Simulator(seed=seed).clock.relative_error for seed in range(40)]
    assert max(np.abs(errors)) <= 0.045
    assert np.std(errors) > 0.015
    assert Simulator(seed=1, clock_error=-0.02).clock.true_hz == pytest.approx(104.0 * 0.98)


def test_device_time_shows_the_true_rate_by_the_crystal():
    sensor = Simulator(rate=104.0, seed=8)
    block = sensor.read(20_000)
    slope = np.polyfit(np.arange(20_000), block.ticks.device_s, 1)[0]
    shown = sensor.clock.true_hz / (1 + 1e-6 * sensor.clock.crystal_ppm)
    assert 1 / slope == pytest.approx(shown, rel=1e-7)
    assert np.all(np.diff(block.ticks.device_s) > 0)
    assert sensor.time_s == pytest.approx(20_000 / sensor.clock.true_hz)


def test_temperature_warms_up_and_wanders():
    rest = TemperatureTruth(start_c=22.0, wander_c=0.5, wander_s=100.0, self_heating_c=0.0)
    readings = Simulator(truth=Truth({}, (), rest), rate=26.0).read(400_000).ticks.temperature_c
    assert readings[0] == pytest.approx(22.0, abs=0.1)
    room = 0.5 * math.sqrt(2 / (26.0 * 100.0))  # how far the room wanders in one sample
    assert np.diff(readings).std() == pytest.approx(math.hypot(0.02 * 2**0.5, room), rel=0.05)
    assert readings[100_000:].std() == pytest.approx(0.5, rel=0.35)


def test_thermometer_does_not_depend_on_the_portions():
    run = Run(seed=1, rate_hz=416.0, duration_s=1.0)
    whole = Thermometer(TemperatureTruth(), run).take(1000)
    thermometer = Thermometer(TemperatureTruth(), run)
    parts = [thermometer.take(n) for n in (1, 6, 1, 2, 490, 500)]
    assert np.array_equal(np.hstack(parts), whole)


def test_thermometer_holds_its_reading_between_renewals():
    readings = Simulator(rate=416.0, clock_error=0.0).read(800).ticks.temperature_c
    held = readings.reshape(100, 8)
    assert np.all(held == held[:, :1])
    assert len(np.unique(held[:, 0])) == 100


@pytest.mark.parametrize(
    "wrong",
    [
        {"part": "LSM9DS1"},
        {"rate": 0.0},
        {"rate": math.nan},
        {"seed": -1},
        {"gyro_fs": 300.0},
        {"accel_fs": 3.0},
        {"axes": ()},
        {"axes": ("mx",)},
    ],
)
def test_what_does_not_exist_is_refused(wrong):
    with pytest.raises(UsageError):
        Simulator(**wrong)
