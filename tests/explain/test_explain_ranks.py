"""Ranks of the truth within what is said of it are uniform: a few kinds, fitted where they are.

The whole of it, with the search and every kind, is `benchmarks/rank_calibration.py`; here one
number of one kind at a time, on records in which its place is known, so that no selection enters.
Ranks pass where a Kolmogorov-Smirnov test gives them 5 % or more, at fixed seeds.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import idct
from scipy.signal import lfilter
from scipy.stats import kstest, norm

from allanscope.explain.burst_rows import find_bursts
from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Parameter
from allanscope.explain.effects import (
    amplitude_coupling,
    band_limit,
    cross_coupling,
    drifting_line,
    excursion,
    gauss_markov,
    high_pass,
    power_law,
    random_telegraph,
    relaxation,
    shock,
    sinusoid,
    step,
    variance_change,
    warm_up,
)
from allanscope.explain.series import series_of
from allanscope.explain.view import View
from allanscope.history import Record
from allanscope.quantities import TWO_SIDED_95

RATE = 13.0


def view_of(*axes: np.ndarray, rate: float = RATE) -> View:
    """Return rows of one to three axes as the loop sees them."""
    values, n = np.column_stack(axes), len(axes[0])
    names = ("gx", "gy", "gz")[: len(axes)]
    record = Record(
        rate_hz=rate,
        stride=1,
        axes=names,
        values=values,
        lsb=(1e-9,) * len(axes),
        temperature_c=np.full(n, np.nan),
        start_s=np.arange(n) / rate,
        segments=np.array([[0, n]], np.int64),
    )
    series = series_of(record)
    return View(series, series.grid, "gx", series.values[:, 0], 1e-9)


def rank(found: Parameter, truth: float) -> float:
    """Return the confidence below the truth, of an estimate or of the logarithm of one."""
    value, lower, upper = (float(x) for x in (found.value, found.lower, found.upper))
    if lower > 0 and abs(np.sqrt(lower * upper) / value - 1) < 1e-6:
        value, lower, upper, truth = np.log([value, lower, upper, truth])
    width = upper - value if truth > value else value - lower
    return float(norm.cdf(TWO_SIDED_95 * (truth - value) / width))


def rank_of_instant(found: Parameter, truth: float, row: float) -> float:
    """Return the confidence below the truth, of the instant of a jump between two rows.

    Between them any instant is as likely; farther away it is half an exponential on each side.
    """
    value, lower, upper = (float(x) for x in (found.value, found.lower, found.upper))
    width = upper - value if truth > value else value - lower
    away = abs(truth - value) / width
    if width >= row:
        beyond = 0.5 * 0.05**away
    else:
        beyond = 0.5 - 0.475 * away if away < 1 else 0.025 / away
    return 1 - beyond if truth > value else beyond


def chance(ranks: list[float]) -> float:
    """Return the probability of ranks at least as far from uniform."""
    return float(kstest(ranks, "uniform").pvalue)


def assert_apt(ranks: list[float], leaning: float = 0.1) -> None:
    """Half of the truths are in the middle half, and 95 % in the interval, within 3 deviations."""
    inner = [np.mean(np.abs(np.array(ranks) - 0.5) < share / 2) for share in (0.5, 0.95)]
    assert abs(inner[0] - 0.5) < 0.1
    assert abs(inner[1] - 0.95) < 0.035
    assert abs(np.mean(np.array(ranks) < 0.5) - 0.5) < leaning


def test_the_amplitude_of_a_line_has_nothing_of_what_noise_adds():
    """A line of 5.5 standard errors, which is what can just be seen."""
    rng, n, ranks = np.random.default_rng(24), 1560, []
    size = 5.5 * np.sqrt(2 / n)
    for _ in range(400):
        f = rng.uniform(0.8, 5.0)
        wave = size * np.sin(2 * np.pi * (f * np.arange(n) / RATE + rng.random()))
        found = sinusoid._at(view_of(wave + rng.standard_normal(n)), f).effect
        ranks.append(rank(found.amplitude, size))
    assert chance(ranks) > 0.05


def test_a_shock_begins_within_the_rows_that_are_said_and_is_as_large():
    rng, rate, n, times, peaks = np.random.default_rng(25), 104.0, 2400, [], []
    t = np.arange(n) / rate
    for _ in range(250):
        at, peak = rng.uniform(5.0, 18.0), np.exp(rng.uniform(np.log(8.0), np.log(40.0)))
        after = np.maximum(t - at, 0.0)
        swing = np.cos(2 * np.pi * (15.6 * after + rng.random()))
        rings = peak * np.exp(-after / rng.uniform(0.2, 0.8)) * swing * (t >= at)
        view = view_of(rings + rng.standard_normal(n), rate=rate)
        for found in shock.Shock.propose(view):
            times.append(rank_of_instant(found.effect.time, at, 1 / rate))
            peaks.append(rank(found.effect.peak, float(np.abs(rings).max())))
    assert len(times) > 200
    assert_apt(times)
    assert chance(peaks) > 0.05
    assert np.mean(np.abs(np.array(peaks) - 0.5) < 0.475) > 0.94


def test_what_rings_softly_swings_as_far_as_is_said():
    """The whitening damps its first rows least: taken for a part of a line it seems too large."""
    rng, rate, n, ranks = np.random.default_rng(37), 104.0, 2496, []
    t = np.arange(n) / rate
    for _ in range(120):
        at, f, d = rng.uniform(3.0, 18.0), rng.uniform(8.0, 40.0), rng.uniform(9.0, 20.0)
        after = np.maximum(t - at, 0.0)
        swing = np.cos(2 * np.pi * (f * after + rng.random()))
        rings = np.exp(-after / rng.uniform(0.2, 0.8)) * swing * (t >= at)
        rings *= d / np.linalg.norm(rings)
        found, _ = find_bursts(rings + rng.standard_normal(n), rate)
        if found:
            value, error = max(found, key=lambda one: one.gain).peak
            ranks.append(float(norm.cdf((np.abs(rings).max() - value) / error)))
    assert len(ranks) > 100
    assert_apt(ranks, leaning=0.14)


def test_noise_changes_its_level_within_the_rows_that_are_said():
    rng, n, starts, stops = np.random.default_rng(26), 3120, [], []
    for _ in range(250):
        t, at, length = np.arange(n) / RATE, rng.uniform(20.0, 120.0), rng.uniform(30.0, 90.0)
        inside = (t >= at) & (t < at + length)
        rows = rng.standard_normal(n) * np.where(inside, rng.uniform(1.4, 2.5), 1.0)
        for found in variance_change.VarianceChange.propose(view_of(rows)):
            starts.append(rank_of_instant(found.effect.start, at, 1 / RATE))
            stops.append(rank_of_instant(found.effect.stop, at + length, 1 / RATE))
    assert len(starts) > 200
    assert_apt(starts)
    assert_apt(stops)


def test_noise_that_is_little_louder_has_borders_as_vague_as_its_levels():
    """Levels that were found where they differ most promise too much: 93.5 % held."""
    rng, n, held = np.random.default_rng(38), 3120, []
    t = np.arange(n) / RATE
    for _ in range(600):
        at, length = rng.uniform(20.0, 120.0), rng.uniform(20.0, 70.0)
        inside = (t >= at) & (t < at + length)
        rows = rng.standard_normal(n) * np.where(inside, rng.uniform(1.25, 1.5), 1.0)
        for found in variance_change.VarianceChange.propose(view_of(rows)):
            ends = (found.effect.start, at), (found.effect.stop, at + length)
            held += [end.lower < truth < end.upper for end, truth in ends]
    assert len(held) > 900
    assert 0.945 < np.mean(held) < 0.965


@pytest.mark.parametrize("is_start", [True, False])
def test_a_border_near_an_end_of_the_record_is_known_where_the_interval_goes_to_the_other(is_start):
    view = view_of(np.random.default_rng(43).standard_normal(3120))
    found = (20.0, 2, 390, 1.2) if is_start else (20.0, 0, 388, 1.2)
    instant = variance_change._border(view, view.innovations, found, 8, 8.0, is_start=is_start)
    assert 0.0 <= instant.lower < instant.value < instant.upper <= 3120 / RATE


def test_the_time_constant_of_a_relaxation_is_as_well_known_as_is_said():
    """It and the random walk beside it are known from the same few ordinates."""
    rng, n, ranks = np.random.default_rng(36), 2048, []
    t = np.arange(n) / RATE
    for _ in range(80):
        at, tc, size = rng.uniform(20.0, 60.0), rng.uniform(8.0, 30.0), rng.uniform(2.0, 5.0)
        lasting = rng.uniform(0.0, 0.5) * size
        creep = lasting + (size - lasting) * np.exp(-np.maximum(t - at, 0.0) / tc)
        noise = rng.standard_normal(n) + np.cumsum(rng.normal(0, 0.005, n))
        view = view_of(noise + (t >= at) * creep)
        found = relaxation.Relaxation._near(view, int(np.ceil(at * RATE)), tc).finished()
        ranks.append(rank(found.effect.time_constant, tc))
    assert_apt(ranks)


@pytest.mark.parametrize(("tc", "named"), [(0.8, False), (2.0, False), (8.0, True)])
def test_what_relaxes_sooner_than_is_looked_for_has_no_time_constant(tc: float, named: bool):
    """The likeliest of those that are tried would be the shortest, whatever it is."""
    rng, n = np.random.default_rng(37), 6000
    since = np.arange(n) / RATE - 40.0
    creep = 0.5 + 4.0 * np.exp(-np.maximum(since, 0.0) / tc)
    view = view_of(rng.standard_normal(n) + (since >= 0) * creep)
    row = int(np.ceil(40.0 * RATE))
    found = [relaxation.Relaxation._near(view, row, start) for start in (3.0, 9.0)]
    assert [one is not None for one in found] == [named, named]
    kinds = [one.kind for one in relaxation.Relaxation.candidates(view)]
    assert kinds == ["relaxation"] * named


def test_a_jump_is_anywhere_between_its_row_and_the_one_before():
    """Told to its first row it would be half a row late, which is an eighth of these ranks."""
    rng, n, ranks = np.random.default_rng(31), 2048, {"step": [], "excursion": [], "relaxation": []}
    t, lengths = np.arange(n) / RATE, []
    for _ in range(80):
        at, size = rng.uniform(40.0, 110.0), np.exp(rng.uniform(np.log(0.4), np.log(5.0)))
        length, tc = rng.uniform(8.0, 15.0), rng.uniform(6.0, 20.0)
        noise = rng.standard_normal(n) + np.cumsum(rng.normal(0, 0.01, n))
        jumps = {
            step.Step: t >= at,
            excursion.Excursion: (t >= at) & (t < at + length),
            relaxation.Relaxation: (t >= at) * np.exp(-np.maximum(t - at, 0.0) / tc),
        }
        for kind, shape in jumps.items():
            for found in kind.candidates(view_of(noise + size * shape)):
                if found.excess > 0:
                    ranks[kind.kind].append(rank_of_instant(found.effect.time, at, 1 / RATE))
                    if kind is excursion.Excursion:
                        lengths.append(rank_of_instant(found.effect.duration, length, 1 / RATE))
    for one in (*ranks.values(), lengths):
        assert len(one) > 40
        assert chance(one) > 0.05


def test_what_a_warm_up_takes_of_the_noise_is_put_back():
    """Two numbers have taken their part of the few ordinates by which a random walk is known.

    Without it 78 % of these intervals of the amplitude hold the truth, with it 89 %.
    """
    rng, n, ranks = np.random.default_rng(33), 2048, []
    t = np.arange(n) / RATE
    for _ in range(150):
        size, tc = np.exp(rng.uniform(np.log(3.0), np.log(10.0))), rng.uniform(12.0, 40.0)
        noise = rng.standard_normal(n) + np.cumsum(rng.normal(0, 0.02, n))
        for found in warm_up.WarmUp.candidates(view_of(noise + size * np.exp(-t / tc))):
            ranks.append(rank(found.effect.amplitude, size))
    assert len(ranks) == 150
    assert np.mean(np.abs(np.array(ranks) - 0.5) < 0.475) > 0.85


def test_hops_that_are_seen_have_the_size_of_their_path():
    rng, n, ranks = np.random.default_rng(28), 2048, []
    for _ in range(100):
        hops = rng.random(n) < 1 / (RATE * rng.uniform(1.5, 5.0))
        level = 1.5 * np.where(np.cumsum(hops) % 2, 1.0, -1.0)
        view = view_of(level + 0.5 * rng.standard_normal(n))
        for found in random_telegraph.RandomTelegraph.propose(view):
            ranks.append(rank(found.effect.amplitude, 1.5))
    assert len(ranks) > 90
    assert_apt(ranks)


def test_hops_in_noise_do_not_scatter_as_the_power_of_a_process_does():
    """Their size is that of the spectrum, whose own interval is too wide.

    It scatters by 0.62 of the error, by 0.51 of that of the spectrum; doubtful blocks have a part
    in it.
    """
    rng, n, away = np.random.default_rng(43), 2048, []
    for _ in range(60):
        hops = rng.random(n) < 1 / (RATE * rng.uniform(2.0, 4.0))
        level = 1.5 * np.where(np.cumsum(hops) % 2, 1.0, -1.0)
        view = view_of(level + 1.7 * rng.standard_normal(n))
        for found in random_telegraph.RandomTelegraph.propose(view):
            size = found.effect.amplitude
            away.append((size.value - 1.5) / size.error)
    assert len(away) > 30
    assert 0.57 < np.std(away) < 1.35


@pytest.mark.parametrize("noise", [0.05, 0.3])
def test_loud_hops_of_a_long_record_are_known_to_the_row(noise: float):
    """On blocks of eight rows what is left at the hops was more than the path explained."""
    rng, rate, n = np.random.default_rng(50), 104.0, 1 << 17
    level = np.where(np.cumsum(rng.random(n) < 1 / (2 * rate)) % 2, 1.0, -1.0)
    view = view_of(level + noise * rng.standard_normal(n), rate=rate)
    (found,) = random_telegraph.RandomTelegraph.propose(view)
    assert found.gain > 20 * found.rivals["gauss_markov"]
    assert found.effect.amplitude.value == pytest.approx(1.0, abs=2e-3)


def test_fast_hops_are_not_taken_for_white_noise():
    """They are louder than the noise up to the top of the band."""
    rng, n, dwell, ratios = np.random.default_rng(39), 2048, 0.6, []
    chance = -0.5 * np.expm1(-2 / (RATE * dwell))
    for _ in range(40):
        level = 1.5 * np.where(np.cumsum(rng.random(n) < chance) % 2, 1.0, -1.0)
        view = view_of(level + 0.5 * rng.standard_normal(n))
        for found in random_telegraph.RandomTelegraph.propose(view):
            ratios.append(found.effect.dwell.value / dwell)
    assert len(ratios) == 40
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)


def test_noise_that_follows_loud_samples_follows_by_as_much_as_is_said():
    """Samples that are loud because the source is were cut as outliers: a tenth was missed."""
    rng, n, share, found = np.random.default_rng(40), 3120, 0.3, []
    for _ in range(80):
        motion = np.repeat(np.exp(rng.normal(0, 0.8, 49)), 64)[:n] * rng.standard_normal(n)
        power = motion**2 / np.mean(motion**2)
        rows = np.sqrt(1 + share * (power - 1)) * rng.standard_normal(n)
        view = view_of(rows, 8 * motion + rng.standard_normal(n))
        for candidate in amplitude_coupling.AmplitudeCoupling.propose(view):
            found.append(candidate.effect.share.value)
    assert len(found) == 80
    assert np.mean(found) == pytest.approx(share, abs=0.012)


@pytest.mark.parametrize("at_once", [True, False])
def test_noise_follows_each_sample_or_the_loudness(at_once):
    rng, n, share, found = np.random.default_rng(46), 3120, 0.25, []
    for _ in range(40):
        loud = np.repeat(np.exp(rng.normal(0, 0.8, 195)), 16)[:n]
        motion = loud * rng.standard_normal(n)
        follows = motion if at_once else loud
        power = follows**2 / np.mean(follows**2)
        rows = np.sqrt(1 + share * (power - 1)) * rng.standard_normal(n)
        view = view_of(rows, 8 * motion + rng.standard_normal(n))
        found += [c.effect for c in amplitude_coupling.AmplitudeCoupling.propose(view)]
    assert len(found) > 35
    assert sum(one.at_once == at_once for one in found) >= 0.95 * len(found)
    shares = [one.share.value for one in found]
    assert np.mean(shares) == pytest.approx(share, abs=0.02)


def test_what_an_axis_shares_with_another_makes_no_noise_that_follows():
    """It is loud in the same samples, whatever the filter between them; nothing else is."""
    rng, n = np.random.default_rng(47), 12_000
    for _ in range(8):
        motion = np.repeat(np.exp(rng.normal(0, 0.5, n // 500)), 500) * rng.standard_normal(n)
        leak = 0.15 * motion + 0.1 * np.roll(motion, 1)
        view = view_of(leak + rng.standard_normal(n), 8 * motion + rng.standard_normal(n))
        found = amplitude_coupling.AmplitudeCoupling.propose(view)
        assert not any(candidate.excess > 0 for candidate in found)


def test_knocks_that_shake_two_axes_make_no_noise_that_follows_sample_by_sample():
    rng, n = np.random.default_rng(48), 12_000
    for _ in range(8):
        knocks = np.where(rng.random((n, 1)) < 3e-3, 12.0, 1.0)
        rows = knocks * rng.standard_normal((n, 2))
        view = view_of(rows[:, 0], 8 * np.where(knocks[:, 0] > 1, 4, 1) * rows[:, 1])
        found = amplitude_coupling.AmplitudeCoupling.propose(view)
        assert not any(one.effect.at_once for one in found)


def test_a_share_is_known_as_well_as_the_tails_of_what_follows_allow():
    """Loud blocks tell it, and scatter more: without that the error is an eighth too small."""
    rng, rows, share, shares, errors = np.random.default_rng(44), 16, 0.6, [], []
    loud = np.where(np.arange(200) % 8 == 0, 6.0, 0.6)[:, np.newaxis]
    everywhere = np.ones(200, bool)
    for _ in range(300):
        motion = loud * rng.standard_normal((200, rows)) ** 2
        noise = (1 + share * (motion / loud.mean() - 1)) * rng.standard_normal((200, rows)) ** 2
        power, q = noise.mean(axis=1), motion.mean(axis=1)
        known = ("gy", False), False, rows, everywhere, power, q, q.mean()
        found = amplitude_coupling._Powers(*known).estimate
        shares.append(found.value)
        errors.append(found.error)
    assert np.std(shares) == pytest.approx(np.median(errors), rel=0.12)


def test_noise_that_follows_an_axis_is_taken_out_as_that_axis_moves_whatever_another_does():
    rng, n = np.random.default_rng(42), 3120
    motion = np.repeat(np.exp(rng.normal(0, 0.8, 49)), 64)[:n] * rng.standard_normal(n)
    rows = np.sqrt(0.4 + 0.6 * motion**2 / np.mean(motion**2)) * rng.standard_normal(n)
    source = 8 * motion + rng.standard_normal(n)
    kind = amplitude_coupling.AmplitudeCoupling
    (alone,) = kind.propose(view_of(rows, source))
    (beside,) = kind.propose(view_of(rows, source, rng.standard_normal(n)))
    assert beside.effect == alone.effect
    np.testing.assert_array_equal(beside.signal, alone.signal)


def test_ends_of_a_gauss_markov_process_are_where_all_else_refitted_does_as_badly():
    """Along a straight line on which its time goes with sigma they came out too close."""
    rng, n, fallen = np.random.default_rng(41), 2048, []
    keep = np.exp(-1 / (RATE * 3.0))
    for _ in range(10):
        drive = np.sqrt(1 - keep**2) * rng.standard_normal(n + 500)
        view = view_of(lfilter([1.0], [1.0, -keep], drive)[500:] + rng.standard_normal(n))
        found = gauss_markov._candidate(view, 0.3, 30.0).finished()
        best = view.spectrum.loglik + found.gain
        start = view.spectrum.powers
        for end in (found.effect.sigma.lower, found.effect.sigma.upper):
            times = np.geomspace(0.2, 60.0, 60)
            process = (gauss_markov.Process(1.0, float(tc)) for tc in times)
            profile = [gauss_markov.loglik_beside(view, end**2, one, start) for one in process]
            fallen.append(best - max(profile))
        for end in (found.effect.correlation_time.lower, found.effect.correlation_time.upper):
            fallen.append(best - view.loglik_with(gauss_markov.Process(1.0, end)))
    assert np.allclose(fallen, 1.92, atol=0.1)


def test_what_swings_slowly_and_loudly_leaves_a_process_ends():
    """The refits fell into another maximum of the powers, and no end was found: an error."""
    n = 4096
    f = np.arange(1, n) / n * RATE / 2
    power = 1 + 1e5 / (1 + ((f - 0.3) / 0.05) ** 2)
    for seed in range(5):
        ordinates = np.random.default_rng(seed).normal(size=n - 1) * np.sqrt(power)
        view = view_of(idct(np.append(0.0, ordinates), norm="ortho"))
        found = gauss_markov._candidate(view, 0.3, 3.0).finished().effect
        for one in (found.sigma, found.correlation_time):
            assert one.lower < one.value < one.upper


def test_sigma_of_a_gauss_markov_process_has_the_interval_of_its_likelihood():
    """Flicker and a random walk can only grow and take from it: its likelihood is no parabola.

    The likeliest sigma is therefore too small more often than not, by a quarter of its error.
    """
    rng, n, ranks = np.random.default_rng(27), 2048, []
    for _ in range(150):
        tc, sigma = rng.uniform(0.5, 2.0), rng.uniform(0.5, 1.0)
        keep = np.exp(-1 / (RATE * tc))
        drive = sigma * np.sqrt(1 - keep**2) * rng.standard_normal(n + 500)
        process = lfilter([1.0], [1.0, -keep], drive)[500:]
        view = view_of(process + rng.standard_normal(n))
        found = gauss_markov._candidate(view, tc / 10, tc * 10).finished().effect
        ranks.append(rank(found.sigma, sigma))
    assert_apt(ranks, leaning=0.16)


def test_numbers_of_a_power_law_have_the_intervals_of_their_likelihoods():
    """White noise is often 0 beside it and can only grow: curvature takes it for known."""
    rng, n, fallen, held, allowed = np.random.default_rng(33), 4096, [], [], []
    f = np.arange(1, n) / n * RATE / 2
    for _ in range(12):
        exponent = rng.uniform(0.3, 0.5)
        power = RATE * (RATE / np.pi * np.sin(np.pi * f / RATE)) ** -exponent
        path = idct(np.append(0.0, rng.normal(size=n - 1) * np.sqrt(power)), norm="ortho")
        view = view_of(path)
        found = power_law._candidate(view, exponent - 0.2, exponent + 0.2).finished().effect
        best = view.loglik_with(power_law.Process(1.0, found.exponent.value))
        allowed.append(power_law._allowed(view, found.exponent.value))
        for end in (found.exponent.lower, found.exponent.upper):
            ended = best - view.loglik_with(power_law.Process(1.0, end))
            fallen.append(ended - allowed[-1])
        held.append(found.density.lower <= 1.0 <= found.density.upper)
    assert np.allclose(fallen, 0.0, atol=0.5)
    assert 0.9 < np.mean(allowed) < 1.6  # chi-square would allow 1.92
    assert np.mean(held) > 0.8


def test_what_leaks_in_is_no_noise_of_the_axis():
    """Where the source is a slow tilt, the leak is louder there than the noise of the axis."""
    rng, n, slope, away = np.random.default_rng(29), 2048, 0.2, []
    keep = np.exp(-1 / (RATE * 5.0))
    for _ in range(250):
        tilt = lfilter([1.0], [1.0, -keep], 3 * np.sqrt(1 - keep**2) * rng.standard_normal(n))
        source = tilt + 0.3 * rng.standard_normal(n)
        view = view_of(rng.standard_normal(n) + slope * source, source)
        found = cross_coupling._candidate(view, "gy", cross_coupling._Own.of(view)).effect
        away.append((found.slope.value - slope) / found.slope.error)
    assert abs(np.std(away) - 1.0) < 0.14  # 3 standard errors; 0.77 with the leak as noise
    assert abs(np.mean(away)) < 0.2


def test_the_bandwidth_of_a_drifting_line_is_known_as_the_record_resolves_it():
    """Its frequency swings, its amplitude swells; nine tenths of the time it is within a width."""
    rng, n, ranks = np.random.default_rng(30), 3120, []
    t, seconds = np.arange(n) / RATE, n / RATE
    for _ in range(150):
        f, reach, start = rng.uniform(1.0, 5.0), rng.uniform(3.0, 8.0) / seconds, rng.random()
        swing = 2 * np.pi * (t / seconds + start)
        tone = np.sin(2 * np.pi * f * t - reach * seconds * np.cos(swing) + rng.uniform(0, 6))
        swell = 1 + 0.3 * np.sin(2 * np.pi * (1.5 * t / seconds + rng.random()))
        view = view_of(rng.uniform(0.4, 1.0) * swell * tone + rng.standard_normal(n))
        low, high = np.quantile(f + reach * np.sin(swing), [0.05, 0.95])
        around = drifting_line.clusters(view, f - 3 * reach, f + 3 * reach)
        cluster = max(around, key=lambda c: drifting_line.excess(view, c))
        found = drifting_line.drifting_line(view, cluster, Candidate(None, 0.0, 0.0))
        if found is not None:
            ranks.append(rank(found.effect.bandwidth, high - low))
    assert len(ranks) > 100
    assert_apt(ranks)


def test_a_faint_low_pass_of_another_family_holds_the_cutoff_of_the_true_one():
    """Of one pole, a filter without aliases is as likely whose cutoff is half as high again."""
    rng, n, held = np.random.default_rng(33), 3120, []
    for _ in range(60):
        cutoff = RATE * rng.uniform(0.3, 0.4)
        keep = np.exp(-2 * np.pi * cutoff / RATE)
        rows = lfilter([1 - keep], [1.0, -keep], rng.standard_normal(n))
        for found in band_limit.BandLimit.propose(view_of(rows)):
            known = found.effect.cutoff
            if found.effect.response != "OnePole":
                held.append(known.lower < cutoff < known.upper)
    assert len(held) >= 5
    assert all(held)


def test_the_corner_of_a_high_pass_has_the_interval_of_its_likelihood():
    """A first order, with a dozen or more ordinates below."""
    rng, n, ranks = np.random.default_rng(32), 3120, []
    for _ in range(60):
        corner = np.exp(rng.uniform(np.log(0.06), np.log(0.2)))
        keep = np.exp(-2 * np.pi * corner / RATE)
        rows = rng.standard_normal(n)
        rows = rows - lfilter([1 - keep], [1.0, -keep], rows)
        for found in high_pass.HighPass.propose(view_of(rows)):
            ranks.append(rank(found.effect.corner, corner))
    assert len(ranks) > 40
    assert chance(ranks) > 0.05
    assert np.mean(np.abs(np.array(ranks) - 0.5) < 0.475) > 0.88
