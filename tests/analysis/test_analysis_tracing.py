"""Where lines come from, and their direction: right where the record can tell, silent elsewhere."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest

from allanscope.analysis import Analyser, AnalyserSettings, cause_phrase, summarise, verdict
from allanscope.analysis.direction import motion_of_burst, motion_of_line, motion_of_step
from allanscope.analysis.line_families import fold
from allanscope.analysis.line_origin import clock_wander_of, origin_of, reduced
from allanscope.analysis.shared_lines import RecordedLines, lines_in_both
from allanscope.clock import Clock
from allanscope.samples import Gap, Ticks
from allanscope.simulator import AxisTruth, Simulator, Truth
from allanscope.wire import LinkStats
from support.measured import MEASURED

RATE = 104.0
AXES = ("gx", "gy", "gz", "ax", "ay", "az")


def simulator(true_hz, seed, *, ppm=30.0, minutes=10.0, locked=False, dps=0.02):
    """Return a gyro axis with one line; its clock drifts by `ppm` in the course of the record."""
    truth = Truth({"gx": AxisTruth(N=2.7e-3, B=1e-3, K=1e-4)}).with_effects(
        [
            f"clock_error:relative=0,drift={60 * ppm / minutes}",
            f"sinusoid:frequency={true_hz},amplitude={dps},locked={int(locked)}",
        ]
    )
    return Simulator(rate=RATE, seed=seed, truth=truth, axes=("gx",))


def traced(true_hz, seed, *, minutes=10.0, has_clock=True, **wanted):
    """Return the origin of a line that is known as well as a search knows it."""
    sensor = simulator(true_hz, seed, minutes=minutes, **wanted)
    block = sensor.read(int(60 * minutes * RATE))
    clock = Clock.of(sensor.info)
    clock.update(0, block.ticks)
    rate = clock.rate()
    values = block.counts.astype(float)
    power = np.abs(np.fft.rfft(values[:, 0] - values.mean(), 4 * len(values))) ** 2
    frequency = np.fft.rfftfreq(4 * len(values), 1 / rate.hz)
    seen = frequency[frequency > 1][np.argmax(power[frequency > 1])]
    half = 0.2 / (60 * minutes)
    wander = clock_wander_of(clock.arrivals()) if has_clock else None
    numbers = np.arange(len(values), dtype=float)
    return origin_of(
        values, numbers, rate.hz, (seen, seen - half, seen + half), wander,
        rate_ppm=rate.uncertainty_ppm,
    )  # fmt: skip


def cases(kind, count=8):
    rng = np.random.default_rng({"internal": 1, "direct": 2, "alias": 3}[kind])
    for seed in range(count):
        f = rng.uniform(8.0, 44.0)
        alias = rng.integers(1, 6) * RATE + rng.choice([-1, 1]) * f
        yield seed, alias if kind == "alias" else f


@pytest.mark.parametrize("kind", ["internal", "direct", "alias"])
def test_the_source_of_a_line_is_told_by_a_clock_that_changes_by_30_ppm(kind):
    wanted = "internal" if kind == "internal" else "external"
    told = right = 0
    for seed, true_hz in cases(kind):
        found = traced(true_hz, seed, locked=kind == "internal")
        # Never wrong; a record that does not tell says so.
        assert found.source in (wanted, "unknown"), (true_hz, found)
        told += found.source == wanted
        if found.frequency_hz is not None and kind != "internal":
            # Two intervals: of 16 some miss. By the crystal of the device, the clock that there is.
            by_crystal = true_hz * (1 - 1e-6 * simulator(true_hz, seed).clock.crystal_ppm)
            width = found.upper_hz - found.lower_hz
            assert found.frequency_hz == pytest.approx(by_crystal, abs=width)
            right += 1
    assert told >= 7
    assert kind == "internal" or right >= 7


def test_a_line_is_not_traced_by_a_clock_that_is_not_known_or_steady():
    unknown = traced(150.0, 1, ppm=0.0, has_clock=False)
    steady = traced(150.0, 1, ppm=0.0)
    for found in (unknown, steady):
        assert found.source == "unknown"
        assert found.frequency_hz is None
        assert any(one == pytest.approx(150.0, abs=0.1) for one in found.candidates_hz)
        assert "not determined" in found.words


def test_without_a_clock_a_line_that_leaves_the_samples_is_known_not_to_be_of_their_clock():
    found = traced(150.0, 1, ppm=100.0, has_clock=False)
    assert found.source == "free-running"
    assert found.frequency_hz is None


def test_mains_is_named_only_where_it_agrees_and_with_its_chance():
    found = traced(150.0, 4)
    assert [one.name for one in found.known] == ["mains 50 Hz x 3"]
    assert found.known[0].folded_hz == pytest.approx(fold(150.0, 104.0), abs=0.01)
    assert 0.01 < found.known[0].by_chance < 0.5
    assert traced(147.0, 4).known == ()


def measured(name, axes):
    table = pq.read_table(MEASURED / f"{name}.parquet")
    column = {c.split("[")[0]: c for c in table.column_names}
    return np.column_stack([table[column[a]].to_numpy().astype(float) for a in axes])


@pytest.mark.parametrize(
    ("name", "axes", "rate_hz", "line", "source"),
    [
        ("ism330dhcx-fan-on", ("gx", "gy"), 104.476, (31.18, 31.14, 31.22, 0.3), "free-running"),
        ("ism330dhcx-fan-on", ("gx", "gy"), 104.476, (32.68, 32.65, 32.71, 0.2), "free-running"),
        ("ism330dhcx-fan-on", ("ax", "ay", "az"), 104.476, (39.1, 39.0, 39.2, 0.4), "free-running"),
        ("ism330dhcx-fan-on", ("az",), 104.476, (12.4306, 12.429, 12.4323, 0.0), "unknown"),
        ("st-gyro-warmup", ("gx",), 100.0, (5.0266, 5.0247, 5.0285, 0.027), "free-running"),
        ("st-gyro-warmup", ("gx",), 100.0, (3.5118, 3.5108, 3.5127, 0.0067), "unknown"),
    ],
)
def test_fans_do_not_keep_phase_with_the_samples(name, axes, rate_hz, line, source):
    values = measured(name, axes)
    found = origin_of(
        values, np.arange(len(values), dtype=float), rate_hz, line[:3], width_hz=line[3]
    )
    assert found.source == source
    assert found.frequency_hz is None


def motion(gyro, accel, seed=0, hz=20.0, rows=12_000):
    """Return the motion of a line of complex amplitudes in dps and g, beside gravity along z."""
    rng = np.random.default_rng(seed)
    numbers = np.arange(rows, dtype=float)
    wave = np.exp(2j * np.pi * hz / RATE * numbers)
    size = np.concatenate([gyro, accel]).astype(complex)
    noise = rng.normal(size=(rows, 6)) * np.array([0.03] * 3 + [1e-3] * 3)
    values = (wave[:, None] * size).real + noise + np.array([0, 0, 0, 0, 0, 1.0])
    sums = reduced(values, numbers, RATE, hz, 0.0, None)
    return motion_of_line(sums, AXES, rows, values.mean(axis=0), hz)


def test_a_line_on_three_axes_is_one_vector():
    along = np.array([0.6, 0.0, -0.8])
    found = motion(0.05 * along * np.exp(0.7j), np.zeros(3))
    (gyro,) = found.directions
    angle = np.degrees(np.arccos(min(1.0, abs(np.dot(gyro.vector, along)))))
    assert angle < 4 * gyro.error_deg < 8
    assert gyro.lower < 0.05 < gyro.upper
    assert gyro.roundness < 0.1


def test_errors_of_the_direction_are_those_of_repetitions():
    along = np.array([0.6, 0.0, -0.8])
    found = [motion(0.01 * along, np.zeros(3), seed).directions[0] for seed in range(40)]
    off = [np.degrees(np.arccos(min(1.0, abs(np.dot(one.vector, along))))) for one in found]
    stated = np.mean([one.error_deg for one in found])
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(stated, rel=0.3)


def test_rotation_is_told_from_translation():
    pace = 2 * np.pi * 20.0
    turn = np.radians(0.2)
    arm = 0.03 * turn * pace / 9.80665
    assert motion([0.2, 0, 0], [0, 0, arm]).kind == "rotation"
    assert motion([0.2, 0, 0], [0, 0, arm]).arm_m == pytest.approx(0.03, rel=0.2)
    assert motion([0.2, 0, 0], [0, 0, 100 * arm]).kind == "translation"
    assert motion([0, 0, 0], [0.02, 0, 0]).kind == "translation"
    assert motion([0.2, 0, 0], [0.3 * arm / 0.03, 0, 0]).kind == "both"
    assert motion([0, 0, 0], [0, 0, 0]) is None


def test_a_circle_is_round():
    assert motion([0.1, 0.1j, 0], [0, 0, 0]).directions[0].roundness > 0.8


def test_a_step_is_one_signed_vector():
    rng = np.random.default_rng(3)
    times = np.arange(12_000) / RATE
    size = np.array([0.02, -0.01, 0.0])
    values = rng.normal(size=(len(times), 3)) * 0.03 + size * (times > 60.0)[:, None]
    (found,) = motion_of_step(values, times, AXES[:3], 60.0).directions
    assert found.amplitude == pytest.approx(np.linalg.norm(size), abs=4 * 0.03 / np.sqrt(260))
    assert np.degrees(np.arccos(np.dot(found.vector, size / np.linalg.norm(size)))) < 30
    assert motion_of_step(values, times, AXES[:3], 30.0) is None


def burst_rows(gyro, accel, seed=0, hz=15.0, grows=1.0):
    """Return rows and times of a knock of 2 s that rings, in dps and g rms, beside gravity."""
    rng = np.random.default_rng(seed)
    times = np.arange(6_000) / RATE
    inside = (times > 30.0) & (times < 32.0)
    rings = np.sin(2 * np.pi * hz * times) * np.exp(-(times - 30.0)) * inside
    wave = rings / np.sqrt(np.mean(rings[inside] ** 2))
    noise = rng.normal(size=(len(times), 6)) * np.array([0.03] * 3 + [1e-3] * 3)
    noise *= 1.0 + (grows - 1.0) * inside[:, None]
    return noise + np.outer(wave, [*gyro, *accel]) + np.array([0, 0, 0, 0, 0, 1.0]), times


def burst(*arguments, **named):
    """Return the motion of such a knock."""
    return motion_of_burst(*burst_rows(*arguments, **named), AXES, 30.0, 32.0)


def test_a_burst_is_one_vector_with_its_size():
    along = np.array([0.6, 0.0, -0.8])
    found = burst(2.0 * along, np.zeros(3))
    (gyro,) = found.directions
    assert abs(np.dot(gyro.vector, along)) > np.cos(np.radians(4 * gyro.error_deg))
    assert gyro.error_deg < 2.0
    assert gyro.lower < 2.0 < gyro.upper
    assert gyro.roundness < 0.1


def test_errors_of_the_direction_of_a_burst_are_those_of_repetitions():
    along = np.array([0.6, 0.0, -0.8])
    found = [burst(0.2 * along, np.zeros(3), seed).directions[0] for seed in range(40)]
    off = [np.degrees(np.arccos(min(1.0, abs(np.dot(one.vector, along))))) for one in found]
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(
        np.mean([one.error_deg for one in found]), rel=0.3
    )


def test_a_burst_on_axes_that_are_rounded_to_one_value_beside_it_has_a_direction():
    along = np.array([0.6, 0.0, -0.8])
    values, times = burst_rows(2.0 * along, np.zeros(3))
    rounded = np.column_stack([np.round(values[:, :3] * 4) / 4, values[:, 3:]])
    assert np.ptp(rounded[times < 29.0, :3]) == 0.0
    (gyro,) = motion_of_burst(rounded, times, AXES, 30.0, 32.0).directions
    assert abs(np.dot(gyro.vector, along)) > np.cos(np.radians(3.0))
    assert gyro.lower < 2.0 < gyro.upper


def test_noise_that_grows_on_each_axis_by_itself_has_no_direction():
    assert all(burst(np.zeros(3), np.zeros(3), seed, grows=3.0) is None for seed in range(20))
    assert burst(np.zeros(3), np.zeros(3)) is None


def test_a_burst_of_rotation_is_told_from_one_of_translation():
    arm = 0.03 * np.radians(2.0) * 2 * np.pi * 15.0 / 9.80665
    turned = burst([2.0, 0, 0], [0, 0, arm])
    assert turned.kind == "rotation"
    assert turned.arm_m == pytest.approx(0.03, rel=0.3)
    assert burst([2.0, 0, 0], [0, 0, 100 * arm]).kind == "translation"
    assert burst([0, 0, 0], [0.2, 0, 0]).kind == "translation"


def test_the_result_says_that_a_line_is_an_alias():
    sensor = simulator(150.0, 3, ppm=60.0, minutes=4.0)
    analyser = Analyser(AnalyserSettings())
    analyser.feed(sensor.info)
    analyser.feed(sensor.read(int(240 * RATE)))
    result = summarise(analyser, LinkStats(), "full", {})
    (line,) = [one for one in result.findings if one.origin is not None]
    assert line.origin.source == "external"
    assert line.origin.frequency_hz == pytest.approx(150.0, abs=0.02)
    assert cause_phrase(line).startswith("external, alias of 150")
    assert "on gx, alias of 150" in verdict(result).lines[1].text
    (told,) = [one for one in result.to_dict()["findings"] if one["origin"]]
    assert told["origin"]["frequency_hz"] == line.origin.frequency_hz
    assert told["motion"] is None


def test_a_simulated_comb_ends_as_one_finding_with_its_fundamental():
    """Orders 1, 2, 3, 5 and 8 of 7.3 Hz; the last is beyond Nyquist and seen folded at 45.6 Hz."""
    orders = (1, 2, 3, 5, 8)
    lines = [f"sinusoid:frequency={7.3 * k},amplitude={0.01 / k**0.5}" for k in orders]
    truth = Truth({"gx": AxisTruth(N=2.7e-3, B=1e-3, K=1e-4)}).with_effects(
        ["clock_error:relative=0", *lines]
    )
    sensor = Simulator(rate=RATE, seed=1, truth=truth, axes=("gx",))
    analyser = Analyser(AnalyserSettings())
    analyser.feed(sensor.info)
    analyser.feed(sensor.read(int(180 * RATE)))
    result = summarise(analyser, LinkStats(), "full", {})
    (comb,) = result.findings
    assert comb.kind == "sinusoid"
    assert comb.members[0].effect.parameters["frequency"].value == pytest.approx(7.3, abs=1e-3)
    assert (comb.harmonics, comb.folded) == ((2, 3, 5, 8), (8,))
    assert "with harmonics 2, 3, 5 and 8 (8 folded)" in verdict(result).lines[1].text


def test_where_the_record_cannot_tell_it_says_what_would():
    found = traced(150.0, 1, ppm=0.0)
    told = found.experiment
    assert told.duration_s >= 600
    assert told.gain_nats >= 10
    assert "if locked to the sensor's clock" in told.expectation
    assert traced(150.0, 4).experiment is None


def test_another_rate_settles_what_the_advice_says_it_does():
    found = traced(150.0, 1, ppm=0.0)
    rate = found.experiment.rate_hz
    sensor = simulator(150.0, 1, ppm=0.0).reconfigured(rate=rate)
    values = sensor.read(int(120 * rate)).counts[:, 0].astype(float)
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    hz = np.fft.rfftfreq(len(values), 1 / sensor.clock.true_hz)
    seen = hz[np.argmax(np.where(hz > 1, power, 0))]
    assert seen == pytest.approx(fold(150.0, sensor.clock.true_hz), abs=0.02)


def test_the_true_amplitude_is_that_before_the_low_pass():
    sensor = simulator(150.0, 4)
    block = sensor.read(int(600 * RATE))
    clock = Clock.of(sensor.info)
    clock.update(0, block.ticks)
    seen = fold(150.0, clock.rate().hz)
    found = origin_of(
        block.counts.astype(float), np.arange(len(block), dtype=float), clock.rate().hz,
        (seen, seen - 3e-4, seen + 3e-4), clock_wander_of(clock.arrivals()),
        cutoff_hz=33.0, amplitude=(0.019, 0.021, "dps"),
    )  # fmt: skip
    low, high = found.amplitude
    # |H| = 1 / sqrt(1 + (f / fc)^2) of one pole, and with the fourth power of two (Butterworth).
    ratio = 150.0 / 33.0
    assert low == pytest.approx(0.019 * np.sqrt(1 + ratio**2), rel=1e-3)
    assert high == pytest.approx(0.021 * np.sqrt(1 + ratio**4), rel=1e-3)
    assert "true amplitude 88 to 430 mdps" in found.words
    assert found.brief.startswith("alias of 150")


@pytest.mark.parametrize(
    ("true_hz", "locked", "source"), [(150.0, 0, "external"), (31.0, 1, "internal")]
)
def test_gaps_of_unknown_length_leave_the_phase_of_each_piece(true_hz, locked, source):
    sensor = simulator(true_hz, 2, ppm=100.0, minutes=20.0, locked=bool(locked))
    block = sensor.read(int(1200 * RATE))
    gone = np.zeros(len(block), bool)
    gone[40_000:40_117] = gone[80_000:80_031] = True
    rows = np.flatnonzero(~gone)
    pieces = np.searchsorted([40_000, 80_000], rows, side="right")
    clock = Clock.of(sensor.info)
    for piece in range(3):
        part = rows[pieces == piece]
        ticks = replace_rows(block.ticks, part)
        clock.update(int(np.flatnonzero(pieces == piece)[0]), ticks)
        clock.gap(Gap("restarted", None))
    numbers, times, segments = clock.arrivals()
    assert len(np.unique(segments)) == 3
    wander = clock_wander_of((numbers, times, segments))
    assert wander.relative_ppm == pytest.approx(100.0, rel=0.1)
    seen = (
        fold(true_hz, clock.rate().hz)
        if not locked
        else true_hz / sensor.clock.true_hz * clock.rate().hz
    )
    values = block.counts[rows].astype(float)
    found = origin_of(
        values, np.arange(len(rows), dtype=float), clock.rate().hz,
        (seen, seen - 2e-3, seen + 2e-3), wander, pieces=pieces,
    )  # fmt: skip
    assert found.source == source
    if source == "external":
        assert found.frequency_hz == pytest.approx(true_hz, abs=0.01)


def replace_rows(ticks, rows):
    return Ticks(
        np.arange(len(rows)), ticks.device_s[rows], ticks.host_s[rows], ticks.temperature_c[rows]
    )


@pytest.mark.parametrize(
    ("second", "line", "words"),
    [
        ((208.3, 5.0), 58.3, "external, alias of 150 Hz"),
        ((208.3, 5.0), 46.0 * 208.3 / 104.0, "locked to the sensor's clock"),
        ((107.1, 5.0), 46.0, "external, at 46 Hz"),
        ((107.1, 5.0), fold(370.0, 107.1), "external, alias of 370 Hz"),
        ((104.0, 5.0), 46.0, "not determined"),
        ((107.1, 5.0), 20.0, ""),
    ],
)
def test_two_rates_or_boards_decide(second, line, words):
    one = RecordedLines(104.0, 5.0, [(46.0, 45.9995, 46.0005)])
    other = RecordedLines(*second, [(line, line - 5e-4, line + 5e-4)])
    found = lines_in_both(one, other)
    assert bool(found) == bool(words)
    assert not found or found[0].words.startswith(words)


def test_a_vague_line_agrees_with_anything_and_decides_nothing():
    one = RecordedLines(104.0, 5.0, [(46.0, 45.0, 47.0)])
    assert lines_in_both(one, RecordedLines(107.1, 5.0, [(20.0, 19.0, 21.0)])) == ()


def test_one_arrival_far_off_is_no_wander_of_the_clock():
    """The last of 180 is 20 ms early: a polynomial of high order would go through it."""
    n = np.arange(180) * 400
    time_s = n / 104.0 + 1e-5 * np.random.default_rng(2).normal(size=n.size)
    time_s[-1] -= 0.02
    assert clock_wander_of((n, time_s, np.zeros(n.size, np.int64))) is None
    wandering = time_s + 5e-4 * np.sin(n / n[-1] * 2 * np.pi)
    found = clock_wander_of((n, wandering, np.zeros(n.size, np.int64)))
    assert found is not None
    assert found.relative_ppm < 50
