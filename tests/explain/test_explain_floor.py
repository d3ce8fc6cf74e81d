"""White noise behind a low-pass: an amplifier, a converter, a coarse step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from allanscope.explain import explain

N, RATE = 4e-3, 52.0
SIGMA = N * RATE**0.5


def behind(b, order, cutoff, floor):
    low = lfilter(*butter(order, 2 * cutoff / RATE), b.noise())
    return low + b.rng.normal(0, floor * SIGMA, len(b.t))


@pytest.mark.parametrize(
    ("order", "cutoff", "floor", "seed"),
    [(2, 1.0, 0.02, 711), (2, 4.0, 0.1, 712), (4, 5.0, 0.03, 713), (1, 3.0, 0.1, 714)],
)
def test_a_floor_behind_a_low_pass_leaves_n_as_it_is(bench, order, cutoff, floor, seed):
    """Without it: two narrow bands at 1 and 2 Hz for one of them, and N known to a factor of 2."""
    b = bench(seed, 600.0)
    result = explain(b.record(behind(b, order, cutoff, floor), lsb=SIGMA / 1e4))
    axis = result.axes["gx"]
    assert [effect.kind for effect in axis.effects] == ["band_limit"]
    assert axis.explained
    found = axis.effects[0]
    assert "white noise behind it" in found.evidence["words"]
    assert found.parameters["cutoff"].value == pytest.approx(cutoff, rel=0.1)
    assert found.evidence["floor"] == pytest.approx(floor * N, rel=0.05)
    # 3 sd of N of the ordinates below the cutoff, which is as uncertain as they are.
    assert result.models_after["gx"].value("N") == pytest.approx(N, rel=3 / np.sqrt(600 * cutoff))


@pytest.mark.parametrize("tc", [0.1, 3.0])
def test_correlated_noise_above_the_white_noise_is_no_low_pass_with_a_floor(bench, tc):
    b = bench(715, 600.0)
    record = b.record(b.noise() + b.gauss_markov(4 * SIGMA * (0.1 / tc) ** 0.5, tc))
    assert [effect.kind for effect in explain(record).axes["gx"].effects] == ["gauss_markov"]
