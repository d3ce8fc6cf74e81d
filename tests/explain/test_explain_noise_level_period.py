"""Noise that is louder at regular times: what a radio or a display beside the sensor does."""

import numpy as np
import pytest

from allanscope.explain import explain
from allanscope.explain.noise_level_period import noise_level_period
from allanscope.history import Record

RATE, N = 208.0, 62_400


def noise_with(bursts: np.ndarray, seed: int = 4) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 1, N) * np.where(bursts, 2.8, 1.0)


@pytest.mark.parametrize(("period", "lasts"), [(1.0007, 0.03), (0.25, 0.02), (9.7, 0.5)])
def test_the_period_of_bursts_is_that_of_the_first_line(period, lasts):
    bursts = np.arange(N) / RATE % period < lasts
    assert noise_level_period(noise_with(bursts), RATE) == pytest.approx(period, rel=1e-3)


def test_bursts_at_random_one_loud_stretch_and_heavy_tails_have_no_period():
    rng = np.random.default_rng(5)
    at_random = np.convolve(rng.random(N) < 1 / 208, np.ones(6), "same") > 0
    once = np.arange(N) // 10_000 == 3
    assert noise_level_period(noise_with(at_random), RATE) is None
    assert noise_level_period(noise_with(once), RATE) is None
    assert noise_level_period(rng.standard_t(4, N), RATE) is None
    assert noise_level_period(np.zeros(100), RATE) is None


@pytest.mark.parametrize("wanders", [0.0, 0.02])
def test_two_lines_that_beat_make_no_noise_louder(wanders):
    """Blades of a fan: lines at the multiples of a speed that is not quite steady."""
    rng = np.random.default_rng(6)
    phase = np.cumsum(rng.normal(0, wanders, N))
    lines = [2.5 * np.cos(2 * np.pi * hz * np.arange(N) / RATE + phase) for hz in (61.7, 63.6)]
    assert noise_level_period(rng.normal(0, 1, N) + sum(lines), RATE) is None


def test_heavy_tails_that_come_regularly_are_said_to():
    bursts = np.arange(N) / RATE % 1.0007 < 0.03
    values = 0.05 * noise_with(bursts)
    record = Record(
        rate_hz=RATE, stride=1, axes=("gx",), values=values[:, np.newaxis], lsb=(1e-7,),
        temperature_c=np.full(N, np.nan), start_s=np.arange(N) / RATE, segments=np.array([[0, N]]),
    )  # fmt: skip
    (found,) = explain(record).axes["gx"].effects
    assert found.kind == "unexplained"
    assert found.evidence["period_s"] == pytest.approx(1.0007, rel=3e-4)
    assert found.evidence["words"].endswith("the noise is louder every 1.001 s")
