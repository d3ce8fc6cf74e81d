"""What the streaming spectrum shows above the rows: a low-pass of one pole or of two."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.band_limit import BandLimit
from allanscope.explain.highband import above_the_rows
from allanscope.explain.series import Series
from allanscope.explain.view import View
from allanscope.noise.filters import Butterworth, OnePole
from allanscope.noise.grid import grid_of
from allanscope.spectrum import Density

Array = NDArray[np.float64]

ROWS_HZ, STRIDE, AVERAGES = 26.0, 4, 4000.0
FREQUENCY = np.geomspace(13.5, 51.5, 44)


def seen_above(shape: Array, seed: int) -> tuple[Candidate, ...]:
    rng = np.random.default_rng(seed)
    rows = 1e-3 * rng.normal(size=(4096, 1))
    series = Series(("gx",), rows, ROWS_HZ, STRIDE, (1e-9,), None, np.zeros(len(rows), np.bool_))
    power = 1e-4 * shape * (1 + rng.normal(size=len(shape)) / np.sqrt(AVERAGES))
    averages = np.full(len(power), AVERAGES)
    density = Density(FREQUENCY, np.gradient(FREQUENCY), power, averages)
    view = View(series, grid_of(len(rows), ROWS_HZ), "gx", rows[:, 0], 1e-9)
    return above_the_rows(view, density).accepted


@pytest.mark.parametrize("cutoff", [20.0, 35.0])
@pytest.mark.parametrize("poles", [1, 2])
def test_a_low_pass_above_the_rows_is_found_with_either_order(poles: int, cutoff: float) -> None:
    rate = ROWS_HZ * STRIDE
    shape = (OnePole(cutoff) if poles == 1 else Butterworth(cutoff)).response(FREQUENCY, 1 / rate)
    covered = 0
    for seed in range(5):
        (limit,) = seen_above(shape, seed)
        assert isinstance(limit.effect, BandLimit)
        found = limit.effect.cutoff
        assert found.value == pytest.approx(cutoff, rel=0.1)
        covered += found.lower <= cutoff <= found.upper  # type: ignore[operator]
    assert covered >= 4


def test_white_noise_above_the_rows_is_no_low_pass() -> None:
    assert seen_above(np.ones(len(FREQUENCY)), 1) == ()
