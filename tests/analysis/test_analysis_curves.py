"""Curves of runs with many short gaps: as long as the run bears, and as certain as they say."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from allanscope import analyse
from allanscope.allan import AllanBank
from allanscope.allan.choices import CurveChoices
from allanscope.allan.deviation import Deviation
from allanscope.analysis.curves import across_gaps
from allanscope.history import Record

RATE_HZ = 100.0
N, M = 3000, 128
CHOICES = CurveChoices(kinds=("oadev",))


def samples(noise: str, seed: int) -> NDArray[np.float64]:
    """Return white noise of 1, or with a random walk that meets it in a second."""
    rng = np.random.default_rng(seed)
    walk = 0.02 * np.cumsum(rng.standard_normal(N))
    return rng.standard_normal(N) + (walk if noise == "walk" else 0.0)


def record_of(values: NDArray[np.float64], kept: NDArray[np.bool_]) -> Record:
    rows = np.flatnonzero(kept)
    first = np.flatnonzero(np.diff(rows, prepend=-9) > 1)
    segments = np.column_stack([first, np.append(first[1:], len(rows))])
    nan = np.full(len(rows), np.nan)
    return Record(
        RATE_HZ, 1, ("gx",), values[rows, np.newaxis], (1e-9,), nan, rows / RATE_HZ, segments
    )


def curve_of(record: Record) -> Deviation:
    bank = AllanBank(RATE_HZ, 1)
    for first, last in record.segments:
        bank.gap()
        bank.update(record.values[first:last])
    return CHOICES.of_bank(bank, "oadev", 0.95, RATE_HZ).axis(0)


def continued(record: Record) -> Deviation:
    return across_gaps({"gx": {"oadev": curve_of(record)}}, record, CHOICES, 0.95)["gx"]["oadev"]


def single_rows() -> NDArray[np.bool_]:
    """Lose one row in eight."""
    kept = np.ones(N, bool)
    kept[7::8] = False
    return kept


def bursts() -> NDArray[np.bool_]:
    """Lose 2 %: a dozen times ten rows."""
    kept = np.ones(N, bool)
    for first in np.random.default_rng(3).integers(10, N - 20, 12):
        kept[first : first + 10] = False
    return kept


@pytest.mark.parametrize("noise", ["white", "walk"])
@pytest.mark.parametrize("lost", [single_rows, bursts])
def test_long_averaging_times_across_gaps_have_limits_that_hold(noise, lost):
    """Of 40 runs 95 % limits must hold the truth in 34 or more (fewer by chance: 0.3 %)."""
    kept, held, squares = lost(), 0, []
    whole = [curve_of(record_of(samples(noise, seed), np.ones(N, bool))) for seed in range(40)]
    truth = np.sqrt(np.mean([c.deviation[c.m == M] ** 2 for c in whole]))
    for seed in range(40):
        curve = continued(record_of(samples(noise, seed), kept))
        at = np.flatnonzero(curve.m == M)[0]
        assert curve.trusted[at]
        held += bool(curve.lower[at] <= truth <= curve.upper[at])
        squares.append(curve.deviation[at] ** 2)
    assert held >= 34
    assert np.sqrt(np.mean(squares)) == pytest.approx(truth, rel=0.12)


def test_where_terms_between_gaps_tell_as_much_they_stay_as_they_are():
    record = record_of(samples("white", 1), bursts())
    strict, curve = curve_of(record), continued(record)
    short = curve.m <= 45
    assert np.array_equal(curve.deviation[short], strict.deviation[: short.sum()])
    assert curve.edf[curve.m == M] > 2 * strict.edf[strict.m == M]


def test_without_a_gap_nothing_changes():
    record = record_of(samples("walk", 1), np.ones(N, bool))
    strict, curve = curve_of(record), continued(record)
    assert np.array_equal(curve.deviation, strict.deviation)
    assert np.array_equal(curve.lower, strict.lower)


def test_a_longer_record_than_a_refresh_can_bridge_keeps_its_curves():
    record = record_of(samples("white", 1), single_rows())
    strict = curve_of(record)
    kept = across_gaps({"gx": {"oadev": strict}}, record, CHOICES, 0.95, most_rows=1000)
    assert kept["gx"]["oadev"] is strict


def test_a_long_record_is_coarsened_as_far_as_its_gaps_allow():
    """A row lost in two thousand: rows of eight have terms before those of the bank are few."""
    n = 200_000
    rng = np.random.default_rng(5)
    values = rng.standard_normal(n)
    kept = rng.random(n) > 0.0005
    curve = continued(record_of(values, kept))
    known = curve.trusted & (curve.m > 3000)
    assert known.sum() >= 8
    assert np.all(curve.lower[known] < 1.15 / np.sqrt(curve.m[known]))
    assert np.all(curve.upper[known] > 0.87 / np.sqrt(curve.m[known]))
    assert np.all(np.diff(np.log(curve.m[curve.m > 64])) < 0.4), "no hole where they meet"


def test_the_last_terms_of_a_run_in_pieces_are_not_trusted():
    """Half of the rows lost is too much to bridge; one long piece is not the run."""
    kept = np.zeros(N, bool)
    kept[::3] = kept[1::3] = True
    kept[1000:1040] = True
    curve = continued(record_of(samples("white", 2), kept))
    assert curve.m[-1] > 4
    assert not curve.trusted[curve.m > 4].any()
    assert curve.trusted[curve.m == 1].all()


def test_a_result_with_lost_samples_reads_its_minimum_off_the_whole_curve():
    """One sample in a hundred is lost: terms between gaps end at 2 s, the minimum lies at 5 s."""
    n, rng = 60 * 6000, np.random.default_rng(7)
    values = 0.5 * rng.standard_normal(n) + np.cumsum(0.001732 * rng.standard_normal(n))
    kept = rng.random(n) > 0.01
    result = analyse({"t": np.flatnonzero(kept) / RATE_HZ, "gx": values[kept]})
    best, curve = result.axes["gx"].best_averaging, result.axes["gx"].curves["oadev"]
    assert best is not None
    assert 200 < best.samples < 1000
    assert not best.at_end
    # sqrt(2 N K / sqrt(3)) with N = 0.05 and K = 0.01732
    assert best.lower < 0.0316 < best.upper
    assert curve.tau[-1] > 600


def test_averaging_times_that_were_asked_for_stay_those():
    rng = np.random.default_rng(8)
    kept = rng.random(6000) > 0.01
    data = {"t": np.flatnonzero(kept) / RATE_HZ, "gx": rng.standard_normal(6000)[kept]}
    result = analyse(data, curves=CurveChoices(kinds=("oadev",), taus=(0.01, 0.1)))
    assert result.axes["gx"].curves["oadev"].m.tolist() == [1, 10]
