"""The fit from samples to coefficients: truth recovered, intervals that hold, nothing invented."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from allanscope.history import History
from allanscope.noise import NoiseModel, fit_array, fit_noise, relative_bounds, wait_until
from allanscope.noise.components import Flicker, RandomWalk, White
from allanscope.noise.drift import fit_drift, ramp_pattern
from allanscope.noise.evidence import Ordinates
from allanscope.noise.likelihood import Likelihood
from allanscope.parts import part_named
from allanscope.pipeline.table_files import table_of_file
from allanscope.spectrum import SpectrumBank

RATE = 104.0
TRUTH = {"N": 4e-3, "B": 1.255e-3, "K": 1e-4}
MINUTES_20 = int(1200 * RATE)


@pytest.fixture(scope="module")
def study(make_noise):
    """Forty records of 20 minutes, fitted."""
    rng = np.random.default_rng(21)
    return [fit_array(make_noise(MINUTES_20, 1 / RATE, rng, **TRUTH), RATE) for _ in range(40)]


def estimates(study, name):
    return np.array([fit.coefficients[name].value for fit in study])


def test_white_noise_and_flicker_reach_the_bound(study):
    bounds = relative_bounds([White(4e-3), Flicker(1.255e-3), RandomWalk(1e-4)], 1 / RATE, 1200)
    for name, most in (("N", 1.25), ("B", 1.35), ("K", 1.2)):
        # 40 records: a ratio is known to 11 %.
        error = estimates(study, name) / TRUTH[name] - 1
        assert np.sqrt(np.mean(error**2)) / bounds[name] < most
    assert np.mean(estimates(study, "B")) == pytest.approx(1.255e-3, rel=3 * 0.145 / np.sqrt(40))


def test_intervals_hold_as_often_as_they_say(study):
    for name, truth in TRUTH.items():
        found = [fit.coefficients[name] for fit in study]
        inside = sum(c.lower <= truth <= c.upper for c in found)
        # 95 % of 40: 38 +- 1.4.
        assert inside >= 33
        assert all(c.lower <= c.value <= c.upper for c in found)
    widths = [(c.upper - c.lower) / c.value for c in (fit.coefficients["N"] for fit in study)]
    assert np.mean(widths) == pytest.approx(2 * 1.96 * 0.00203, rel=0.1)


def test_what_is_there_is_detected_and_what_is_not_is_limited(study):
    assert all(fit.coefficients["N"].detected for fit in study)
    # After 20 minutes B stands out by four standard deviations, K by less than two.
    assert sum(fit.coefficients["B"].detected for fit in study) >= 26
    assert sum(fit.coefficients["K"].detected for fit in study) <= 10
    for name in "QR":
        assert sum(fit.coefficients[name].detected for fit in study) <= 1
        assert all(fit.coefficients[name].upper > 0 for fit in study)
    assert sum(fit.band_limit is not None for fit in study) <= 1
    undetected = [f.coefficients["K"] for f in study if not f.coefficients["K"].detected]
    assert all(c.lower == 0.0 for c in undetected)
    assert np.mean([c.upper > 1e-4 for c in undetected]) > 0.9


def test_whitened_spectrum_is_white(study):
    assert np.median([fit.chi2 / fit.dof for fit in study]) == pytest.approx(1.0, abs=0.12)
    assert sum(fit.p_value < 0.01 for fit in study) <= 3


def test_nothing_is_found_in_white_noise(make_noise):
    rng = np.random.default_rng(22)
    counts = dict.fromkeys("QBKR", 0)
    for _ in range(40):
        fit = fit_array(make_noise(20_000, 0.01, rng, N=4e-3), 100.0)
        assert fit.coefficients["N"].value == pytest.approx(4e-3, rel=0.03)
        for name in counts:
            counts[name] += fit.coefficients[name].detected
    # One in 1000 each.
    assert sum(counts.values()) <= 1, counts


def test_limits_of_what_is_absent_are_limits(make_noise):
    rng = np.random.default_rng(23)
    truth = 2e-3
    # A flicker this small is never seen in so short a record, and must lie below its limit.
    inside = 0
    for _ in range(40):
        fit = fit_array(make_noise(4_000, 0.01, rng, N=4e-3, B=truth), 100.0)
        inside += fit.coefficients["B"].lower <= truth <= fit.coefficients["B"].upper
    assert inside >= 35


def test_ramp_is_found_and_does_not_go_into_the_random_walk(rng, make_noise):
    n = 360_000
    noise = make_noise(n, 0.01, rng, N=4e-3, B=1e-3)
    slope = -4e-5
    fit = fit_array(noise + slope * 0.01 * np.arange(n), 100.0)
    ramp = fit.coefficients["R"]
    assert ramp.detected
    assert ramp.lower <= abs(slope) <= ramp.upper
    assert fit.remarks[0].startswith("R detected: the level drifts in a straight line, by ")
    assert fit.slope == pytest.approx(slope, rel=0.15)
    assert fit.model.get("R") is not None
    without = fit_array(noise, 100.0)
    assert fit.coefficients["K"].upper < 1.5 * without.coefficients["K"].upper + 2e-5
    assert not without.coefficients["R"].detected
    assert without.slope == 0.0


def test_random_walk_is_not_taken_for_a_ramp(make_noise):
    rng = np.random.default_rng(24)
    found = 0
    for _ in range(40):
        fit = fit_array(make_noise(7200, 0.5, rng, N=4e-3, K=5e-4), 2.0)
        found += fit.coefficients["R"].detected
        assert fit.coefficients["K"].detected
    assert found <= 1


def test_ramp_interval_holds(make_noise):
    rng = np.random.default_rng(25)
    inside = 0
    for _ in range(40):
        rows = make_noise(7200, 0.5, rng, **TRUTH) + 1.2e-5 * 0.5 * np.arange(7200)
        data = Likelihood([Ordinates.of(rows, 0.5)])
        start = NoiseModel((White(1e-3), Flicker(1e-3), RandomWalk(1e-4)), 0.5)
        drift = fit_drift(data.maximise(start))
        inside += abs(drift.slope - 1.2e-5) < drift.half_width
    assert inside >= 33


def test_ramp_pattern_is_the_transform_of_a_ramp_of_row_means():
    samples = 0.3 * 0.01 * np.arange(6400.0)
    ordinates = Ordinates.of(samples.reshape(-1, 8).mean(axis=1), 0.01, stride=8)
    np.testing.assert_allclose(ordinates.raw[0], 0.3 * ramp_pattern(ordinates), atol=1e-9)
    left = ordinates.less(0.3 * ramp_pattern(ordinates))
    assert left.power.max() < 1e-20


@pytest.mark.parametrize(("cutoff", "taps"), [(33.3, butter(2, 0.64)), (10.0, None)])
def test_low_pass_is_found_and_white_noise_is_what_long_averages_show(
    rng, make_noise, cutoff, taps
):
    n = 250_000
    drive = make_noise(n, 1 / RATE, rng, N=4e-3, B=1.255e-3)
    pole = np.exp(-2 * np.pi * cutoff / RATE)
    taps = taps or ([1 - pole], [1.0, -pole])
    samples = lfilter(*taps, drive)
    fit = fit_array(samples, RATE, part=part_named("LSM6DSL"))
    assert fit.band_limit is not None
    assert fit.band_limit.unit == "Hz"
    assert fit.band_limit.value == pytest.approx(cutoff, rel=0.02)
    assert fit.coefficients["N"].value == pytest.approx(4e-3, rel=0.02)
    assert fit.coefficients["B"].value == pytest.approx(1.255e-3, rel=0.35)
    assert not fit.coefficients["Q"].detected
    assert fit.p_value > 1e-4


def test_angle_quantization_needs_evidence_and_is_remarked_on(rng, make_noise):
    n = 200_000
    angle = np.diff(rng.standard_normal(n + 1)) * 1e-4 * RATE
    fit = fit_array(make_noise(n, 1 / RATE, rng, N=4e-3) + angle, RATE)
    assert fit.coefficients["Q"].detected
    assert fit.coefficients["Q"].lower <= 1e-4 <= fit.coefficients["Q"].upper
    assert "rate sensor" in fit.remarks[0]


def test_vibration_is_not_called_quantization(rng, make_noise):
    n = 200_000
    line = 0.05 * np.sin(2 * np.pi * 41.0 / RATE * np.arange(n))
    fit = fit_array(make_noise(n, 1 / RATE, rng, N=4e-3) + line, RATE)
    assert not fit.coefficients["Q"].detected
    assert fit.band_limit is None
    assert abs(fit.bands.worst) > 10


def test_rounding_is_set_apart(rng, make_noise):
    n, step = 300_000, 0.07
    samples = np.round((make_noise(n, 1 / RATE, rng, N=6e-3) + 0.011) / step) * step
    apart = fit_array(samples, RATE, lsb=step)
    together = fit_array(samples, RATE)
    assert apart.rounding == pytest.approx(step / np.sqrt(12 * RATE))
    assert apart.coefficients["N"].value == pytest.approx(6e-3, rel=0.01)
    assert together.coefficients["N"].value == pytest.approx(
        np.hypot(6e-3, apart.rounding), rel=0.01
    )
    # A step that the values do not lie on is no step of theirs.
    assert fit_array(samples + 0.01 * rng.random(n), RATE, lsb=step).rounding == 0.0


@pytest.fixture(scope="module")
def night(make_noise):
    """Two axes for 4 hours in counts, through what a run keeps, with a gap."""
    rng = np.random.default_rng(26)
    n, step = 1_400_000, 4.375e-3
    columns = [make_noise(n, 1 / RATE, rng, **{k: f * v for k, v in TRUTH.items()}) for f in (1, 2)]
    counts = np.round(np.column_stack(columns) / step).astype(np.int16)
    history, bank = History(2, rows=1 << 17), SpectrumBank(RATE, 2)
    for first in range(0, n, 1 << 16):
        history.update(counts[first : first + (1 << 16)])
        bank.update(counts[first : first + (1 << 16)])
    scale = (step, step)
    return history.record(RATE, ("gx", "gy"), scale), bank.densities(scale=scale), counts * step


def test_a_night_of_averages_and_spectrum_says_what_the_samples_say(night):
    record, densities, samples = night
    assert record.stride == 16
    for column, axis in enumerate(record.axes):
        kept = fit_noise(record, axis, densities[column])
        direct = fit_array(samples[:, column], RATE, lsb=record.lsb[column])
        for name in "NBK":
            one, other = kept.coefficients[name], direct.coefficients[name]
            assert one.value == pytest.approx(other.value, abs=0.3 * (other.upper - other.lower))
            assert one.lower <= (column + 1) * TRUTH[name] * 1.02
            assert one.upper >= (column + 1) * TRUTH[name] * 0.98
        assert kept.rounding == direct.rounding > 0
        assert kept.p_value > 1e-3


def test_averages_alone_are_enough_for_what_is_slow(night):
    record, densities, _ = night
    full = fit_noise(record, "gx", densities[0]).coefficients
    alone = fit_noise(record, "gx").coefficients
    for name in "BK":
        width = full[name].upper - full[name].lower
        assert alone[name].value == pytest.approx(full[name].value, abs=width)
    assert alone["N"].upper - alone["N"].lower > 2 * (full["N"].upper - full["N"].lower)


def test_time_to_wait_is_given_until_a_coefficient_is_known(night):
    record, densities, _ = night
    found = fit_noise(record, "gx", densities[0]).coefficients
    assert found["N"].wait_s is None
    assert found["B"].wait_s is None
    short = fit_array(night[2][:40_000, 0], RATE).coefficients
    assert short["B"].wait_s is None or short["B"].wait_s > 10
    assert short["K"].wait_s is None or short["K"].wait_s > 1000


def test_the_time_to_wait_is_about_what_it_takes(study, make_noise):
    model = [White(4e-3), Flicker(1.255e-3), RandomWalk(1e-4)]
    needed = wait_until(model, 1 / RATE, 1200.0, "K")
    assert needed == pytest.approx(2.3 * 3600, rel=0.2)
    waits = [fit.coefficients["K"].wait_s for fit in study]
    assert None not in waits
    assert needed / 3 < np.median(waits) < 3 * needed
    for fit in study:
        for name in "NBK":
            found = fit.coefficients[name]
            known = found.detected and found.upper - found.lower < 0.784 * found.value
            assert (found.wait_s is None) == known
            assert known or found.wait_s > 0


def test_real_gyro_with_an_undeclared_warm_up():
    path = Path(__file__).parents[2] / "recordings" / "measured" / "st-gyro-warmup.parquet"
    columns = table_of_file(path).columns
    samples = columns.axes["gx"] * columns.scales["gx"]
    fit = fit_array(samples, 100.0, lsb=8.75e-3)
    found = fit.coefficients
    assert found["K"].detected
    assert found["K"].value == pytest.approx(5.1e-3, rel=0.15)
    assert found["B"].lower <= 2.0e-3 <= found["B"].upper
    assert found["N"].value * 10 == pytest.approx(np.std(np.diff(samples)) / np.sqrt(2), rel=0.05)
    # The textbook is not the whole truth here, and the residual says so.
    assert fit.p_value < 1e-6


@pytest.mark.parametrize(("seed", "size"), [(7, 0.03), (7, 0.05), (24, 0.03)])
def test_a_fit_to_what_no_term_can_follow_converges_too(seed, size, make_noise):
    """A warm-up; scoring alone creeps here for more than a hundred steps."""
    n, rate = 94_000, 104.0
    samples = make_noise(n, 1 / rate, np.random.default_rng(seed), N=2.7e-3, B=1e-3, K=1e-4)
    fit = fit_array(samples + size * np.exp(-np.arange(n) / rate / 200), rate)
    assert fit.fit.converged
    assert not any("converge" in remark for remark in fit.remarks)


@pytest.mark.parametrize(("sigma", "limited"), [(0.3, True), (0.7, False)])
def test_a_step_that_hides_the_sensor_is_remarked_on(rng, sigma, limited):
    samples = 0.07 * np.round(sigma * rng.standard_normal(100_000) + 0.3)
    fit = fit_array(samples, RATE, lsb=0.07)
    assert fit.step_limited == limited
    assert any("smaller full scale" in remark for remark in fit.remarks) == limited


ODD = {
    "a ramp": lambda n, _: np.arange(n) * 1.0,
    "a step": lambda n, _: np.where(np.arange(n) < n // 2, 0.0, 1.0),
    "a spike": lambda n, _: np.where(np.arange(n) == n // 3, 1e6, 0.0),
    "plus and minus": lambda n, _: (-1.0) ** np.arange(n),
    "a line": lambda n, _: np.sin(0.3 * np.arange(n)),
    "a walk of walks": lambda n, rng: np.cumsum(np.cumsum(rng.standard_normal(n))),
    "two codes": lambda n, rng: np.round(0.2 * rng.standard_normal(n) + 0.4),
    "wild outliers": lambda n, rng: rng.standard_cauchy(n),
    "noise on a large offset": lambda n, rng: 1e8 + rng.standard_normal(n),
    "smoothed noise": lambda n, rng: np.convolve(rng.standard_normal(n), np.hanning(30), "same"),
}


@pytest.mark.parametrize("n", [16, 100, 3000])
@pytest.mark.parametrize("name", ODD)
def test_odd_records_give_finite_numbers_without_a_warning(name, n, rng):
    samples = ODD[name](n, rng)[:n]
    for lsb in (None, 1.0):
        fit = fit_array(samples, RATE, lsb=lsb, part=part_named("LSM6DSL"))
        for found in fit.coefficients.values():
            assert np.isfinite([found.value, found.upper]).all()
            assert 0 <= found.lower <= found.value <= found.upper


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros(1000), "constant"),
        (np.ones(1000), "constant"),
        (np.full(5000, -0.3), "constant"),
        (np.arange(3.0), "16 contiguous"),
        (np.array([0.0, np.nan] * 50), "not finite"),
        (np.zeros((50, 2)), r"shape \(n,\)"),
    ],
)
def test_bad_records_are_refused(values, words):
    with pytest.raises(ValueError, match=words):
        fit_array(values, 100.0)


def test_unknown_axis_is_refused(night):
    with pytest.raises(ValueError, match="no axis 'az'"):
        fit_noise(night[0], "az")


def test_scale_of_the_values_is_only_a_unit(study, make_noise):
    samples = make_noise(20_000, 0.01, np.random.default_rng(27), **TRUTH)
    small, large = fit_array(samples * 1e-6, 100.0, unit="g"), fit_array(samples * 1e6, 100.0)
    for name in "NBK":
        one, other = small.coefficients[name], large.coefficients[name]
        assert one.value * 1e12 == pytest.approx(other.value, rel=1e-3)
        assert one.upper * 1e12 == pytest.approx(other.upper, rel=2e-2)
    assert small.coefficients["N"].unit == "g/sqrt(Hz)"
    assert small.coefficients["K"].unit == "g/sqrt(s)"
