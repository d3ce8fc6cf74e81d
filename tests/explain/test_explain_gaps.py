"""Rows that are missing singly neither stop the loop nor make it find anything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.explain import explain
from allanscope.history import Record
from support.thinned import RATE, thinned

ROWS = 24_000
N, K = 5e-3, 3e-4
LSB = 8.75e-3


def _kept(rng: np.random.Generator) -> np.ndarray:
    kept = rng.random(ROWS) >= 0.13
    kept[[0, -1]] = True
    return kept


def _slow(rng: np.random.Generator) -> np.ndarray:
    long = 4 * ROWS
    f = np.fft.rfftfreq(long, 1 / RATE)
    f[0] = np.inf
    flicker = np.fft.irfft(
        np.fft.rfft(rng.standard_normal((long, 3)), axis=0) / f[:, None] ** 0.5, long, axis=0
    )
    walk = np.cumsum(rng.normal(0, K / RATE**0.5, (ROWS, 3)), axis=0)
    return 0.01 * flicker[:ROWS] + walk


def _rounded(values: np.ndarray, step: float = LSB) -> np.ndarray:
    return np.round(values / step) * step


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("slow", [False, True], ids=["white", "white, flicker and walk"])
def test_nothing_is_found_that_is_not_there(seed, slow):
    rng = np.random.default_rng([seed, 11])
    values = rng.normal(0, N * RATE**0.5, (ROWS, 3)) + (_slow(rng) if slow else 0.0)
    result = explain(thinned(_rounded(values), _kept(rng), LSB))
    assert result.samples < 0.88 * ROWS
    for axis, found in result.axes.items():
        assert found.effects == (), axis
        assert found.hindrance == ""
        assert found.coefficients_after["N"].value == pytest.approx(N, rel=0.03)
        lost = [remark for remark in found.remarks if "missing" in remark]
        assert len(lost) == 1
        assert lost[0].startswith("13 % of the samples are missing, in 2 ")


@pytest.mark.parametrize("seed", range(2))
def test_the_bridge_over_a_long_gap_is_no_excursion(seed):
    """A table that sways with a period of 4 s is nowhere by chance where it is on average."""
    rng = np.random.default_rng([seed, 12])
    rows = 3 * ROWS
    pole = np.exp((-np.pi * 0.01 + 2j * np.pi * 0.25) / RATE)
    sway = lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], rng.standard_normal((3, rows)))
    values = rng.normal(0, N * RATE**0.5, (rows, 3)) + 0.008 * (sway / sway.std()).T
    kept = np.ones(rows, bool)
    kept[rows // 3 : rows // 3 + 3000] = False
    for found in explain(thinned(values, kept, LSB)).axes.values():
        assert not {one.kind for one in found.effects} & {"excursion", "step", "variance_change"}


def test_a_level_that_is_another_after_a_gap_has_jumped_once():
    """A board that was off for a while: when the level changed nobody saw."""
    rng = np.random.default_rng(21)
    values = rng.normal(0, N * RATE**0.5, (ROWS, 1))
    values[ROWS // 2 :] += 0.02
    kept = np.ones(ROWS, bool)
    kept[ROWS // 2 - 1000 : ROWS // 2 + 1000] = False
    (step,) = explain(thinned(_rounded(values), kept, LSB)).axes["gx"].effects
    assert step.kind == "step"
    assert step.parameters["size"].value == pytest.approx(0.02, rel=0.2)
    when = step.parameters["time"]
    assert (when.lower, when.upper) == pytest.approx((110.0, 130.0), abs=0.5)


def test_coarse_rows_are_not_taken_for_repeats():
    rng = np.random.default_rng(12)
    values = _rounded(rng.normal(0.3, 0.05, (ROWS, 3)), 0.061)
    result = explain(thinned(values, _kept(rng), 0.061))
    assert {axis: found.effects for axis, found in result.axes.items()} == dict.fromkeys(
        result.axes, ()
    )


def test_rows_that_do_repeat_are_counted_among_those_that_are_there():
    rng = np.random.default_rng(13)
    values = _rounded(rng.normal(0, 0.05, (ROWS, 3)))
    source = np.arange(ROWS)
    repeats = rng.random(ROWS) < 0.1
    source[repeats] = 0
    values = values[np.maximum.accumulate(source)]
    for found in explain(thinned(values, _kept(rng), LSB)).axes.values():
        share = [e.parameters["fraction"] for e in found.effects if e.kind == "repeated_samples"]
        assert len(share) == 1
        assert share[0].value == pytest.approx(0.1, abs=0.01)


def test_a_line_has_its_size():
    rng = np.random.default_rng(14)
    t = np.arange(ROWS) / RATE
    values = rng.normal(0, 0.05, (ROWS, 1)) + 0.02 * np.sin(2 * np.pi * 8.5 * t)[:, np.newaxis]
    found = explain(thinned(_rounded(values), _kept(rng), LSB)).axes["gx"]
    assert [effect.kind for effect in found.effects] == ["sinusoid"]
    assert found.effects[0].parameters["amplitude"].value == pytest.approx(0.02, abs=0.0015)


def test_a_record_in_bursts_is_told_that_its_gaps_are_why():
    rng = np.random.default_rng(4)
    row = np.concatenate([24 * k + np.arange(4) for k in range(1500)])
    record = Record(
        rate_hz=960.0,
        stride=1,
        axes=("gx",),
        values=_rounded(rng.normal(0, 0.05, (len(row), 1))),
        lsb=(LSB,),
        temperature_c=np.full(len(row), np.nan),
        start_s=row / 960.0,
        segments=np.array([[4 * k, 4 * k + 4] for k in range(1500)], np.int64),
    )
    why = explain(record).axes["gx"].hindrance
    assert "1 499 gaps" in why
    assert "too short" not in why


def test_times_after_a_long_gap_are_those_of_the_run(bench):
    """Only the rows behind it are searched; what happened there was told from their first on."""
    b = bench(771, 1100.0)
    rows = b.noise()
    quiet, late = 200 * 52, 1000.0  # a gap of 1000 s after the first 200
    t = b.t + late * (np.arange(len(b.t)) >= quiet)
    loud = np.where((b.t > 800.0) & (b.t < 900.0), 2.0, 1.0)
    record = replace(
        b.record(rows * loud + 0.03 * (b.t > 600.0)),
        start_s=t,
        segments=np.array([[0, quiet], [quiet, len(rows)]], np.int64),
    )
    effects = {e.kind: e.parameters for e in explain(record).axes["gx"].effects}
    assert set(effects) == {"step", "variance_change"}
    assert effects["step"]["time"].value == pytest.approx(600.0 + late, abs=3.0)
    assert effects["variance_change"]["start"].value == pytest.approx(800.0 + late, abs=3.0)
    assert effects["variance_change"]["stop"].value == pytest.approx(900.0 + late, abs=3.0)
