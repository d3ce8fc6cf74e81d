"""Is a tone one tone, and a band noise."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects.drifting_line import Cluster, DriftingLine, clusters, profile_of
from allanscope.explain.effects.random_telegraph import _candidate as telegraph
from allanscope.explain.effects.sinusoid import Sinusoid, sidebands
from allanscope.explain.effects.unexplained import Unexplained
from allanscope.explain.moves.resolve_tones import _is_tail, _without_level_ends
from allanscope.explain.series import series_of
from allanscope.explain.stationarity import PowerInParts, bartlett_z, constancy, sweeps
from allanscope.explain.view import View
from allanscope.history import Record
from support.thinned import RATE, thinned


def _noise_and(tone: np.ndarray) -> np.ndarray:
    return np.random.default_rng(4).normal(size=len(tone)) + tone


def test_a_chirp_through_a_broad_band_is_unsteady_and_noise_in_it_is_not():
    rate, n = 104.0, 187_200
    t = np.arange(n) / rate
    chirp = 0.25 * np.sin(2 * np.pi * (5 * t + 5 / t[-1] * t**2))
    low = 2 * np.exp(-np.pi * 10 / rate) * np.cos(2 * np.pi * 10 / rate)
    band = lfilter([1.0], [1.0, -low, np.exp(-2 * np.pi * 10 / rate)],
                   np.random.default_rng(5).normal(size=n))  # fmt: skip
    assert bartlett_z(PowerInParts.of(_noise_and(chirp), rate), 10.0, 8.0) > 15
    assert abs(bartlett_z(PowerInParts.of(_noise_and(band), rate), 10.0, 8.0)) < 4


def line(frequency):
    return Sinusoid(Estimate.of(frequency, 1e-5, "Hz"), Estimate.of(1e-3, 1e-4, "dps"))


def test_sidebands_are_told_from_the_odd_harmonics_of_a_square_wave():
    modulated = [line(f) for f in (8.9975, 9.0, 9.0025)]
    assert sidebands(modulated) == tuple(modulated)
    assert sidebands([line(f) for f in (0.2, 1.4, 1.8, 2.2)]) == ()


def test_a_line_of_few_waves_is_taken_to_be_one():
    rate, n = 10.0, 36_000
    t = np.arange(n) / rate
    walk = np.cumsum(np.random.default_rng(6).normal(0, 0.02, n))
    few, growing = np.sin(2 * np.pi * 5 * t / t[-1]), t / t[-1] * np.sin(2 * np.pi * t)
    assert constancy(_noise_and(few) + walk, rate, 5 / t[-1]) == 1.0
    assert constancy(_noise_and(growing), rate, 1.0) < 1e-5
    assert not sweeps(PowerInParts.of(100 * np.sin(2 * np.pi * t), rate), 1.0, 0.05)


@pytest.mark.parametrize("where", [0.3, 0.6, 0.9])
def test_the_profile_of_a_cluster_keeps_a_line_at_its_frequency(where):
    n, rate, width = 4115, 52.0, 737  # no multiple of its sub-bands
    first = 3300
    at = first + int(where * width)
    squares = np.ones(n - 1)
    squares[at] += 500.0
    view = SimpleNamespace(
        grid=SimpleNamespace(n=n, rate_hz=rate), squares=squares,
        spectrum=SimpleNamespace(ordinates=np.ones(n - 1)),
    )  # fmt: skip
    profile, _ = profile_of(view, Cluster(first, first + width))
    each = (profile.high - profile.low) / len(profile.shares)
    centres = profile.low + each * (np.arange(len(profile.shares)) + 0.5)
    assert np.average(centres, weights=profile.shares) == pytest.approx(
        (at + 1) * rate / (2 * n), abs=each / 2
    )
    assert profile.sigma**2 * n == pytest.approx(500.0)


@pytest.mark.parametrize(
    ("gain", "low", "high", "is_tail"),
    [
        (11.0, 36.30, 36.34, True),  # beside a strong line, within its bandwidth
        (11.0, 33.10, 33.20, False),  # far from it
        (200.0, 36.30, 36.34, False),  # too much for a tail
        (5.0, 33.10, 33.20, True),  # nothing
    ],
)
def test_what_is_beside_a_drifting_line_is_its_tail_where_it_is_faint(gain, low, high, is_tail):
    line = DriftingLine(
        Estimate.of(37.0, 0.01, "Hz"), Estimate.of_log(1.0, 0.01, "Hz"),
        Estimate.of_log(7e-3, 0.01, "dps"), 36.9, 37.1, 6e-3, 8e-3,
    )  # fmt: skip
    power = Unexplained(Estimate(low, unit="Hz"), Estimate(high, unit="Hz"), "spectrum", "", {})
    part = Candidate(power, gain, excluded=((low, high),))
    assert _is_tail(part, [Candidate(line, 3500.0)]) == is_tail


def test_loud_tones_that_beat_are_on_two_sides_too_but_hops_have_another_spectrum():
    rng, rows = np.random.default_rng(16), 60_000

    def phase(hz):
        wander = 0.18 * lfilter([5e-4], [1, -0.9995], rng.normal(0, 30, rows))
        return 2 * np.pi * np.cumsum(hz + wander) / RATE

    one, other = phase(9.6), phase(9.96)
    motors = np.sin(one) + 0.4 * np.sin(2 * one + 1) + 0.1 * np.sin(3 * one) + np.sin(other + 1)
    hops = 2.0 * (np.cumsum(rng.random(rows) < 0.2) % 2) - 1.0
    for signal, is_one in ((motors, False), (hops, True)):
        record = thinned((rng.normal(0, 0.08, rows) + 0.18 * signal)[:, np.newaxis])
        view = View.of(series_of(record), "gx")
        found = telegraph(view, 0.2, 0.0625)
        assert found is not None
        assert (found.effect.adequate(view, found) is not None) == is_one


@pytest.mark.parametrize("turns", [0.0, 0.05, 0.6])
def test_a_line_at_nyquist_has_the_amplitude_of_its_samples(turns):
    # The two converters of an interleaved pair differ: the sign alternates from sample to sample.
    n, rate, size = 60_000, 100.0, 0.01
    k = np.arange(n)
    spur = size * (-1.0) ** k * np.cos(2 * np.pi * turns * k / n)
    samples = np.random.default_rng(8).normal(0, 0.04, n) + spur
    record = Record(
        rate_hz=rate, stride=1, axes=("gx",), values=samples[:, np.newaxis], lsb=(1e-7,),
        temperature_c=np.full(n, np.nan), start_s=k / rate, segments=np.array([[0, n]]),
    )  # fmt: skip
    view = View.of(series_of(record), "gx")
    found = max(Sinusoid.propose(view), key=lambda c: c.gain)
    error = found.effect.amplitude.error
    assert found.effect.amplitude.value == pytest.approx(size, abs=max(4 * error, 0.1 * size))
    assert error < 0.1 * size
    assert found.effect.frequency.value == pytest.approx(50.0, abs=1 / (n / rate))
    left = samples - found.signal
    assert np.var(left) == pytest.approx(0.04**2, rel=0.02)
    assert found.effect.hold_out(view, found).nats > 0.5 * found.gain


def test_a_slow_line_of_a_short_record_is_not_many_that_overlap(bench):
    """Its ordinates lie side by side, and a fiftieth of its frequency is none of them."""
    b = bench(620, 20.0)
    wander = np.cumsum(b.rng.normal(0, 0.25, len(b.t)) / 52.0**0.5) * 2 * np.pi
    tone = 0.3 * np.sin(2 * np.pi * 0.9 * b.t + wander)
    view = View.of(series_of(b.record(b.noise() + tone)), "gx").without_range(0.2, 2.0)
    found = clusters(view, 0.3, 1.8)
    assert 1 <= len(found) <= 2
    assert all(one.stop <= other.first for one, other in pairwise(found))


def test_a_range_that_was_left_out_too_wide_ends_with_what_is_in_it():
    """Unless what is beyond is no noise."""
    rate, n = 100.0, 20_000
    rng = np.random.default_rng(6)
    t = np.arange(n) / rate
    record = Record(
        rate_hz=rate,
        stride=1,
        axes=("gx",),
        values=(rng.normal(size=n) + np.sin(2 * np.pi * 12 * t))[:, np.newaxis],
        lsb=(1e-9,),
        temperature_c=np.full(n, np.nan),
        start_s=t,
        segments=np.array([[0, n]], np.int64),
    )
    view = View.of(series_of(record), "gx")
    wide = Cluster(round(9 * 2 * n / rate), round(16 * 2 * n / rate))
    parts = clusters(view, 9.0, 16.0)
    assert len(parts) == 1
    assert _without_level_ends(view, wide, parts) == parts[0]
    part = Cluster(parts[0].first + 2, parts[0].first + 4)
    assert _without_level_ends(view, wide, [part]) == wide
