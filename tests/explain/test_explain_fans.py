"""Strong tones over vibration, and dips of the level that are no boxes: each is named, once."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects.amplitude_coupling import _Powers
from allanscope.explain.effects.excursion import Excursion
from allanscope.explain.effects.unexplained import _range
from allanscope.explain.effects.variance_change import VarianceChange
from allanscope.history import Record

RATE, N = 52.0, 4e-3


@pytest.fixture(scope="module")
def fans(bench):
    """Two fans whose phases walk, and white noise of which more is above 7 Hz than below."""
    b = bench(511, seconds=120.0)
    n = len(b.t)
    spectrum = np.fft.rfft(b.rng.normal(0, N * RATE**0.5, n))
    f = np.fft.rfftfreq(n, 1 / RATE)
    noise = np.fft.irfft(spectrum * (1 + 2 / (1 + (7.0 / np.maximum(f, 1e-3)) ** 8)), n)
    phases = np.cumsum(b.rng.normal(0, 0.08, (2, n)), axis=1)
    tones = [
        size * np.sin(2 * np.pi * at * b.t + phase)
        for size, at, phase in zip((0.4, 0.7), (15.6, 16.5), phases, strict=True)
    ]
    return explain(b.record(noise + sum(tones), lsb=1e-4)).axes["gx"]


def test_both_fans_are_lines_that_drift(fans):
    lines = [e.parameters for e in fans.effects if e.kind == "drifting_line"]
    found = sorted(line["frequency"].value for line in lines)
    assert found == pytest.approx([15.6, 16.5], abs=0.1)
    sizes = [line["sigma"].value for line in sorted(lines, key=lambda one: one["frequency"].value)]
    assert sizes == pytest.approx([0.4 / 2**0.5, 0.7 / 2**0.5], rel=0.1)


def test_the_ends_of_the_record_are_neither_louder_nor_heavy_tails(fans):
    words = [e.evidence.get("words", "") for e in fans.effects]
    assert not [one for one in words if "tails" in one or "white noise is" in one]


def test_the_error_is_that_of_the_noise_beside_them(fans):
    assert fans.after.chi2_per_dof < 3 < fans.before.chi2_per_dof


def test_a_range_from_the_lowest_frequency_is_below_its_end():
    view = SimpleNamespace(grid=SimpleNamespace(rate_hz=100.0, n=50_000))  # 1 mHz an ordinate
    assert _range(view, 0.0015, 3.94) == "below 3.94"
    assert _range(view, 0.0415, 3.94) == "between 0.0415 and 3.94"


def test_a_jump_that_takes_its_time_is_no_burst_of_noise(bench):
    """A third of a second of other noise was named at its edge, "between 150 s and 150 s"."""
    b = bench(801, seconds=300.0)
    t = np.maximum(b.t - 150.0, 0.0)
    dip = -8 * N * RATE**0.5 * (1 - np.exp(-t / 0.3)) * np.exp(-t / 4)
    found = explain(b.record(b.noise() + dip)).axes["gx"]
    assert [effect.kind for effect in found.effects] == ["relaxation"]


@pytest.mark.parametrize(("gain", "refused"), [(40.0, True), (400.0, False)])
def test_a_second_excursion_from_the_same_instant_must_gain_more_than_the_first(gain, refused):
    """What is left of a dip that is no box gains less; of two boxes the second gains more."""
    first, second, later = (
        Excursion(Estimate(at, unit="s"), Estimate(6.0, unit="s"), Estimate(-4.3e-3, unit="g"))
        for at in (187.0, 187.3, 240.0)
    )
    known = Candidate(first, 59.0)
    assert bool(first.refuses(None, known, Candidate(second, gain))) is refused
    assert not first.refuses(None, known, Candidate(later, gain))


def test_times_are_told_in_the_digits_of_what_they_bound():
    seconds = [Estimate(at, unit="s") for at in (0.0, 0.306, 187.005, 6.41)]
    change = VarianceChange(
        Estimate(1.0), seconds[0], seconds[1], Estimate(1.57), 100, (5.7e-3, 3.6e-3), "g"
    )
    assert "between 0.00 s and 0.31 s" in change.words
    box = Excursion(seconds[2], seconds[3], Estimate(-4.3e-3, unit="g"))
    assert "at 187.0 s and returns after 6.4 s" in box.words


def test_a_low_pass_of_rows_that_were_resampled_is_one():
    """Interpolated from 187.4 to 200 Hz the noise above the cutoff comes and goes every 15 s."""
    rate, n = 200.0, 72_000
    t = np.arange(n) / rate
    spectrum = np.fft.rfft(np.random.default_rng(77).normal(0, 4e-3 * rate**0.5, n))
    f = np.fft.rfftfreq(n, 1 / rate)
    slow = np.fft.irfft(spectrum * (1 + (f / 35) ** 2.4) ** -0.5 / (1 + (f / 50) ** 8) ** 0.5, n)
    fast = np.fft.irfft(spectrum * (1 + (f / 35) ** 2.4) ** -0.5, n) - slow
    values = (slow + fast * np.sqrt(1 + 0.75 * np.sin(2 * np.pi * t / 14.9)))[:, np.newaxis]
    found = explain(
        Record(
            rate_hz=rate, stride=1, axes=("gx",), values=values, lsb=(0.0,),
            temperature_c=np.full(n, np.nan), start_s=t, segments=np.array([[0, n]]),
        )
    ).axes["gx"]  # fmt: skip
    (low_pass,) = (e for e in found.effects if e.kind == "band_limit")
    assert low_pass.parameters["cutoff"].value == pytest.approx(35.0, rel=0.15)
    assert found.coefficients_after["N"].value == pytest.approx(4e-3, rel=0.03)
    assert found.after.chi2_per_dof < 3


def test_silent_blocks_follow_no_other_axis_and_warn_of_nothing():
    quiet = np.r_[np.zeros(20), np.ones(20)]
    gains = _Powers(("gy", False), False, 50, quiet >= 0, quiet, quiet + 0.5, 1.0).gains(0.3)
    assert np.all(np.isfinite(gains))


def test_a_share_is_as_often_above_its_interval_as_below():
    """Of samples that follow at once; one that is as wide to both sides is too low."""
    rng, share, outside = np.random.default_rng(77), 0.1, np.zeros(2, int)
    for _ in range(800):
        q = (np.repeat(np.exp(rng.normal(0, 0.8, 50)), 40) * rng.normal(size=2000)) ** 2
        mean_q = float(q.mean())
        power = (1 + share * (q / mean_q - 1)) * rng.normal(size=2000) ** 2
        tells = q < 8 * mean_q  # the loudest do not, and are as loud all the same
        found = _Powers(("gy", True), True, 40, tells, power[tells], q[tells], mean_q).estimate
        outside += [share < found.lower, share > found.upper]
    assert 7 <= outside.min() <= outside.max() <= 33  # 20 of 800 are expected, 4.4 their deviation


@pytest.mark.parametrize("size", [0.03, 0.08, 0.12])
@pytest.mark.parametrize("seed", [520, 521])
def test_a_fan_that_changes_its_speed_is_a_line_at_each(bench, seed, size):
    """Each was three: the core, and its flanks as lines of their own."""
    b = bench(seed, seconds=3600.0)
    phases = 2 * np.pi * 13.0 * b.t + np.cumsum(b.rng.normal(0, 0.042, len(b.t)))
    phases += 2 * np.pi * 4.3 * np.clip(b.t - 1200.0, 0.0, None)
    tone = size * np.sin(phases) * (b.t < 2400.0)
    found = explain(b.record(b.noise() + tone, lsb=1e-4)).axes["gx"].effects
    lines = sorted(
        (e.parameters for e in found if e.kind == "drifting_line"),
        key=lambda line: line["frequency"].value,
    )
    assert [line["frequency"].value for line in lines] == pytest.approx([13.0, 17.3], abs=0.03)
    sizes = [line["sigma"].value for line in lines]
    assert sizes == pytest.approx([size / 6**0.5] * 2, rel=0.1)
