"""A process must be there all along: what sweeps has its spectrum and not its name."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, freqz, lfilter

from allanscope.explain import explain

RATE, SIGMA = 52.0, 4e-3 * 52.0**0.5
SEEDS = range(500, 503)
SECONDS = 900.0
TONES = 12
"""Axes of the tones; of so many at most one may be missed."""


def swept(b, first, last, size):
    """Sweep a tone from first to last Hz, through 0 where the signs differ."""
    frequency = np.linspace(first, last, len(b.t))
    return size * SIGMA * np.sin(2 * np.pi * np.cumsum(frequency) / RATE + b.rng.uniform(0, 6))


def band(b, frequency, bandwidth, size):
    pole = np.exp((-np.pi * bandwidth + 2j * np.pi * frequency) / RATE)
    e = b.rng.normal(size=len(b.t)) + 1j * b.rng.normal(size=len(b.t))
    return np.asarray(size * SIGMA * lfilter([np.sqrt(1 - abs(pole) ** 2)], [1, -pole], e).real)


def all_axes(bench, make):
    """Explain twelve axes: four for every seed."""
    found = []
    for seed in SEEDS:
        b = bench(seed, SECONDS)
        axes = explain(b.record(*(b.noise() + make(b) for _ in range(TONES // 3)))).axes
        found += axes.values()
    return found


def names(found):
    return [effect.kind for effect in found.effects]


@pytest.mark.parametrize(
    ("first", "last", "size"),
    [(-0.5, 0.5, 0.3), (-0.5, 0.5, 1.0), (-5, 5, 0.3), (5, 15, 0.5), (8, 10, 0.2), (8, 10, 0.5)],
)
def test_a_tone_that_sweeps_is_unexplained(bench, first, last, size):
    found = all_axes(bench, lambda b: swept(b, first, last, size))
    assert not any(axis.explained for axis in found)
    assert not any(
        {"gauss_markov", "narrowband", "band_limit"} & set(names(axis)) for axis in found
    )
    assert sum("unexplained" in names(axis) for axis in found) >= TONES - 1


def few_times(b, frequency, size):
    """Return noise in a band of five coherence times, as it is long after it began."""
    pole = np.exp((-np.pi * 5 / SECONDS + 2j * np.pi * frequency) / RATE)
    e = b.rng.normal(size=(4 * len(b.t), 2)) @ [1, 1j]
    noise = lfilter([np.sqrt(1 - abs(pole) ** 2)], [1, -pole], e)
    return size * SIGMA * noise[-len(b.t) :].real


@pytest.mark.parametrize(("frequency", "size"), [(0.3, 0.5), (2.0, 0.3), (8.0, 1.0)])
def test_noise_in_a_band_of_few_coherence_times_has_a_name(bench, frequency, size):
    """They are not enough to show that it is noise, but nothing speaks against it."""
    found = all_axes(bench, lambda b: few_times(b, frequency, size))
    assert sum(set(names(axis)) <= {"narrowband", "drifting_line"} for axis in found) >= TONES - 2


@pytest.mark.parametrize(("frequency", "size"), [(0.3, 0.4), (0.5, 0.6)])
def test_noise_in_a_band_that_is_there_for_a_while_is_no_noise_all_along(bench, frequency, size):
    found = all_axes(
        bench, lambda b: few_times(b, frequency, size) * (abs(b.t - SECONDS / 2) < 25.0)
    )
    assert sum(bool(names(axis)) for axis in found) >= TONES - 1
    assert not any("narrowband" in names(axis) for axis in found)


def test_noise_in_a_band_whose_level_changes_has_a_name_in_a_short_record_too(bench):
    """Its parts are too short to show how its spectrum moves."""
    bands = []
    for seed in SEEDS:
        b = bench(seed, 60.0)
        level = 1 + 0.8 * np.sin(2 * np.pi * b.t / 40.0)
        shaken = (b.noise() + level * band(b, 8.0, 0.4, 0.7) for _ in range(TONES // 3))
        effects = [e for axis in explain(b.record(*shaken)).axes.values() for e in axis.effects]
        bands += [e.evidence["swells"] for e in effects if e.kind == "narrowband"]
    assert len(bands) >= 8
    assert all(least < 0.6 * most for least, most in filter(None, bands))
    assert sum(one is not None for one in bands) >= 6


@pytest.mark.parametrize(("size", "time"), [(0.3, 1.0), (1.0, 0.1), (1.0, 5.0)])
def test_gauss_markov_noise_keeps_its_name(bench, size, time):
    found = all_axes(bench, lambda b: b.gauss_markov(size * SIGMA, time))
    assert sum(names(axis) == ["gauss_markov"] for axis in found) >= TONES - 1


@pytest.mark.parametrize(
    ("frequency", "width", "size"), [(12, 0.3, 0.2), (12, 3, 0.5), (2, 0.2, 1)]
)
def test_noise_in_a_band_keeps_its_name(bench, frequency, width, size):
    found = all_axes(bench, lambda b: band(b, frequency, width, size))
    assert sum(names(axis) == ["narrowband"] for axis in found) >= TONES - 1


@pytest.mark.parametrize(("order", "cutoff"), [(1, 20.0), (2, 8.0)])
def test_a_filter_keeps_its_name_even_where_the_noise_is_louder_for_a_while(bench, order, cutoff):
    found = []
    for seed in SEEDS:
        b = bench(seed)
        loud = np.where((b.t > 300) & (b.t < 600), 1.5, 1.0)
        columns = [loud * lfilter(*butter(order, 2 * cutoff / RATE), b.noise()) for _ in range(4)]
        found += explain(b.record(*columns, lsb=1e-4)).axes.values()
    assert sum("band_limit" in names(axis) for axis in found) >= TONES - 1


def test_an_average_in_the_sensor_is_a_low_pass_and_nothing_else(bench):
    """Two averages of ten samples, one behind the other, of which every fifth is read."""
    window = np.convolve(np.ones(10), np.ones(10)) / 100
    f, passed = freqz(window, worN=20_000, fs=5 * RATE)
    truth = float(f[np.argmax(np.abs(passed) ** 2 < 0.5)])
    for seed in SEEDS[:2]:
        b = bench(seed)
        fast = b.rng.normal(0, SIGMA * np.sqrt(5), 5 * len(b.t) + len(window) - 1)
        result = explain(b.record(np.convolve(fast, window, "valid")[::5], lsb=1e-5))
        found = result.axes["gx"]
        assert names(found) == ["band_limit"]
        cutoff = found.effects[0].parameters["cutoff"]
        assert cutoff.value == pytest.approx(truth, rel=0.005)
        assert cutoff.upper / cutoff.lower < 1.01
        white = result.fits["gx"].coefficients["N"].value
        assert white == pytest.approx(SIGMA / np.sqrt(RATE), rel=0.02)


def test_gauss_markov_noise_beside_a_loud_stretch_keeps_its_name(bench):
    def beside(b):
        loud = np.where((b.t > 300) & (b.t < 600), 1.5 * SIGMA, 0.0) * b.rng.normal(size=len(b.t))
        return loud + b.gauss_markov(0.5 * SIGMA, 1.0)

    found = all_axes(bench, beside)
    both = {"gauss_markov", "variance_change"}
    assert sum(set(names(axis)) == both for axis in found) >= TONES - 2  # by chance two axes couple


@pytest.mark.parametrize("curvature", [0.01, 0.05])
def test_a_square_of_the_temperature_is_its_curvature_and_no_line(bench, curvature):
    for seed in SEEDS:
        b = bench(seed)
        room = np.sin(2 * np.pi * b.t / b.rng.uniform(300, 500) + b.rng.uniform(0, 6))
        read = np.round((25 + room + b.rng.normal(0, 0.02, len(b.t))) * 256) / 256
        bent, straight, line = explain(
            b.record(
                b.noise() + curvature * room**2,
                b.noise() + curvature * room,
                b.noise() + curvature * np.sin(2 * np.pi * b.t / 77.0),
                temperature=read,
            )
        ).axes.values()
        assert names(bent) == names(straight) == ["temperature"]
        p = bent.effects[0].parameters["curvature"]
        assert abs(p.value - curvature) < 1.7 * (p.upper - p.lower) / 2  # one in a thousand
        assert list(straight.effects[0].parameters) == ["slope"]
        assert names(line) == ["sinusoid"]


def test_a_lag_behind_the_temperature_is_measured_and_paid_for(bench):
    """A lag that was proposed without its price would stand beside every slope."""
    late_found = 0
    for seed in SEEDS:
        b = bench(seed)
        keep = np.exp(-1 / (40.0 * RATE))

        def late(x, keep=keep):
            return lfilter([1 - keep], [1.0, -keep], x, zi=[keep * x[0]])[0]

        swings = [np.sin(2 * np.pi * b.t / T + b.rng.uniform(0, 6)) for T in (170, 400)]
        room = np.sum(swings, axis=0)
        read = np.round((25 + room + b.rng.normal(0, 0.02, len(b.t))) * 256) / 256
        behind, prompt, both, clean = explain(
            b.record(
                b.noise() + 0.01 * late(room),
                b.noise() + 0.01 * room,
                b.noise() + 0.01 * late(room) + 0.005 * late(room) ** 2,
                b.noise(),
                temperature=read,
            )
        ).axes.values()
        assert names(behind) == names(prompt) == names(both) == ["temperature"]
        assert names(clean) == []
        assert list(prompt.effects[0].parameters) == ["slope"]
        late_found += list(behind.effects[0].parameters) == ["slope", "lag"]
        assert list(both.effects[0].parameters) == ["slope", "lag", "curvature"]
        for found in (behind, both):
            p = found.effects[0].parameters["lag"]
            assert p.lower / 1.3 < 40.0 < 1.3 * p.upper
            assert p.upper < 2 * p.lower
    assert late_found == len(SEEDS)


# Resonances within each other's width


def assert_are_two(found, apart, sigma):
    assert [effect.kind for effect in found.effects] == ["narrowband"] * 2
    assert found.explained
    effects = sorted(found.effects, key=lambda effect: effect.parameters["frequency"].value)
    for effect, side in zip(effects, (-1, 1), strict=True):
        truth = {"frequency": 6 + side * apart / 2, "bandwidth": 0.6, "sigma": sigma}
        for name, value in truth.items():
            p = effect.parameters[name]
            assert abs(p.value - value) < 1.7 * (p.upper - p.lower) / 2, name  # one in a thousand


@pytest.mark.parametrize(
    ("widths", "seconds", "sigma"),
    [(0.5, 7200.0, 24e-3), (1.0, 1200.0, 12e-3), (2.0, 1200.0, 12e-3)],
)
def test_two_resonances_within_each_other_s_width_are_told_apart(bench, widths, seconds, sigma):
    b = bench(611, seconds)
    apart = 0.6 * widths
    pair = [band(b, 6 + side * apart / 2, 0.6, sigma / SIGMA) for side in (-1, 1)]
    assert_are_two(explain(b.record(b.noise() + sum(pair))).axes["gx"], apart, sigma)


def test_one_band_of_any_form_is_not_split(bench):
    b = bench(612, 1200.0)
    passed = lfilter(*butter(2, [5.5 / 26, 6.5 / 26], "bandpass"), b.rng.normal(size=len(b.t)))
    columns = (
        b.noise() + band(b, 6.0, 0.6, 0.4),
        b.noise() + band(b, 9.0, 1.5, 0.7),
        b.noise() + 15e-3 * passed / passed.std(),
    )
    for found in explain(b.record(*columns)).axes.values():
        assert [effect.kind for effect in found.effects] == ["narrowband"]
