"""The Allan deviation over time is, in each window, that of a cascade of the window alone."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from numpy.typing import NDArray

from allanscope.allan import AllanBank, DynamicDeviation

RATE = 100.0


def run(n: int, axes: int = 2, seed: int = 1) -> NDArray[np.float64]:
    """Return white noise and a random walk, five times as large in the middle sixth."""
    rng = np.random.default_rng(seed)
    x = rng.normal(0.0, 20.0, (n, axes)) + 0.1 * rng.normal(size=(n, axes)).cumsum(axis=0)
    x[n // 3 : n // 2] *= 5.0
    return x + 1000.0


def fed(bank: AllanBank, pieces: list[NDArray[np.float64]], lost: int = 0, cut: int = 7777) -> None:
    for number, piece in enumerate(pieces):
        if number:
            bank.gap(lost)
        for first in range(0, len(piece), cut):
            bank.update(piece[first : first + cut])


def largest_difference(
    curves: DynamicDeviation, pieces: list[NDArray[np.float64]], lost: int = 0, windows: int = 25
) -> float:
    """Return the largest relative difference of some windows from banks of their own."""
    x = np.concatenate(pieces)
    ends = np.cumsum([len(piece) for piece in pieces])
    number = np.arange(len(x)) + lost * np.searchsorted(ends, np.arange(len(x)), side="right")
    worst = 0.0
    for w in range(0, len(curves.start_s), max(len(curves.start_s) // windows, 1)):
        first = int(np.searchsorted(number, round(curves.start_s[w] * RATE)))
        last = int(np.searchsorted(number, round(curves.stop_s[w] * RATE)))
        alone = AllanBank(RATE, axes=x.shape[1])
        inside = [end for end in ends if first < end < last]
        fed(alone, np.split(x[first:last], np.array(inside, np.int64) - first))
        wanted = alone._cascade.settled().variances("oadev")
        at = np.flatnonzero((wanted.terms[0] >= 2) & (wanted.m / RATE <= curves.tau[-1] + 1e-9))
        m = np.rint(curves.tau * RATE).astype(np.int64)
        here = np.searchsorted(m, wanted.m[at])
        np.testing.assert_array_equal(curves.terms[w, here], wanted.terms[0, at])
        assert np.count_nonzero(curves.terms[w]) == len(at)
        ratio = curves.deviation[:, w, here] / np.sqrt(wanted.variance[:, at])
        worst = max(worst, float(np.abs(ratio - 1.0).max()))
    return worst


@pytest.mark.parametrize("window", [60.0, 3.0, 0.0])
def test_each_window_is_the_bank_of_its_samples(window: float) -> None:
    x = run(150_000)
    bank = AllanBank(RATE, axes=2, window=window)
    fed(bank, [x])
    curves = bank.dynamic()
    assert len(curves.start_s) > 100
    assert largest_difference(curves, [x]) < 1e-9
    if window:
        assert curves.window_s == pytest.approx(window, rel=0.07)
        assert curves.tau[-1] > 0.35 * curves.window_s


def test_holes_are_in_windows_as_in_a_bank_and_in_their_times() -> None:
    x = run(200_000)
    ends = np.sort(np.random.default_rng(3).integers(0, len(x), 60))
    pieces = [*np.split(x, ends), x[:5]]
    bank = AllanBank(RATE, axes=2, window=40.0)
    fed(bank, pieces, lost=250)
    curves = bank.dynamic()
    assert largest_difference(curves, pieces, lost=250) < 1e-9
    spans = curves.stop_s - curves.start_s
    assert spans.max() > curves.window_s + 3 * 2.5 - 1.0
    assert curves.stop_s[-1] > (len(x) + 55 * 250) / RATE


def test_asking_and_cutting_change_no_bit() -> None:
    x = run(40_000)
    asked, whole = (AllanBank(RATE, axes=2, window=0.0) for _ in range(2))
    for first in range(0, len(x), 331):
        asked.update(x[first : first + 331])
        if first % 7 == 0:
            asked.dynamic()
    whole.update(x)
    one, other = asked.dynamic(), whole.dynamic()
    assert one.deviation.tobytes() == other.deviation.tobytes()
    plain = AllanBank(RATE, axes=2)
    plain.update(x)
    mine, theirs = asked.deviation("oadev"), plain.deviation("oadev")
    assert mine.deviation.tobytes() == theirs.deviation.tobytes()


def test_a_long_run_keeps_between_500_and_1100_windows_in_fixed_memory() -> None:
    x = np.random.default_rng(2).integers(-100, 100, (1 << 16, 1))
    bank = AllanBank(RATE, axes=1, window=0.0)
    sizes = []
    for _ in range(24):
        bank.update(x)
        sizes.append((len(bank.dynamic().start_s), bank.nbytes))
    assert all(500 <= many <= 1100 for many, _ in sizes[3:])
    assert sizes[-1][1] < 1.25 * sizes[3][1] < 64 * 2**20


def test_a_run_shorter_than_a_window_has_none() -> None:
    bank = AllanBank(RATE, axes=3, window=10.0)
    assert bank.dynamic().deviation.shape == (3, 0, 0)
    bank.update(np.zeros((50, 3)))
    assert bank.dynamic().deviation.shape == (3, 0, 0)


def test_a_bank_without_windows_says_how_to_have_them() -> None:
    with pytest.raises(ValueError, match="window="):
        AllanBank(RATE).dynamic()
    with pytest.raises(ValueError, match="length in s"):
        AllanBank(RATE, window=-1.0)


@pytest.mark.parametrize("taken", [5_000, 300_000])
def test_a_copy_goes_on_alike(taken: int) -> None:
    x = run(taken + 40_000)
    bank = AllanBank(RATE, axes=2, window=0.0)
    bank.update(x[:taken])
    copies = [copy.deepcopy(bank), pickle.loads(pickle.dumps(bank))]
    for one in (bank, *copies):
        one.update(x[taken:])
    for one in copies:
        assert one.dynamic().deviation.tobytes() == bank.dynamic().deviation.tobytes()
        assert one.dynamic().terms.tobytes() == bank.dynamic().terms.tobytes()


def test_a_copy_of_a_short_run_has_no_borders_that_are_not_in_use() -> None:
    bank = AllanBank(RATE, axes=2, window=0.0)
    bank.update(run(5_000))
    borders = bank._borders
    assert borders is not None
    assert len(pickle.dumps(borders)) < 0.2 * borders.nbytes
