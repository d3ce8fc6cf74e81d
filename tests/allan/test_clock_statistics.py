"""GCODEV, three-cornered hat, MTIE, TIErms and AVLR against allantools and closed forms."""

import allantools
import numpy as np
import pytest

from allanscope.allan import (
    avlr,
    deviation,
    gcodev,
    mtie,
    three_cornered_hat,
    tierms,
)

RNG = np.random.default_rng(12)
X = RNG.normal(size=1500).cumsum()
M = [1, 2, 3, 7, 16, 100, 999]


def test_mtie_and_tierms_are_those_of_allantools():
    for ours, theirs in ((mtie, allantools.mtie), (tierms, allantools.tierms)):
        taus, expected, _, _ = theirs(X, rate=1.0, taus=M)
        assert ours(X, taus.astype(int).tolist()) == pytest.approx(expected, rel=1e-12)


def test_gcodev_is_that_of_allantools_up_to_its_sign():
    a, b, c = RNG.normal(size=(3, 4000)) * [[3.0], [1.0], [1.0]]
    one, other = a - b, a - c
    phases = [np.append(0.0, np.cumsum(x)) for x in (one, other)]
    m = [1, 4, 32]
    _, expected, _, _ = allantools.gcodev(*phases, rate=1.0, taus=m)
    found = gcodev(one, other, 1.0, m)
    assert np.abs(found) == pytest.approx(expected, rel=1e-9)
    assert found == pytest.approx(3.0 / np.sqrt(m), rel=0.1)  # A alone
    assert (gcodev(one, -other, 1.0, m) < 0).all()


def test_three_cornered_hat_parts_three_clocks():
    clocks = RNG.normal(size=(3, 20_000)) * [[1.0], [2.0], [3.0]]
    pairs = [clocks[i] - clocks[j] for i, j in ((0, 1), (1, 2), (2, 0))]
    curves = [deviation(pair, 1.0, taus=[1.0, 8.0]).variance for pair in pairs]
    for found, sigma in zip(three_cornered_hat(*curves), (1.0, 2.0, 3.0), strict=True):
        assert found == pytest.approx(sigma**2 / np.array([1, 8]), rel=0.15)


@pytest.mark.parametrize(("letter", "slope"), [("N", -0.5), ("B", 0.0), ("K", 0.5), ("R", 1.0)])
def test_avlr_reads_a_line_of_its_slope(letter, slope):
    curve = deviation(RNG.normal(size=5000), 10.0)
    factor = {"N": 1.0, "B": np.sqrt(2 * np.log(2) / np.pi), "K": 3**-0.5, "R": 0.5**0.5}[letter]
    straight = curve.__class__(
        **{
            name: getattr(curve, name)
            for name in ("kind", "tau", "m", "edf", "terms", "noise", "level", "trusted")
        },
        deviation=0.3 * factor * curve.tau**slope,
        lower=0.29 * factor * curve.tau**slope,
        upper=0.31 * factor * curve.tau**slope,
    )
    found = avlr(straight, letter, 0.1, 10.0)
    assert found.value == pytest.approx(0.3)
    assert (found.lower, found.upper) == pytest.approx((0.29, 0.31))
    assert found.chi2 == pytest.approx(0.0, abs=1e-12)
    wrong = avlr(straight, "N" if letter != "N" else "K", 0.1, 10.0)
    assert wrong.chi2 > 50 * wrong.points


def test_limits_of_avlr_hold():
    held = 0
    for seed in range(60):
        white = np.random.default_rng(seed).normal(size=3000)
        found = avlr(deviation(white, 1.0), "N", 1.0, 64.0)
        held += found.lower <= 1.0 <= found.upper
    assert held >= 53


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ValueError, match="no window of 2000 samples in 1500"):
        mtie(X, [2000])
    with pytest.raises(ValueError, match="records differ in length: 10 and 9"):
        gcodev(X[:10], X[:9], 1.0, [1])
    with pytest.raises(ValueError, match="no coefficient 'Z'"):
        avlr(deviation(X, 1.0), "Z", 1.0, 10.0)
    with pytest.raises(ValueError, match=r"no point between 0\.1 and 0\.2 s"):
        avlr(deviation(X, 1.0), "N", 0.1, 0.2)
