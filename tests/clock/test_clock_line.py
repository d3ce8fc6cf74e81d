"""The line itself: errors of its slope under noise that is white, correlated, or beats."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.clock import LineFit
from allanscope.clock.rate import fit_line

ROWS = 200
ONE_SEGMENT = np.zeros(ROWS, np.int64)
INDEX = np.arange(ROWS, dtype=np.int64) * 100


def fitted(noise_s: np.ndarray) -> LineFit:
    fit = fit_line(INDEX, INDEX * 0.01 + noise_s, ONE_SEGMENT, 0.0)
    assert fit is not None
    return fit


@pytest.mark.parametrize(("memory", "coverage"), [(0.0, 0.93), (0.8, 0.9), (0.95, 0.8)])
def test_the_sigma_of_the_slope_holds_for_correlated_noise(memory: float, coverage: float) -> None:
    source = np.random.default_rng(1)
    z = []
    for _ in range(300):
        noise = lfilter([1.0], [1.0, -memory], source.normal(0.0, 1e-4, ROWS + 200))[200:]
        fit = fitted(noise)
        z.append((fit.hz / 100.0 - 1.0) / fit.relative_sigma)
    assert np.mean(np.abs(z) < 2.0) >= coverage
    assert np.sqrt(np.mean(np.square(z))) > 0.5


def test_a_delay_that_creeps_and_falls_back_widens_the_sigma() -> None:
    """Polls and frames in step: the delay creeps up for most of the run and looks like a rate."""
    creeping = np.where(np.arange(ROWS) < 160, np.arange(ROWS) * 1e-5, 0.0)
    fit = fitted(creeping + np.random.default_rng(2).exponential(1e-6, ROWS))
    assert abs(fit.hz / 100.0 - 1.0) < 2.0 * fit.relative_sigma


def test_late_arrivals_are_passed_over_and_early_ones_are_not() -> None:
    jitter = np.random.default_rng(3).exponential(1e-5, ROWS)
    late, early = jitter.copy(), jitter.copy()
    late[150:160] += 5e-3
    early[150:160] -= 5e-3
    clean = fitted(jitter)
    assert fitted(late).hz == pytest.approx(clean.hz, rel=3e-7)
    assert fitted(early).relative_sigma > 20.0 * clean.relative_sigma


def test_a_step_is_found_where_it_is_and_counted_once() -> None:
    noise = np.random.default_rng(4).exponential(1e-4, ROWS)
    noise[77:] += 0.2
    fit = fitted(noise)
    assert fit.steps == 1
    assert fit.hz == pytest.approx(100.0, rel=1e-5)


def test_a_drift_is_no_step_and_has_its_sign() -> None:
    """The period grows, so the rate falls: by 1 % in the run of 200 s."""
    time = INDEX * 0.01
    fit = fitted(0.5 * 0.01 / 200.0 * time**2 + np.random.default_rng(5).exponential(1e-4, ROWS))
    assert fit.steps == 0
    assert fit.drift_per_h == pytest.approx(-0.01 * 3600 / 200, rel=0.05)


def test_a_phase_that_creeps_by_one_step_is_allowed_for_in_rate_and_drift() -> None:
    fit = fit_line(INDEX, INDEX * 0.01, ONE_SEGMENT, 1e-3)
    assert fit is not None
    step = 1e-3 / np.sqrt(12.0)
    assert fit.relative_sigma == pytest.approx(step / fit.span_s, rel=1e-3)
    assert fit.drift_sigma_per_h == pytest.approx(3600.0 * 8.0 * step / fit.span_s**2, rel=1e-3)


@pytest.mark.parametrize(("ratio", "share"), [(10.0, 1.0), (9.5, 0.5), (9.618034, 0.0)])
def test_only_what_no_other_frame_takes_the_place_of_may_creep(ratio: float, share: float) -> None:
    """Frames of p / q steps leave a q-th of one; with an irrational ratio nothing is left."""
    frames = np.arange(ROWS) * 30  # thirty frames a row, and once another number
    frames[-1] += 1
    fit = fit_line(frames, frames * ratio * 1e-3, ONE_SEGMENT, 1e-3)
    assert fit is not None
    floor = share * 1e-3 / np.sqrt(12.0) / fit.span_s
    assert fit.relative_sigma == pytest.approx(floor, rel=1e-2, abs=1e-3 / fit.span_s / 50)


@pytest.mark.parametrize(
    ("index", "time_s"),
    [
        (np.zeros(ROWS, np.int64), np.arange(ROWS) * 1.0),
        (INDEX, np.zeros(ROWS)),
        (INDEX, -INDEX * 1.0),
        (INDEX[:5], INDEX[:5] * 0.01),
    ],
)
def test_what_shows_no_rate_gives_none(index: np.ndarray, time_s: np.ndarray) -> None:
    assert fit_line(index, time_s, np.zeros(len(index), np.int64), 1e-3) is None


def test_stretches_of_two_points_crowd_out_nothing() -> None:
    jitter = np.random.default_rng(6).exponential(1e-4, ROWS)
    pairs = np.repeat(np.arange(1, 121), 2)
    index = np.concatenate([INDEX, np.tile([0, 5], 120)])
    times = np.concatenate([INDEX * 0.01 + jitter, 1e4 + pairs + np.tile([0.0, 0.05], 120)])
    fit = fit_line(index, times, np.concatenate([ONE_SEGMENT, pairs]), 0.0)
    assert fit is not None
    assert fit.hz == pytest.approx(fitted(jitter).hz, rel=1e-9)
    assert fit.relative_sigma == pytest.approx(fitted(jitter).relative_sigma, rel=1e-3)
