"""What has no name is reported as such, and what cannot be searched says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.signal import butter, lfilter

from allanscope.explain import Budget, LiveLoop, explain
from allanscope.explain.effects import KINDS
from allanscope.explain.effects.unexplained import DEGREE, _extent, _polynomials
from allanscope.explain.residual import band_scores
from allanscope.explain.series import series_of
from allanscope.explain.view import View
from allanscope.history import Record
from allanscope.spectrum import Density

RATE, SIGMA = 52.0, 4e-3 * 52.0**0.5


def kinds(record):
    return [e.kind for e in explain(record).axes["gx"].effects]


@pytest.mark.parametrize(("rows", "first"), [(64, 63), (101, 50), (60_000, 900)])
def test_ordinates_of_polynomials_are_those_of_a_transform(rows, first):
    x = np.linspace(-1, 1, rows)
    for degree, found in enumerate(_polynomials(rows, first), 1):
        whole = dct(np.polynomial.Legendre.basis(degree)(x), norm="ortho")
        rounding = 1e-10 * np.sqrt(rows)  # what is small there is the difference of large numbers
        np.testing.assert_allclose(found, whole[1 : first + 1], rtol=0, atol=rounding)
    assert degree == DEGREE


def test_a_chirp_has_no_name(bench):
    b = bench(31)
    sweep = 0.5 * SIGMA * np.sin(2 * np.pi * (4 * b.t + 0.5 * b.t**2 / b.t[-1]))
    assert set(kinds(b.record(b.noise() + sweep))) == {"unexplained"}


def test_a_modulated_tone_is_a_line_that_drifts(bench):
    b = bench(32)
    envelope = 1 + 0.9 * np.sin(2 * np.pi * 3 * b.t / b.t[-1])
    tone = 0.02 * envelope * np.sin(2 * np.pi * 9.0 * b.t)
    assert set(kinds(b.record(b.noise() + tone))) == {"drifting_line"}


def test_heavy_tails_are_neither_outliers_nor_a_burst(bench):
    b = bench(33)
    record = b.record(b.noise() + SIGMA * b.rng.standard_t(4.5, len(b.t)))
    result = explain(record).axes["gx"]
    assert [e.kind for e in result.effects] == ["unexplained"]
    assert result.effects[0].evidence["excess_kurtosis"] > 0.1
    assert not result.explained


def test_tails_that_change_nothing_are_not_told_however_long_the_record(bench):
    """Half a million rows show an excess kurtosis of 0.06, by which no number is another."""
    b = bench(61, 9600.0)
    white = b.rng.standard_t(100, len(b.t)) * np.std(b.noise())
    assert explain(b.record(white)).axes["gx"].explained
    heavy = b.rng.standard_t(25, len(b.t)) * np.std(b.noise())
    assert [e.kind for e in explain(b.record(heavy)).axes["gx"].effects] == ["unexplained"]


def test_heavy_tails_say_how_much_of_the_noise_is_their_core(bench):
    """Half of the samples eight times as loud as the others: the deviation is not that of most."""
    b = bench(34)
    loud = b.rng.random(len(b.t)) < 0.5
    samples = SIGMA * b.rng.normal(size=len(b.t)) * np.where(loud, 8.0, 1.0)
    (found,) = (e for e in explain(b.record(samples)).axes["gx"].effects if not e.traits.is_named)
    core = np.ptp(np.quantile(samples, (0.25, 0.75))) / 1.349 / samples.std()
    assert found.evidence["core_ratio"] == pytest.approx(core, rel=0.02)
    assert f"its core has {core:.2g} times the noise" in found.evidence["words"]


@pytest.mark.parametrize("tails", [True, False])
def test_heavy_tails_are_seen_beside_a_change_of_the_noise_level(bench, tails):
    """Louder noise has a kurtosis of its own; heavy tails have one at each level."""
    b = bench(37, 1200.0)
    noise = b.noise()
    noise[len(noise) // 2 : 3 * len(noise) // 4] *= 1.4
    if tails:
        noise += 0.7 * SIGMA * b.rng.standard_t(3, len(noise))
    found = explain(b.record(noise)).axes["gx"].effects
    assert {e.kind for e in found} == (
        {"variance_change", "unexplained"} if tails else {"variance_change"}
    )
    if tails:
        (left,) = (e for e in found if e.kind == "unexplained")
        assert left.evidence["excess_kurtosis"] > 0.3


def test_noise_that_is_louder_for_a_while_has_no_bands_without_a_name(bench):
    """Its ordinates are alike for tens of them, and bands of few of them scatter as much."""
    loud = 0
    for seed in range(6):
        b = bench(38 + seed, 400.0)
        noise = b.rng.normal(0, SIGMA, len(b.t))
        noise[int(0.45 * len(noise)) : int(0.55 * len(noise))] *= 6
        view = View.of(series_of(b.record(noise)), "gx")
        loud += int(np.sum(np.abs(band_scores(view).z) > 3.5))
    assert loud <= 2
    band = lfilter(*butter(2, [8, 9], "band", fs=RATE), b.rng.normal(0, 0.15 * SIGMA, len(b.t)))
    view = View.of(series_of(b.record(noise + 20 * band)), "gx")
    assert band_scores(view).z.max() > 5


@pytest.mark.parametrize("seed", [10, 15, 0])
def test_noise_that_is_louder_for_a_while_is_nothing_else(seed):
    """Neither steps that pass together, each as loud as the noise there, nor a low-pass."""
    n, rate = 20_000, 100.0
    noise = np.random.default_rng([seed, n, 6]).normal(size=n) * 0.04
    noise[int(0.45 * n) : int(0.55 * n)] *= 6
    record = Record(
        rate_hz=rate,
        stride=1,
        axes=("gx",),
        values=noise[:, np.newaxis],
        lsb=(1e-9,),
        temperature_c=np.full(n, np.nan),
        start_s=np.arange(n) / rate,
        segments=np.array([[0, n]], np.int64),
    )
    assert kinds(record) == ["variance_change"]


def test_a_slow_wave_is_neither_warm_up_nor_ramp(bench):
    b = bench(34)
    wave = 0.05 * np.sin(2 * np.pi * b.t / (1.1 * b.t[-1]) + 2)
    assert set(kinds(b.record(b.noise() + wave))) == {"unexplained"}


def test_a_constant_channel_is_named_as_what_it_is(bench):
    b = bench(35)
    result = explain(b.record(np.full(len(b.t), 1.0), b.noise())).axes
    assert "constant" in result["gx"].remarks[0]
    assert result["gx"].effects == ()
    assert result["gy"].explained


def test_a_short_record_says_how_much_longer(bench):
    b = bench(36, 20.0)
    result = explain(b.record(b.noise())).axes["gx"]
    assert result.hindrance == result.remarks[0]
    assert "20 s of the 39 s needed" in result.hindrance


def test_a_saturated_axis_is_named_as_what_it_is(bench):
    b = bench(37)
    data = np.clip(b.noise() + 32767 * 4.375e-3 - 0.05, None, 32767 * 4.375e-3)
    assert any("saturated" in r for r in explain(b.record(data)).axes["gx"].remarks)


def test_a_temperature_of_zero_is_no_temperature(bench):
    b = bench(38)
    record = b.record(b.noise(), temperature=np.zeros(len(b.t)))
    assert any("no sensor" in r for r in explain(record).axes["gx"].remarks)


def test_a_gap_is_bridged_without_an_effect(bench):
    b = bench(39)
    record = b.record(b.noise())
    keep = np.ones(len(b.t), bool)
    keep[20000:20300] = False
    holed = replace(
        record,
        values=record.values[keep],
        temperature_c=record.temperature_c[keep],
        start_s=record.start_s[keep],
        segments=np.array([[0, 20000], [20000, keep.sum()]]),
    )
    result = explain(holed).axes["gx"]
    assert result.effects == ()
    assert any("missing" in r for r in result.remarks)


def test_values_that_are_not_finite_are_refused(bench):
    b = bench(40)
    record = b.record(b.noise())
    record.values[5] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        explain(record)


def test_the_live_loop_looks_at_doubling_times_and_announces_once(bench):
    b = bench(41)
    whole = b.record(b.noise() + 0.01 * np.sin(2 * np.pi * 5 * b.t))
    loop = LiveLoop(first_s=300.0)
    announced, searches = [], 0
    for seconds in range(100, 1200, 100):
        n = int(seconds * RATE)
        part = replace(
            whole,
            values=whole.values[:n],
            temperature_c=whole.temperature_c[:n],
            start_s=whole.start_s[:n],
            segments=np.array([[0, n]]),
        )
        searches += loop.due(part)
        announced += loop.update(part)
    assert loop.searches == searches == 2
    (finding,) = announced
    assert (finding.axes, finding.effect.kind, finding.at_s) == (("gx",), "sinusoid", 300.0)
    assert finding.after.rms_percent < finding.before.rms_percent
    assert finding.words.startswith("gx: a line at 4.9999")
    assert loop.findings == (finding,)


def test_the_live_loop_announces_what_two_axes_share_once(bench):
    b = bench(43, 400.0)
    hum = 0.02 * np.sin(2 * np.pi * 11.0 * b.t)
    (finding,) = LiveLoop(first_s=300.0).update(b.record(b.noise() + hum, b.noise() + hum))
    assert finding.axes == ("gx", "gy")


def test_every_kind_declares_what_it_is():
    for name, kind in KINDS.items():
        assert kind.kind == name
        assert kind.meaning
        assert kind.needs <= {"samples", "temperature", "axes", "clock"}
        assert set(kind.confused_with) | kind.excluded_by <= set(KINDS)


def test_a_long_run_of_block_means_still_sees_a_line_in_the_streaming_spectrum(bench):
    b = bench(42)
    stride = 4
    data = b.noise() + 0.01 * np.sin(2 * np.pi * 17.0 * b.t)
    whole = b.record(data)
    rows = whole.values.reshape(-1, stride, 1).mean(axis=1)
    means = replace(
        whole,
        rate_hz=RATE / stride,
        stride=stride,
        values=rows,
        temperature_c=np.full(len(rows), np.nan),
        start_s=whole.start_s[::stride],
        segments=np.array([[0, len(rows)]]),
    )
    size = 1024
    parts = whole.values[: len(data) // size * size, 0].reshape(-1, size)
    parts = (parts - parts.mean()) * np.hanning(size)
    density = (
        2
        * np.mean(np.abs(np.fft.rfft(parts)) ** 2, axis=0)
        / (np.sum(np.hanning(size) ** 2) * RATE)
    )
    f = np.arange(len(density)) * RATE / size
    widths = np.full(len(f), RATE / size)
    averages = np.full(len(f), float(len(parts)))
    found = explain(means, {"gx": Density(f[1:], widths[1:], density[1:], averages[1:])}).axes["gx"]
    (effect,) = found.effects
    assert effect.kind == "sinusoid"
    assert effect.parameters["frequency"].value == pytest.approx(17.0, abs=1e-3)
    assert effect.parameters["amplitude"].value == pytest.approx(0.01, rel=0.1)
    assert any("means of 4 samples" in remark for remark in found.remarks)


def test_a_relaxation_that_is_no_exponential_is_no_warm_up(bench):
    b = bench(5)
    found = explain(b.record(b.noise() + 0.4 * np.log1p(b.t / 10))).axes["gx"].effects
    assert {e.kind for e in found} == {"unexplained"}


def test_a_slow_chirp_does_not_hop(bench):
    b = bench(10)
    sweep = 0.03 * np.sin(2 * np.pi * (0.2 * b.t + 0.01 * b.t**2 / b.t[-1]))
    hops_only = Budget(kinds=frozenset({"random_telegraph"}))
    assert explain(b.record(b.noise() + sweep), budget=hops_only).axes["gx"].effects == ()


@pytest.mark.parametrize("size", [50_000, 1_000_000])
def test_a_tone_ends_where_the_model_misses_little(size: int) -> None:
    """The more ordinates, the less is an error of the model by chance; it is no tone for that."""
    squares = 1.09 * np.random.default_rng(8).chisquare(1, size)
    tone = slice(int(0.20 * size), int(0.21 * size))
    squares[tone] *= 8
    low, high = _extent(squares, 0.204 * size, 0.206 * size, 1.0)
    assert 0.18 * size < low <= tone.start + 1
    assert tone.stop <= high < 0.24 * size
