"""Every noise generator against its closed form, and against itself in other portions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from allanscope.simulator.noise import (
    Flicker,
    FlickerPhase,
    FlickerWalk,
    GaussMarkov,
    Narrowband,
    OctaveFlicker,
    PowerLaw,
    RandomRun,
    RandomWalk,
    White,
    WhitePhase,
    stream,
)
from allanscope.simulator.noise.power_law import pole_bank

RATE = 104.0
N_SAMPLES = 1 << 20
WINDOWS = (1, 2, 4, 8, 16, 64, 256, 1024)


def odd_harmonics(m):
    """1 + 1/3 + ... + 1/(2 m - 1)."""
    return float(np.sum(1.0 / np.arange(1, 2 * m, 2)))


def flicker_avar(windows):
    """AVAR of ARFIMA(0, 1/2, 0) with unit innovations, exact in discrete time."""
    windows = np.asarray(windows)
    harmonics = np.concatenate(([0.0], np.cumsum(1.0 / np.arange(1, 4 * windows.max(), 2))))
    double = np.cumsum(np.cumsum(harmonics))  # double[m - 1] = sum_{j<m} (m - j) h_j
    return 2.0 / (math.pi * windows**2.0) * (double[2 * windows - 1] - 4.0 * double[windows - 1])


def integral(alpha, sigma, m, order):
    """AVAR (order 2) or HVAR (order 3) of sigma (1 - z^-1)^(alpha/2) w, over its spectrum."""
    x = np.exp(np.linspace(math.log(1e-9), math.log(math.pi / 2), 200_001))
    density = 2.0 * sigma**2 * (2.0 * np.sin(x)) ** alpha
    factor = {2: 2.0, 3: 8.0 / 3.0}[order]
    weight = factor * np.sin(m * x) ** (2 * order) / (m * np.sin(x)) ** 2
    return float(np.trapezoid(density * weight * x, np.log(x)) / math.pi)


CLOSED = {
    "White": (White, 2.0, lambda m: 4.0 * RATE / m),
    "Flicker": (Flicker, 2.0, lambda m: 4.0 * flicker_avar([m])[0]),
    "RandomWalk": (RandomWalk, 2.0, lambda m: 4.0 * (m / RATE) / 3.0 * (1.0 + 0.5 / m**2)),
    "WhitePhase": (WhitePhase, 2.0, lambda m: 3.0 * 4.0 * (RATE / m) ** 2),
    "FlickerPhase": (
        FlickerPhase,
        2.0,
        lambda m: 8.0 / math.pi * (RATE / m) ** 2
        * (4.0 * odd_harmonics(m) - odd_harmonics(2 * m)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CLOSED)
def test_allan_variance_is_that_of_the_closed_form(name, avar):
    """Five standard deviations: at m the estimate has at least n / (1.5 m) degrees of freedom."""
    process, coefficient, closed = CLOSED[name]
    samples = process(coefficient, RATE, stream(1, name)).take(N_SAMPLES)
    for m in WINDOWS:
        tolerance = 5.0 * math.sqrt(2.0 * 1.5 * m / N_SAMPLES) + 1e-3
        assert avar(samples, m) == pytest.approx(closed(m), rel=tolerance), f"m = {m}"


def octaves_avar(m):
    """AVAR of numbers of unit variance held for 2, 4, 8, ... samples, and of rand()."""
    lags = np.arange(1, 2 * m)
    held = 2.0 ** np.arange(1, 31)
    covariance = np.maximum(1.0 - lags / held[:, np.newaxis], 0.0).sum(axis=0)

    def variance_of_sum(k):
        own = k * (len(held) + 1.0 / 12.0)
        return own + 2.0 * float((k - lags[: k - 1]) @ covariance[: k - 1])

    return (4.0 * variance_of_sum(m) - variance_of_sum(2 * m)) / (2.0 * m**2)


def test_the_generator_of_the_design_tip_makes_flicker_noise(avar):
    """Against the covariance of held numbers, and the floor of flicker noise from m = 32 on."""
    samples = OctaveFlicker(2.0, RATE, stream(1, "octaves")).take(N_SAMPLES)
    for m in WINDOWS:
        tolerance = 5.0 * math.sqrt(2.0 * 1.5 * m / N_SAMPLES) + 1e-3
        expected = 4.0 * math.log(2.0) / math.pi * octaves_avar(m)
        assert avar(samples, m) == pytest.approx(expected, rel=tolerance), f"m = {m}"
        if m >= 32:
            floor = 4.0 * 2.0 * math.log(2.0) / math.pi
            assert avar(samples, m) == pytest.approx(floor, rel=tolerance + 0.03)


def test_the_generator_of_the_design_tip_is_its_listing():
    """The loop of DT0064, one sample at a time, fed with the same numbers."""
    made = OctaveFlicker(1.0, RATE, np.random.default_rng(5)).take(3000)
    rng = np.random.default_rng(5)
    (uniform,) = rng.spawn(1)
    sd = math.sqrt(math.log(2.0) / math.pi)
    generators = sd * rng.standard_normal(math.ceil(math.log2(1e7 * RATE)))
    total, listing = generators.sum(), []
    for i in range(1, 3001):
        trailing = (i & -i).bit_length() - 1
        total -= generators[trailing]
        generators[trailing] = sd * rng.standard_normal()
        total += generators[trailing]
        listing.append(total + sd * (uniform.random() - 0.5))
    np.testing.assert_allclose(made, listing, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("process", "alpha"), [(FlickerWalk, -3.0), (RandomRun, -4.0)])
def test_hadamard_variance_of_the_integrated_noises(process, alpha, hvar):
    """No Allan variance exists; sigma = coefficient / rate^(-1 - alpha) / 2 by the conventions."""
    samples = process(2.0, RATE, stream(2, process.__name__)).take(N_SAMPLES)
    sigma = 2.0 * RATE ** ((1.0 + alpha) / 2.0)
    for m in (1, 4, 16, 64, 256, 1024):
        tolerance = 5.0 * math.sqrt(2.0 * 2.0 * m / N_SAMPLES) + 5e-3
        assert hvar(samples, m) == pytest.approx(integral(alpha, sigma, m, 3), rel=tolerance)


@pytest.mark.parametrize(
    ("process", "slope", "hadamard"),
    [
        (WhitePhase, -2.0, False),
        (FlickerPhase, -2.0, False),
        (White, -1.0, False),
        (Flicker, 0.0, False),
        (RandomWalk, 1.0, False),
        (FlickerWalk, 2.0, True),
        (RandomRun, 3.0, True),
    ],
)
def test_slopes_of_the_table_of_dt0064(process, slope, hadamard, avar, hvar):
    """Slope of the variance from m = 32 to 512; flicker phase is a logarithm off its -2."""
    samples = process(1.0, RATE, stream(3, process.__name__)).take(N_SAMPLES)
    variance = hvar if hadamard else avar
    windows = np.array([32, 64, 128, 256, 512])
    values = [variance(samples, m) for m in windows]
    fitted = np.polyfit(np.log(windows), np.log(values), 1)[0]
    assert fitted == pytest.approx(slope, abs=0.27 if process is FlickerPhase else 0.06)


def test_flicker_bank_is_exact_to_a_tenth_of_a_per_cent_over_nine_decades():
    """Computed from the poles, without any sample: AVAR from V(m), the variance of sums of m."""
    rate, longest = 6660.0, 1e5
    poles, weights, direct = pole_bank(0.5, 1e7 * rate)
    # gamma_k = sum_i share_i p_i^k + white [k = 0]
    share = weights * ((1.0 / (1.0 - np.outer(poles, poles))) @ weights + direct)
    white = direct**2 + direct * weights.sum()
    decay = np.log(poles)
    fade = -np.expm1(decay)

    def variance_of_sum(m):
        own = m * (1.0 + poles) / fade + 2.0 * poles * np.expm1(m * decay) / fade**2
        return float(share @ own) + white * m

    windows = np.unique(np.geomspace(1, 2**20, 81).astype(int))
    exact = dict(zip(windows.tolist(), flicker_avar(windows), strict=True))
    plateau = 2.0 * math.log(2.0) / math.pi
    exact |= {int(m): plateau for m in np.geomspace(2**20, longest * rate, 40)}
    for m, expected in exact.items():
        found = (4.0 * variance_of_sum(m) - variance_of_sum(2 * m)) / (2.0 * m**2)
        assert found == pytest.approx(expected, rel=1.5e-3), f"m = {m}"


@pytest.mark.parametrize("d", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_fractional_bank_has_the_response_of_the_fractional_difference(d):
    poles, weights, direct = pole_bank(d, 1e9)
    omega = np.geomspace(1e-6, math.pi, 200)
    back = np.exp(-1j * omega)
    response = direct + (weights / (1.0 - np.outer(back, poles))).sum(axis=1)
    exact = (2.0 * np.sin(omega / 2.0)) ** -d
    assert np.abs(response) == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("alpha", [-1.5, -0.5, 0.5, 1.5])
def test_power_law_between_the_named_ones(alpha, avar):
    noise = PowerLaw(alpha, 3.0, RATE, stream(4, f"{alpha}"))
    samples = noise.take(N_SAMPLES)
    for m in (1, 4, 16, 64):
        tolerance = 5.0 * math.sqrt(2.0 * 1.5 * m / N_SAMPLES) + 0.01
        assert avar(samples, m) == pytest.approx(integral(alpha, noise.sigma, m, 2), rel=tolerance)


def test_power_law_level_is_the_density_at_low_frequency():
    """S(1 Hz) = h: seen in the periodogram around 1 Hz, at a rate where 1 Hz is low."""
    rate, level, alpha = 200.0, 3.0, -1.5
    samples = PowerLaw(alpha, level, rate, stream(5, "level")).take(1 << 18)
    samples = np.diff(samples)  # the leak of the slow end is nothing after a difference
    frequency = np.fft.rfftfreq(len(samples), 1.0 / rate)
    two_sided = np.abs(np.fft.rfft(samples)) ** 2 / (len(samples) * rate)
    two_sided[1:] /= (2.0 * np.sin(np.pi * frequency[1:] / rate)) ** 2
    band = (frequency > 0.5) & (frequency < 2.0)
    found = np.mean(two_sided[band] / frequency[band] ** alpha)
    assert found == pytest.approx(level, rel=5.0 / math.sqrt(band.sum()))


def test_gauss_markov_is_stationary_with_the_exact_autocovariance(avar):
    sigma, correlation_time = 2.0, 0.5
    samples = GaussMarkov(sigma, correlation_time, RATE, stream(8, "gm")).take(N_SAMPLES)
    phi = math.exp(-1.0 / (RATE * correlation_time))
    for m in (1, 8, 64, 512):
        exact = (sigma / m) ** 2 * (
            m * (1 + phi) / (1 - phi) - phi * (3 - 4 * phi**m + phi ** (2 * m)) / (1 - phi) ** 2
        )
        tolerance = 5.0 * math.sqrt(2.0 * 1.5 * max(m, 50) / N_SAMPLES)
        assert avar(samples, m) == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize("kind", ["gauss_markov", "narrowband", "flicker"])
def test_first_sample_is_drawn_from_the_stationary_state(kind):
    """The spread of sample 0 over 500 devices is that of sample 500."""
    make = {
        "gauss_markov": lambda rng: GaussMarkov(2.0, 1.0, RATE, rng),
        "narrowband": lambda rng: Narrowband(5.0, 0.5, 2.0, RATE, rng),
        "flicker": lambda rng: Flicker(2.0, RATE, rng),
    }[kind]
    records = np.array([make(stream(seed, "start")).take(501) for seed in range(500)])
    first, later = records[:, 0].std(), records[:, 500].std()
    assert first == pytest.approx(later, rel=0.16)
    if kind != "flicker":
        assert first == pytest.approx(2.0, rel=0.16)


def test_narrowband_has_the_autocovariance_of_a_resonance():
    frequency, bandwidth, sigma = 5.0, 1.0, 2.0
    samples = Narrowband(frequency, bandwidth, sigma, RATE, stream(9, "nb")).take(N_SAMPLES)
    w0, decay = 2 * math.pi * frequency, math.pi * bandwidth
    damped = math.sqrt(w0**2 - decay**2)
    for lag in (0, 5, 10, 21, 42):
        t = lag / RATE
        exact = sigma**2 * math.exp(-decay * t) * (
            math.cos(damped * t) + decay / damped * math.sin(damped * t)
        )  # fmt: skip
        found = float(np.mean(samples[: N_SAMPLES - lag] * samples[lag:]))
        assert found == pytest.approx(exact, abs=0.1)  # 4 sigma^2 / sqrt(n / 50)


ALL = {
    name: (lambda rng, process=process: process(2.0, RATE, rng))
    for name, (process, _, _) in CLOSED.items()
} | {
    "FlickerWalk": lambda rng: FlickerWalk(2.0, RATE, rng),
    "RandomRun": lambda rng: RandomRun(2.0, RATE, rng),
    "OctaveFlicker": lambda rng: OctaveFlicker(2.0, RATE, rng),
    "PowerLaw": lambda rng: PowerLaw(1.3, 2.0, RATE, rng),
    "GaussMarkov": lambda rng: GaussMarkov(2.0, 0.3, RATE, rng),
    "Narrowband": lambda rng: Narrowband(5.0, 0.5, 2.0, RATE, rng),
}


@pytest.mark.parametrize("name", ALL)
def test_samples_do_not_depend_on_the_portions_in_which_they_are_taken(name):
    whole = ALL[name](stream(10, name)).take(1000)
    process = ALL[name](stream(10, name))
    parts = [process.take(n) for n in (1, 0, 2, 7, 490, 500)]
    assert np.concatenate(parts).tobytes() == whole.tobytes()


def test_streams_of_other_names_and_seeds_are_unrelated():
    names = (("gx", "white"), ("gy", "white"), ("gx", "flicker"))
    draws = [stream(seed, *name).standard_normal(4000) for seed in (0, 1) for name in names]
    correlation = np.corrcoef(draws) - np.eye(len(draws))
    assert np.abs(correlation).max() < 5.0 / math.sqrt(4000)


@pytest.mark.parametrize(("alpha", "level"), [(-4.1, 1.0), (2.1, 1.0), (0.0, -1.0)])
def test_impossible_power_laws_are_refused(alpha, level):
    with pytest.raises(ValueError, match=r"power law|level"):
        PowerLaw(alpha, level, RATE, stream(0, "bad"))


def test_a_negative_seed_is_refused():
    with pytest.raises(ValueError, match="seed"):
        stream(-1, "gx")
