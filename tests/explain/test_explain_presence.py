"""What is there in a part of the record only, is said to be: a compressor, people who walk by."""

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.explain.effects.drifting_line import _predicted
from allanscope.explain.presence import Presence, presence_of
from allanscope.explain.series import series_of
from allanscope.explain.view import View
from allanscope.history import Record

RATE, N = 100.0, 60_000
times = np.arange(N) / RATE


def record_of(*columns: np.ndarray, rate: float = RATE) -> Record:
    n, axes = len(columns[0]), ("gx", "gy", "gz")[: len(columns)]
    return Record(
        rate_hz=rate, stride=1, axes=axes, values=np.stack(columns, 1), lsb=(1e-7,) * len(axes),
        temperature_c=np.full(n, np.nan), start_s=np.arange(n) / rate, segments=np.array([[0, n]]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("amplitude", "seconds"), [(0.02, 30.0), (0.006, 120.0), (0.02, 120.0), (0.05, 30.0)]
)
def test_a_tone_that_is_switched_on_for_a_while_is_a_line_with_its_time(amplitude, seconds):
    """It had no name, while one that wanders over half a hertz beside had one."""
    on = (times > 210) & (times < 210 + seconds)
    tone = amplitude * on * np.sin(2 * np.pi * 12.3 * times)
    samples = np.random.default_rng(3).normal(0, 0.04, N) + tone
    (found,) = explain(record_of(samples)).axes["gx"].effects
    assert found.kind == "drifting_line"
    assert found.parameters["frequency"].value == pytest.approx(12.3, abs=0.02)
    spans = found.evidence["present"]
    within = max(0.1 * seconds, 10.0)
    assert spans[0][0] == pytest.approx(210.0, abs=within)
    assert spans[-1][1] == pytest.approx(210.0 + seconds, abs=within)
    then = found.parameters["sigma"].value / np.sqrt(found.evidence["share_of_time"])
    assert then == pytest.approx(amplitude / np.sqrt(2), rel=0.2)
    assert "s to" in found.evidence["words"]


def test_what_has_no_name_is_told_with_its_time_where_it_is_loud_for_a_while():
    rng = np.random.default_rng(5)
    walks = sum(((times > s) & (times < s + 15)).astype(float) for s in (100, 420))
    ring = np.convolve(rng.normal(size=N), np.sinc(np.arange(-40, 41) / 8) * np.hanning(81), "same")
    ring *= 0.1 * walks * np.sin(2 * np.pi * 15 * times)
    samples = rng.normal(0, 0.04, N) + ring
    view = View.of(series_of(record_of(samples)), "gx")
    there = presence_of(view, 10.0, 20.0)
    assert there.share == pytest.approx(0.05, abs=0.015)
    assert [round(first, -1) for first, _ in there.spans] == [100, 420]
    assert [round(last, -1) for _, last in there.spans] == pytest.approx([115, 435], abs=6)
    words = " ".join(
        one.evidence["words"] for one in explain(record_of(samples)).axes["gx"].effects
    )
    assert "% of the record" in words or "shock" in words or "white noise is" in words


def test_noise_in_a_band_and_a_steady_line_are_there_all_along():
    rng = np.random.default_rng(6)
    steady = rng.normal(0, 0.04, N) + 0.02 * np.sin(2 * np.pi * 12.3 * times)
    slow = np.repeat(rng.normal(0, 0.03, (2, N // 1000)), 1000, axis=1)  # 10 s
    band = rng.normal(0, 0.04, N) + slow[0] * np.cos(80 * times) + slow[1] * np.sin(80 * times)
    for samples, low, high in ((steady, 12.2, 12.4), (band, 12.5, 13.0)):
        view = View.of(series_of(record_of(samples)), "gx")
        assert presence_of(view, low, high) is None


def test_less_power_than_the_noise_has_is_nowhere():
    samples = np.random.default_rng(7).normal(0, 0.04, N)
    spectrum = np.fft.rfft(samples)
    spectrum[6000:7000] *= 0.5  # 10 to 11.7 Hz
    view = View.of(series_of(record_of(np.fft.irfft(spectrum, N))), "gx")
    assert presence_of(view, 10.2, 11.5) is None


def test_no_part_is_shorter_than_two_waves():
    samples = np.random.default_rng(8).normal(0, 0.04, N)
    samples[30_000:30_020] += 0.5  # a knock of a fifth of a second
    view = View.of(series_of(record_of(samples)), "gx")
    there = presence_of(view, 0.2, 0.3)
    assert there is None or there.longest_s > 2 / 0.25


def test_a_few_waves_are_too_few_for_a_line():
    waves = 0.3 * ((times > 210) & (times < 214)) * np.sin(2 * np.pi * 2.1 * times)
    samples = np.random.default_rng(9).normal(0, 0.04, N) + waves
    view = View.of(series_of(record_of(samples)), "gx")
    assert _predicted(view, 2.1, 0.001, Presence(0.003, ((700.0, 702.0),))) is None


def test_a_line_that_hardly_drifts_is_a_line():
    """Neither a constant nor a predicted amplitude was better, and a line like it had no name."""
    size, rate = 6000, 104.0
    t = np.arange(size) / rate

    def wandering(rng: np.random.Generator) -> np.ndarray:
        k = np.arange(1, 6)
        amplitude = (rng.normal(size=5) + 1j * rng.normal(size=5)) / k
        path = np.real(amplitude @ np.exp(2j * np.pi * np.outer(k, t / t[-1])))
        return np.asarray(path / path.std())

    found = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        columns = [
            rng.normal(0, 0.04, size)
            + 0.02 * (1 + 0.2 * wandering(rng)) * np.sin(2 * np.pi * f * t + 0.15 * wandering(rng))
            for f in (11.3, 23.1, 37.9)
        ]
        axes = explain(record_of(*columns, rate=rate)).axes.values()
        found += [[e.kind for e in axis.effects] for axis in axes]
    assert {kind for (kind,) in found} == {"sinusoid", "drifting_line"}
