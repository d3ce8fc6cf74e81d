"""The averaging time of the smallest deviation, whether it is one, and the uncertainty stated."""

import numpy as np
import pytest

from allanscope.allan import AllanBank, Deviation
from allanscope.noise import NoiseModel, find_best_averaging, fit_array
from allanscope.noise.components import Flicker, RandomWalk, White

M = 2 ** np.arange(18)


def curve(deviation, spread=0.05, trusted=None):
    none, words = np.full(len(M), 50.0), np.full(len(M), "")
    trusted = np.ones(len(M), bool) if trusted is None else trusted
    lower, upper = deviation * (1 - spread), deviation * (1 + spread)
    return Deviation("oadev", M / 104, M, deviation, lower, upper, none, M, words, 0.95, trusted)


def test_the_minimum_of_the_reference_sensor():
    model = NoiseModel((White(4e-3), Flicker(1.255e-3), RandomWalk(1e-4)), 1 / 104)
    best = find_best_averaging(curve(model.deviation("oadev", M)))
    # sqrt(3) N / K = 69 s.
    assert best.tau == pytest.approx(69, rel=0.5)
    assert best.samples == round(best.tau * 104)
    assert best.lower < best.deviation < best.upper
    assert best.tau_lower <= best.tau <= best.tau_upper < 500
    assert best.tau_lower < 69 < best.tau_upper
    assert not best.at_end


def test_a_curve_that_falls_to_its_end_says_so():
    best = find_best_averaging(curve(1 / np.sqrt(M)))
    assert best.at_end
    assert best.samples == M[-1]
    assert best.tau_lower == best.tau
    assert best.tau_upper == np.inf


def test_a_floor_that_has_not_risen_out_of_its_interval_is_no_minimum():
    flat = np.maximum(1 / np.sqrt(M), 0.05) * np.where(M == 1024, 0.99, 1.0)
    assert find_best_averaging(curve(flat)).at_end
    assert not find_best_averaging(curve(flat * (1 + 2e-5 * M))).at_end


def test_the_true_averaging_time_lies_between_its_limits(make_noise):
    rng, rate = np.random.default_rng(11), 13.0
    model = NoiseModel((White(4e-3), Flicker(1.255e-3), RandomWalk(5e-4)), 1 / rate)
    factors = np.unique(np.round(2 ** (np.arange(60) / 4)))
    truth = factors[np.argmin(model.deviation("oadev", factors))] / rate
    held, widths = 0, []
    for _ in range(40):
        bank = AllanBank(rate, axes=1)
        bank.update(make_noise(23_400, 1 / rate, rng, N=4e-3, B=1.255e-3, K=5e-4))
        best = find_best_averaging(bank.deviation("oadev").axis(0))
        held += best.tau_lower <= truth <= best.tau_upper
        widths.append(best.tau_upper / best.tau_lower)
    assert held >= 38
    assert np.median(widths) < 10


def test_only_what_can_be_trusted_counts():
    deviation = 1 / np.sqrt(M)
    best = find_best_averaging(curve(deviation, trusted=M <= 512))
    assert best.samples == 512
    assert find_best_averaging(curve(deviation, trusted=M < 0)) is None


def test_several_axes_are_refused():
    with pytest.raises(ValueError, match="one axis"):
        find_best_averaging(curve(np.ones((2, len(M)))))


def test_the_standard_uncertainty_is_the_scatter_of_repeated_records():
    """Of 80 records; the standard deviation of that many is known to 8 %."""
    rng = np.random.default_rng(11)
    found = [fit_array(rng.standard_normal(3000), 100.0).coefficients["N"] for _ in range(80)]
    values = np.array([one.value for one in found])
    stated = np.array([one.uncertainty.standard for one in found])
    assert np.std(values, ddof=1) == pytest.approx(stated.mean(), rel=0.25)
    outside = np.abs(values - 0.1) > [one.uncertainty.expanded for one in found]
    assert outside.sum() <= 9  # 5 % of 80 is 4
    # A white record has n - 1 of them, in the band in which N is read fewer.
    assert 1000 < found[0].uncertainty.degrees_of_freedom < 3000
