"""A scale that drifts: named with its size, and nothing else that grows is taken for it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from allanscope.explain import explain, fit_beside
from allanscope.explain.effects import KINDS
from allanscope.explain.series import series_of
from allanscope.explain.view import View

SEEDS = (61, 62, 63)


def ramp(b, relative: float) -> NDArray[np.float64]:
    return np.asarray(1 + relative * b.t / b.t[-1])


def proposed(b, samples: NDArray[np.float64]) -> list:
    view = View.of(series_of(b.record(samples)), "gx")
    return [c for c in KINDS["scale_drift"].candidates(view) if c.excess > 0]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("relative", [0.5, -0.4])
def test_coloured_noise_that_grows_or_fades_is_itself_under_a_scale(bench, seed, relative):
    """Before, it was a band limit beside another process: neither was there."""
    b = bench(seed)
    sigma, tc = 0.03, 2.0
    found = explain(b.record((b.noise() + b.gauss_markov(sigma, tc)) * ramp(b, relative))).axes[
        "gx"
    ]
    assert [effect.kind for effect in found.effects] == ["scale_drift", "gauss_markov"]
    scale, process = (effect.parameters for effect in found.effects)
    assert scale["relative"].value == pytest.approx(relative, abs=0.06)
    assert process["correlation_time"].value == pytest.approx(tc, rel=0.3)
    assert found.explained


@pytest.mark.parametrize("seed", range(70, 82))
def test_noise_of_one_scale_has_no_drift(bench, seed):
    b = bench(seed)
    assert proposed(b, b.noise()) == []
    assert proposed(b, b.noise() + b.gauss_markov(0.04, 3.0)) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_not_the_scale_of_all_is_not_named_so(bench, seed):
    b = bench(seed)
    noise, half = b.noise(), b.t > 0.5 * b.t[-1]
    tone = np.sin(2 * np.pi * 5.0 * b.t)
    slow = b.gauss_markov(0.06, 3.0)
    assert proposed(b, noise * np.where(half, 1.3, 1.0)) == []  # abrupt
    assert proposed(b, noise * np.where(half, 1.08, 1.0)) == []  # abrupt, near the limit
    assert proposed(b, noise + 0.05 * b.t / b.t[-1] * tone) == []  # one frequency
    assert proposed(b, noise * ramp(b, 0.5) + slow) == []  # white noise alone
    assert proposed(b, noise + 0.5 * np.exp(-b.t / 60.0)) == []  # the level


def test_the_drift_is_fitted_again_on_a_record_that_has_grown(bench):
    b = bench(64)
    samples = b.noise() * ramp(b, 1.0)
    half = len(samples) // 2
    short, whole = b.record(samples[:half]), b.record(samples)
    found = explain(short)
    assert [effect.kind for effect in found.axes["gx"].effects] == ["scale_drift"]
    signal = fit_beside(found.held, whole)["gx"].signals["scale_drift"]
    rest = whole.values[: len(signal), 0] - signal
    quarter = len(rest) // 4
    assert rest[-quarter:].std() == pytest.approx(rest[:quarter].std(), rel=0.03)
