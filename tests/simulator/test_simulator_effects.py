"""Every effect against its definition, on top of silence or of known noise."""

from __future__ import annotations

import math
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from allanscope.errors import UsageError
from allanscope.explain.effects import VOCABULARY
from allanscope.samples import AXES
from allanscope.simulator import (
    AxisTruth,
    EffectSpec,
    Simulator,
    TemperatureTruth,
    Truth,
    effect_help,
    parse_effect,
)
from allanscope.simulator.effects import Conditions, EffectContext, effect_kinds
from allanscope.simulator.noise import stream

RATE = 104.0
FLOOR = AxisTruth(N=0.003)
SILENT = Truth({})


def record(truth, effect, n, *, axis="gx", duration_s=3600.0, gyro_fs=125.0):
    """Return samples of one axis in its unit, at a true rate of exactly 104 Hz."""
    sensor = Simulator(
        rate=RATE, seed=5, truth=truth.with_effects([effect]), clock_error=0.0,
        duration_s=duration_s, gyro_fs=gyro_fs,
    )  # fmt: skip
    column = AXES.index(axis)
    return sensor.read(n).counts[:, column] * sensor.info.scale[column]


def time_s(n):
    return np.arange(n) / RATE


def test_sinusoid_has_its_frequency_and_peak_amplitude():
    n = 104 * 100
    samples = record(SILENT, "sinusoid:frequency=5,amplitude=0.5", n)
    phasor = np.exp(-2j * np.pi * 5.0 * time_s(n)) @ samples * 2.0 / n
    assert abs(phasor) == pytest.approx(0.5, rel=1e-3)
    rest = samples - (phasor * np.exp(2j * np.pi * 5.0 * time_s(n))).real
    assert rest.std() < 4.375e-3 / 2  # rounding only


def test_excursion_comes_back_after_its_duration():
    samples = record(SILENT, "excursion:time=10,duration=5,size=0.5", 104 * 20)
    away = np.abs(samples - 0.5) < 4.375e-3
    assert np.array_equal(away, (time_s(104 * 20) >= 10.0) & (time_s(104 * 20) < 15.0))


def test_a_cycle_goes_from_its_lowest_level_to_its_highest_in_about_its_period():
    n = 104 * 3600
    level = record(SILENT, "cycle:period=120,size=0.5,scatter=0.1", n)
    assert np.ptp(level) == pytest.approx(0.5, abs=2 * 4.375e-3)
    above = level > 0.1
    begins = time_s(n)[1:][above[1:] & ~above[:-1]]
    begins = begins[np.diff(begins, prepend=-10.0) > 5.0]  # rounding may cross a level twice
    assert np.median(np.diff(begins)) == pytest.approx(120.0, rel=0.05)
    assert np.log(np.diff(begins)).std() == pytest.approx(0.1, rel=0.4)


def test_gauss_markov_has_its_sigma_and_correlation_time():
    samples = record(SILENT, "gauss_markov:sigma=0.5,correlation_time=2", 1 << 19)
    gamma = [np.mean(samples[: -lag or None] * samples[lag:]) for lag in (0, 208)]
    assert gamma[0] == pytest.approx(0.25, rel=0.08)  # 5 / sqrt(n t0 / correlation time)
    assert gamma[1] / gamma[0] == pytest.approx(math.exp(-1.0), abs=0.08)


def test_narrowband_is_centred_on_its_frequency_and_as_wide_as_its_bandwidth():
    n = 1 << 19
    samples = record(SILENT, "narrowband:frequency=10,bandwidth=0.5,sigma=0.4", n)
    assert samples.std() == pytest.approx(0.4, rel=0.05)
    power = np.abs(np.fft.rfft(samples)) ** 2
    frequency = np.fft.rfftfreq(n, 1 / RATE)
    inside = power[np.abs(frequency - 10.0) < 0.25].sum() / power.sum()
    assert inside == pytest.approx(0.5, abs=0.04)  # a Lorentzian holds half within its width


def test_a_drifting_line_has_its_rms_amplitude_and_stays_in_its_band():
    n = 1 << 18
    samples = record(SILENT, "drifting_line:frequency=10,bandwidth=0.2,sigma=0.4", n)
    assert samples.std() == pytest.approx(0.4, rel=0.05)
    power = np.abs(np.fft.rfft(samples)) ** 2
    frequency = np.fft.rfftfreq(n, 1 / RATE)
    inside = power[np.abs(frequency - 10.0) < 0.1].sum() / power.sum()
    assert inside == pytest.approx(0.9, abs=0.05)
    assert power.max() < 0.1 * power.sum()  # no one frequency has it all


def test_a_shock_has_its_peak_and_is_over_after_its_duration():
    n = 1 << 14
    samples = record(SILENT, "shock:time=60,duration=2,peak=0.5", n)
    t = time_s(n)
    assert samples.max() == pytest.approx(0.5, rel=0.05)
    assert samples.min() < -0.3  # it swings
    assert not samples[t < 60].any()
    assert np.abs(samples[t > 62]).max() < 0.1 * 0.5


def test_band_limit_takes_three_db_at_its_cutoff_and_spares_what_is_added():
    truth = Truth({"gx": AxisTruth(N=0.05)}).with_effects(["sinusoid:frequency=40,amplitude=3"])
    n = 1 << 18
    samples = record(truth, "band_limit:cutoff=20", n)
    frequency = np.fft.rfftfreq(n, 1 / RATE)
    power = np.abs(np.fft.rfft(samples)) ** 2 / (n * RATE)  # two-sided density
    for centre, share in ((2.0, 1.0), (20.0, 0.5)):
        band = np.abs(frequency - centre) < 1.0
        assert power[band].mean() == pytest.approx(share * 0.05**2, rel=0.06)
    phasor = np.exp(-2j * np.pi * 40.0 * time_s(n)) @ samples * 2.0 / n
    assert abs(phasor) == pytest.approx(3.0, rel=1e-2)


def test_high_pass_takes_three_db_at_its_corner_and_the_level_with_it():
    n = 1 << 18
    samples = record(Truth({"gx": AxisTruth(N=0.05)}), "high_pass:corner=10", n)
    frequency = np.fft.rfftfreq(n, 1 / RATE)
    power = np.abs(np.fft.rfft(samples)) ** 2 / (n * RATE)
    for centre, share in ((0.5, 0.0), (10.0, 0.5), (45.0, 1.0)):
        band = np.abs(frequency - centre) < 0.5
        assert power[band].mean() == pytest.approx(share * 0.05**2, abs=0.06 * 0.05**2)


def test_random_telegraph_has_two_levels_and_its_mean_dwell():
    samples = record(SILENT, "random_telegraph:amplitude=0.5,dwell=2", 1 << 19)
    levels, counts = np.unique(samples, return_counts=True)
    assert levels == pytest.approx([-0.5, 0.5], abs=0.005)
    assert counts.min() / counts.sum() == pytest.approx(0.5, abs=0.05)
    switches = np.count_nonzero(np.diff(samples))
    assert switches / (len(samples) / RATE) == pytest.approx(1 / 2.0, rel=5 / math.sqrt(2500))


def test_step_is_as_high_as_told_and_at_the_sample_told():
    samples = record(SILENT, "step:time=50,size=-0.7", 104 * 100)
    assert np.all(samples[: 104 * 50] == 0.0)
    assert samples[104 * 50 :] == pytest.approx(-0.7, abs=0.003)


def test_warm_up_dies_away_from_its_amplitude():
    samples = record(SILENT, "warm_up:time_constant=20,amplitude=2", 104 * 100)
    assert samples == pytest.approx(2.0 * np.exp(-time_s(10400) / 20.0), abs=0.003)


def test_warm_up_that_starts_later_starts_at_its_amplitude():
    samples = record(SILENT, "warm_up:time_constant=20,amplitude=2,time=10", 104 * 100)
    assert np.all(samples[:1040] == 0.0)
    assert samples[1040] == pytest.approx(2.0, abs=0.003)


def test_temperature_moves_the_axis_by_the_true_temperature():
    warm = TemperatureTruth(start_c=30.0, wander_c=0.0, self_heating_c=10.0, self_heating_s=20.0)
    truth = Truth({}, (parse_effect("temperature:slope=0.1"),), warm)
    sensor = Simulator(rate=RATE, truth=truth, clock_error=0.0)
    block = sensor.read(104 * 60)
    found = block.counts[:, 0] * sensor.info.scale[0]
    held = np.floor(time_s(len(block)) * 52.0) / 52.0  # the register is renewed at 52 Hz
    expected = 5.0 - 10.0 * np.expm1(-held / 20.0)
    assert found == pytest.approx(0.1 * expected, abs=0.003)
    reading = block.ticks.temperature_c - 25.0 - expected
    assert reading.std() == pytest.approx(0.02, rel=0.1)


def test_temperature_is_followed_late_and_in_a_curve():
    warm = TemperatureTruth(start_c=25.0, wander_c=0.0, self_heating_c=10.0, self_heating_s=20.0)
    effect = parse_effect("temperature:slope=0.1,curvature=0.02,lag=5")
    sensor = Simulator(rate=RATE, truth=Truth({}, (effect,), warm), clock_error=0.0)
    found = sensor.read(104 * 60).counts[:, 0] * sensor.info.scale[0]
    t = time_s(len(found))  # of two lags, T = 10 (1 - (20 exp(-t / 20) - 5 exp(-t / 5)) / 15)
    felt = 10.0 - (200.0 * np.exp(-t / 20.0) - 50.0 * np.exp(-t / 5.0)) / 15.0
    assert found == pytest.approx(0.1 * felt + 0.02 * felt**2, abs=0.01)


def test_a_drift_of_the_scale_multiplies_all_noise():
    truth = Truth({"gx": AxisTruth(N=0.05, K=0.01)})
    plain = record(truth, "step:size=0.000001", 5000)
    grown = record(truth, "scale_drift:relative=1", 5000, duration_s=5000 / RATE)
    assert grown == pytest.approx(plain * (1 + np.arange(5000) / 5000), abs=0.01)  # rounding


def test_cross_coupling_adds_a_share_of_the_source_before_any_coupling():
    truth = Truth({"gx": FLOOR, "ax": AxisTruth(offset=1.0, N=1e-4)}).with_effects(
        ["cross_coupling:source=gx,slope=100,axis=ax"]
    )
    alone = record(Truth({"gx": FLOOR}), "step:size=0.000001", 5000)
    samples = record(truth, "cross_coupling:source=ax,slope=0.5,axis=gx", 5000)
    assert (samples - alone).mean() == pytest.approx(0.5, abs=0.003)


def test_couplings_both_ways_see_the_axes_before_any_coupling():
    truth = Truth({"gx": AxisTruth(offset=1.0), "gy": AxisTruth(offset=2.0)}).with_effects(
        ["cross_coupling:source=gy,slope=0.5,axis=gx", "cross_coupling:source=gx,slope=0.5,axis=gy"]
    )
    sensor = Simulator(truth=truth)
    found = sensor.read(1).counts[0, :2] * sensor.info.scale[0]
    assert found == pytest.approx([2.0, 2.5], abs=0.003)


def test_cross_coupling_works_from_an_axis_that_is_not_put_out():
    truth = Truth({"az": AxisTruth(offset=1.0)}).with_effects(
        ["cross_coupling:source=az,slope=0.5"]
    )
    sensor = Simulator(truth=truth, axes=("gx",))
    assert sensor.read(10).counts[:, 0] * sensor.info.scale[0] == pytest.approx(0.5, abs=0.003)


def test_outliers_are_as_many_as_told_within_the_record():
    samples = record(Truth({"gx": FLOOR}), "outliers:count=7", 104 * 600, duration_s=600.0)
    far = np.flatnonzero(np.abs(samples - np.median(samples)) > 10 * 0.003 * math.sqrt(RATE))
    assert len(far) == 7
    assert np.diff(far).min() > 1


def test_outliers_have_the_size_told():
    samples = record(SILENT, "outliers:count=3,size=1", 104 * 60, duration_s=60.0)
    assert sorted(np.abs(samples[samples != 0])) == pytest.approx([1.0] * 3, abs=0.003)


def test_repeated_samples_repeat_whole_rows_as_often_as_told():
    truth = Truth.typical().with_effects(["repeated_samples:fraction=0.1"])
    counts = Simulator(truth=truth).read(50_000).counts
    same = np.all(counts[1:] == counts[:-1], axis=1).mean()
    assert same == pytest.approx(0.1, abs=5 * math.sqrt(0.09 / 50_000))
    clean = Simulator().read(50_000).counts
    assert not np.all(clean[1:] == clean[:-1], axis=1).any()


def test_repeated_samples_of_one_axis_leave_the_others_alone():
    truth = Truth.typical().with_effects(["repeated_samples:fraction=0.5,axis=gy"])
    counts, clean = Simulator(truth=truth).read(5000).counts, Simulator().read(5000).counts
    changed = [axis for i, axis in enumerate(AXES) if np.any(counts[:, i] != clean[:, i])]
    assert changed == ["gy"]


def test_variance_change_raises_the_white_noise_in_some_stretches():
    n = 104 * 400
    effect = "variance_change:intervals=4,ratio=3"
    samples = record(Truth({"gx": FLOOR}), effect, n, duration_s=400.0)
    spread = samples.reshape(-1, 104).std(axis=1) / (0.003 * math.sqrt(RATE))
    loud = spread > 2.0
    assert loud.mean() == pytest.approx(0.25, abs=0.02)
    assert np.count_nonzero(np.diff(loud.astype(int)) == 1) + int(loud[0]) == 4
    assert np.median(spread[loud]) == pytest.approx(3.0, rel=0.05)
    assert np.median(spread[~loud]) == pytest.approx(1.0, rel=0.05)


def test_quantization_leaves_only_multiples_of_its_step():
    samples = record(Truth({"gx": AxisTruth(N=0.05)}), "quantization:step=0.35", 5000)
    steps = samples / 0.35
    assert steps == pytest.approx(np.rint(steps), abs=0.01)
    assert len(np.unique(np.rint(steps))) > 5


@pytest.mark.parametrize("side", [1, -1])
def test_saturation_cuts_off_what_is_beyond_its_level(side):
    effect = f"saturation:level={side * 0.05},side={side}"
    samples = side * record(Truth({"gx": AxisTruth(N=0.005)}), effect, 5000)
    assert samples.max() == pytest.approx(0.05, abs=0.003)
    assert np.mean(samples == samples.max()) == pytest.approx(0.163, abs=0.03)
    assert samples.min() < -0.1


def phases(effects, temperature=None, minutes=10):
    """Return the phase of a line at 20 Hz in cycles, once in 10 s, and the true times."""
    truth = Truth({}, temperature=temperature or TemperatureTruth()).with_effects(effects)
    sensor = Simulator(rate=RATE, truth=truth, axes=("gx",))
    block = sensor.read(int(60 * minutes * RATE))
    hop = int(10 * RATE)
    n = np.arange(len(block))
    rotated = block.counts[:, 0] * np.exp(-2j * np.pi * 20.0 / RATE * n)
    slow = rotated[: len(n) // hop * hop].reshape(-1, hop).sum(axis=1)
    return np.unwrap(np.angle(slow)) / (2 * np.pi), block.ticks.device_s


def test_a_locked_line_keeps_phase_with_the_samples_and_one_from_outside_with_time():
    wander = "clock_error:relative=0,drift=600"
    inside, times = phases([wander, "sinusoid:frequency=20,amplitude=1,locked=1"])
    outside, _ = phases([wander, "sinusoid:frequency=20,amplitude=1"])
    alias, _ = phases([wander, f"sinusoid:frequency={RATE - 20},amplitude=1"])
    # 100 ppm in ten minutes: half of them on the average, so 20 Hz x 600 s x 50e-6 cycles.
    assert np.ptp(inside) < 1e-3
    assert outside[-1] - outside[0] == pytest.approx(-0.6, rel=0.05)
    assert alias[-1] - alias[0] == pytest.approx(0.6 * (RATE - 20) / 20, rel=0.05)
    steps = np.diff(times[:: int(RATE)])
    assert steps[-1] / steps[0] == pytest.approx(1 - 1e-4, abs=1.5e-5)


def test_the_clock_follows_the_temperature():
    warm = TemperatureTruth(wander_c=0.0, self_heating_c=4.0, self_heating_s=60.0)
    effects = ["clock_error:relative=0,per_degc=-50", "sinusoid:frequency=20,amplitude=1"]
    phase, _ = phases(effects, warm)
    # 4 degC more make the rate 200 ppm lower: 4e-3 cycles of 20 Hz in a second.
    assert phase[-1] - phase[-11] == pytest.approx(20.0 * 100.0 * 200e-6, rel=0.02)


def test_clock_error_sets_the_true_rate():
    sensor = Simulator(rate=RATE, truth=SILENT.with_effects(["clock_error:relative=0.03"]))
    assert sensor.clock.true_hz == pytest.approx(RATE * 1.03)
    assert sensor.info.nominal_hz == RATE


def test_effect_acts_from_its_time_on_whatever_the_portions():
    truth = SILENT.with_effects(["gauss_markov:sigma=1,correlation_time=1,time=60"])
    sensor = Simulator(rate=RATE, truth=truth, clock_error=0.0)
    samples = np.concatenate([sensor.read(n).counts[:, 0] for n in (6239, 1, 4000)])
    assert np.all(samples[:6240] == 0)
    assert np.count_nonzero(samples[6240:]) > 3900


GIVEN = {"cutoff": 20.0, "fraction": 0.3, "relative": 0.01, "frequency": 3.0, "count": 500.0}


def numbers_of(kind):
    return {
        name: GIVEN.get(name, 1.0 if limits.default is None else limits.default)
        for name, limits in effect_kinds()[kind].parameters.items()
    }


@pytest.mark.parametrize("kind", sorted(effect_kinds()))
def test_effect_carries_its_state_from_one_stretch_to_the_next(kind):
    n, rows = 5000, effect_kinds()[kind].stage == "rows"
    signal = stream(1, "signal").standard_normal((n, 2) if rows else n)
    t = time_s(n)
    conditions = Conditions(0, t, np.sin(t), {"ay": np.cos(t)})
    results = []
    for cuts in ([], [1, 18, 2500, 2501]):
        context = EffectContext(RATE, 48.0, 0.0, 1.0, 0.01, "ay", stream(2, kind))
        effect = effect_kinds()[kind].set_up(numbers_of(kind), context)
        values = signal.copy()
        for begin, end in pairwise([0, *cuts, n]):
            part = Conditions(
                begin,
                conditions.time_s[begin:end],
                conditions.temperature_c[begin:end],
                {axis: x[begin:end] for axis, x in conditions.axes.items()},
            )
            effect(values[begin:end], part)
        results.append(values)
    assert np.array_equal(*results)
    assert np.array_equal(results[0], signal) == (kind == "clock_error")


@pytest.mark.parametrize("kind", sorted(effect_kinds()))
def test_effect_is_the_same_in_any_portions(kind):
    """The whole chain, effects with carry included, cut at awkward places."""
    parameters = numbers_of(kind)
    source = "ay" if effect_kinds()[kind].takes_source else ""
    axes = ("gx", "ay")
    effect = EffectSpec(kind, parameters, axes, time=7.7 if kind != "clock_error" else 0.0,
                        source=source)  # fmt: skip
    truth = Truth.typical().with_effects([effect])
    whole = Simulator(seed=3, truth=truth).read(10_000)
    sensor = Simulator(seed=3, truth=truth)
    parts = [sensor.read(n) for n in (1, 0, 17, 4095, 4096, 1791)]
    assert np.array_equal(np.concatenate([p.counts for p in parts]), whole.counts)
    assert np.array_equal(np.concatenate([p.ticks.device_s for p in parts]), whole.ticks.device_s)


# --- the words of the command line ------------------------------------------------------------


def test_every_kind_of_the_vocabulary_can_be_simulated():
    assert set(effect_kinds()) >= VOCABULARY - {"unexplained"}
    assert len(effect_help().splitlines()) == len(effect_kinds())


@pytest.mark.parametrize(
    ("text", "axes"),
    [
        ("step:size=1", ("gx",)),
        ("step:size=1,axis=az", ("az",)),
        ("step:size=1,axis=gyro", ("gx", "gy", "gz")),
        ("step:size=1,axis=all", AXES),
        ("repeated_samples:fraction=0.1", AXES),
        ("clock_error:relative=0.1", ()),
    ],
)
def test_axes_of_an_effect(text, axes):
    assert parse_effect(text).axes == axes


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("wobble:size=1", r"unknown effect 'wobble'; choose one of amplitude_coupling, .*warm_up"),
        ("step:height=1", r"no parameter 'height'; it takes size, axis, time"),
        ("step:time=1", r"size is missing; it takes size, axis, time"),
        ("step:size", r"'size' is not of the form name=value"),
        ("step:size=tall", r"size must be a number, got 'tall'"),
        ("step:size=nan", r"size must be a number"),
        ("step:size=1,axis=mx", r"unknown axis 'mx'; axes are gx gy gz ax ay az all gyro accel"),
        ("step:size=1,time=-3", r"time must be at least 0, got -3"),
        ("sinusoid:frequency=0,amplitude=1", r"frequency must be above 0, got 0"),
        ("cross_coupling:slope=1", r"source is missing; it takes source, slope, axis, time"),
        ("cross_coupling:slope=1,source=mx", r"unknown axis 'mx'"),
        ("clock_error:relative=0.1,axis=gx", r"no parameter 'axis'; it takes relative"),
        ("repeated_samples:fraction=1", r"fraction must be above 0 and at most 0.99, got 1"),
    ],
)
def test_wrong_words_are_answered_in_one_line(text, says):
    with pytest.raises(UsageError, match=says) as caught:
        parse_effect(text)
    assert "\n" not in str(caught.value)


def test_reading_the_words_imports_nothing_heavy():
    program = (
        "import sys; from allanscope.simulator import parse_effect, parse_fault;"
        "parse_effect('step:size=1'); parse_fault('reset:at=1');"
        "print(sorted({'scipy', 'serial'} & set(sys.modules)))"
    )
    said = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert said.stdout.strip() == "[]"


def test_a_cutoff_above_half_the_rate_is_refused():
    with pytest.raises(UsageError, match="below half the sample rate"):
        Simulator(rate=26.0, truth=SILENT.with_effects(["band_limit:cutoff=20"]))
