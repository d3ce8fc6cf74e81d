"""The likelihood and its maximum: against exact likelihoods, known truth and the bound."""

from dataclasses import replace

import numpy as np
import pytest

from allanscope.noise import NoiseModel, relative_bounds, wait_until
from allanscope.noise.components import (
    AngleQuantization,
    Flicker,
    GaussMarkov,
    RandomWalk,
    Rounding,
    White,
)
from allanscope.noise.evidence import DensityBands, Ordinates, evidence_of, stretches_of
from allanscope.noise.filters import Butterworth, HeldSamples
from allanscope.noise.grid import Grid
from allanscope.noise.likelihood import Fit, Likelihood
from allanscope.noise.model import Free
from allanscope.noise.whiteness import whitened
from allanscope.spectrum import Density

DT = 0.5
TRUTH = (White(4e-3), Flicker(1.255e-3), RandomWalk(1e-4))
START = (White(1e-3), Flicker(1e-3), RandomWalk(1e-3))


def model_of(parts):
    return NoiseModel(tuple(parts), DT)


def fit(data, parts, **options):
    return Likelihood(data).maximise(model_of(parts), **options)


@pytest.mark.parametrize("excluded", [(), ((0.05, 0.1),)])
def test_less_a_pattern_of_the_first_ordinates_the_powers_are_those_of_what_is_left(excluded):
    """The pattern ends in the midst of a bin, beyond what is left out."""
    rng = np.random.default_rng(4)
    whole = Ordinates.of(rng.normal(size=(2, 5000)), DT, highest=0.9).without(excluded)
    left = whole.less(rng.normal(size=(2, 700)))
    kept, square = whole.grid.kept(excluded), np.mean(left.raw**2, axis=0)
    bins = np.searchsorted(whole.grid.edges, np.arange(len(square)), side="right") - 1
    power = np.bincount(bins, square * kept) / np.maximum(np.bincount(bins, kept), 1)
    np.testing.assert_allclose(left.power, power[: len(left.power)], rtol=1e-12)
    assert np.count_nonzero(left.power != whole.power) < len(left.power) - 1


@pytest.mark.parametrize("parts", [TRUTH, (Rounding(0.1),)])
def test_the_largest_likelihood_is_that_of_the_fit_that_has_it(parts):
    """With numbers that are fitted, and without."""
    data = Likelihood([Ordinates.of(np.random.default_rng(5).normal(size=3000), DT)])
    basis = data.basis(model_of(parts), frozenset())
    assert any(basis.free) == (parts is TRUTH)
    assert data.largest(basis) == data.maximum(basis).loglik


@pytest.mark.parametrize("zero", [False, True])
def test_the_bound_is_the_information_of_a_fit_without_a_record(zero):
    """Behind a filter with a shape of its own, which leaves the likelihood to say it."""
    parts = (*TRUTH[:2], RandomWalk(0.0 if zero else 1e-4), AngleQuantization(1e-4))
    plain = (*parts, Rounding(0.001))
    filtered = NoiseModel(plain, DT, (Butterworth(1e6, 1.0),))
    found, through = relative_bounds(plain, DT, 900.0), relative_bounds(filtered, DT, 900.0)
    grid = Grid(1800, 1 / DT)
    data = Likelihood([Ordinates(grid, np.ones_like(grid.count), grid.count)])
    model = model_of(plain)
    expected = data.expected(model)
    fit = Fit(data, model, 0.0, frozenset(), True, expected)
    assert list(found) == list(fit.names)
    np.testing.assert_allclose(list(found.values()), fit.relative_sd(), rtol=1e-9)
    assert set(through) > set(found)
    assert np.isinf(found["K"]) == zero


def loglik(data, parts):
    return Likelihood(data).of(model_of(parts))


def drawn(rng, n, model, dt=DT, stride=1):
    """Return evidence whose ordinates are exactly what the likelihood assumes."""
    grid = Grid(n, 1 / (dt * stride), stride)
    k = np.arange(1, n)
    power = sum(component.ordinates(k, n, dt, stride) for component in model)
    raw = rng.standard_normal((1, n - 1)) * np.sqrt(power)
    return Ordinates(grid, grid.bin_means(raw[0] ** 2), grid.count, raw)


def test_ordinates_keep_all_the_power(rng):
    rows = rng.standard_normal(1000)
    ordinates = Ordinates.of(rows, DT)
    assert np.sum(ordinates.raw**2) == pytest.approx(np.sum((rows - rows.mean()) ** 2))
    assert np.sum(ordinates.power * ordinates.dof) == pytest.approx(np.sum(ordinates.raw**2))
    assert ordinates.dof.sum() == ordinates.grid.n - 1


def test_the_level_of_a_record_does_not_matter(rng):
    rows = rng.standard_normal(1000)
    still = rows.copy()
    np.testing.assert_allclose(
        Ordinates.of(rows + 1e6, DT).power, Ordinates.of(rows, DT).power, rtol=1e-6
    )
    np.testing.assert_array_equal(rows, still)


@pytest.mark.parametrize("n", [17, 1000, 100_001])
def test_bins_cover_every_ordinate_once(n):
    grid = Grid(n, 2.0)
    assert grid.edges[0] == 0
    assert np.all(np.diff(grid.edges) >= 1)
    assert grid.count.sum() == n - 1
    assert np.all(grid.count[:20] == 1)


@pytest.mark.parametrize("part", [White(1.0), Flicker(1.0), RandomWalk(1.0), GaussMarkov(1.0, 5.0)])
@pytest.mark.parametrize("stride", [1, 8])
def test_what_a_component_gives_a_bin_is_the_mean_over_its_ordinates(part, stride):
    grid = Grid(20_000, 10.0, stride)
    each = part.ordinates(np.arange(1, grid.n), grid.n, grid.dt, stride)
    np.testing.assert_allclose(grid.column(part), grid.bin_means(each), rtol=2e-3)


def test_interpolated_ordinates_are_those_of_the_model_up_to_nyquist():
    grid = Grid(50_000, 100.0)
    response = Butterworth(30.0, 2.0).response
    unit = grid.rate_hz / (2 * grid.n)
    found = grid.interpolate(1e-6 + response(grid.nodes * unit, grid.dt))
    np.testing.assert_allclose(found, 1e-6 + response(grid.frequency, grid.dt), rtol=1e-3)


def test_a_line_appears_at_its_frequency():
    t = DT * np.arange(4000)
    ordinates = Ordinates.of(np.sin(2 * np.pi * 0.05 * t), DT)
    assert ordinates.frequency[ordinates.power.argmax()] == pytest.approx(0.05, rel=0.04)


@pytest.mark.parametrize("bad", [np.zeros(5), np.full(100, np.nan)])
def test_unusable_rows_are_refused(bad):
    with pytest.raises(ValueError, match=r"16 contiguous|not finite"):
        Ordinates.of(bad, DT)


def test_likelihood_is_exact_for_white_noise_and_a_random_walk(rng):
    # Of what is left without the mean, whose likelihood is that of the DCT ordinates themselves.
    n = 96
    rows = np.cumsum(rng.standard_normal(n)) * 0.3 + rng.standard_normal(n)
    models = [(White(0.9), RandomWalk(0.4)), (White(0.5), RandomWalk(0.8))]
    ordinates = Ordinates.of(rows, DT)
    assert ordinates.grid.n == n
    exact = []
    centre = np.eye(n)[1:] - 1 / n
    for white, walk in models:
        steps = np.minimum.outer(np.arange(n), np.arange(n)) * walk.K**2 * DT
        covariance = centre @ (steps + np.eye(n) * white.N**2 / DT) @ centre.T
        residual = centre @ rows
        value = residual @ np.linalg.solve(covariance, residual)
        exact.append(-0.5 * (np.linalg.slogdet(covariance)[1] + value))
    ours = [loglik([ordinates], model) for model in models]
    assert ours[0] - ours[1] == pytest.approx(exact[0] - exact[1], abs=1e-8)


def test_fit_reaches_the_same_maximum_from_far_away(rng):
    data = [drawn(rng, 20_000, TRUTH)]
    fits = [
        fit(data, (White(a), Flicker(b), RandomWalk(c)))
        for a, b, c in ((1e-5, 1e-5, 1e-5), (1.0, 1.0, 1.0), (1e-2, 0.0, 1e-6), (4e-3, 1e-3, 1e-4))
    ]
    assert all(found.converged for found in fits)
    for found in fits[1:]:
        assert found.loglik == pytest.approx(fits[0].loglik, abs=1e-5)
        np.testing.assert_allclose(found.values, fits[0].values, rtol=1e-3, atol=1e-9)


def test_what_is_absent_lands_on_zero_and_not_beside_it(rng):
    zeros = [fit([drawn(rng, 4096, (White(1.0),))], START).values for _ in range(40)]
    walks = np.array(zeros)[:, 2]
    # Half of all estimates of a power that is not there would be negative.
    assert 10 <= np.count_nonzero(walks == 0.0) <= 38
    assert walks.max() < 0.02


def test_fitted_score_is_zero_at_an_inner_maximum(rng):
    data = Likelihood([drawn(rng, 20_000, TRUTH)])
    found = data.maximise(model_of(START))
    for free, value in zip(found.free, found.values, strict=True):
        for factor in (0.999, 1.001):
            moved = found.model.with_numbers([free], [factor * value])
            assert data.of(moved) < found.loglik


def test_shapes_are_fitted_within_their_bounds(rng):
    truth = (White(4e-3), GaussMarkov(4e-3, 20.0))
    found = fit([drawn(rng, 20_000, truth)], (White(1e-3), GaussMarkov(1e-3, 300.0)))
    sigma, time = found.model.components[1].values
    sd = found.relative_sd()
    assert found.names == ("N", "sigma", "correlation_time")
    assert abs(np.log(sigma / 4e-3)) < 4 * sd[1]
    assert abs(np.log(time / 20.0)) < 4 * sd[2]


def test_a_number_of_a_filter_that_is_zero_has_no_error_and_leaves_the_others_theirs(rng):
    data, model = Likelihood([drawn(rng, 20_000, TRUTH[:1])]), model_of(START[:1])
    filtered = replace(model, filters=(HeldSamples(0.0),))
    beside = data.maximise(filtered, held={Free(1, 0)}).all_free()
    assert beside.relative_sd()[0] == pytest.approx(data.maximise(model).relative_sd()[0])
    assert beside.relative_sd()[1] == np.inf


def test_held_numbers_stay_and_known_parts_count(rng):
    truth = (White(4e-3), Rounding(5e-3))
    data = [drawn(rng, 20_000, truth)]
    found = fit(data, (White(1e-3), Rounding(5e-3)))
    assert found.values[0] == pytest.approx(4e-3, rel=0.03)
    alone = fit(data, (White(1e-3),))
    assert alone.values[0] == pytest.approx(np.hypot(4e-3, 5e-3 * np.sqrt(DT / 12)), rel=0.03)
    held = fit(data, (White(1e-3), RandomWalk(7e-5)), held={Free(1, 0)})
    assert held.model.components[1].values[0] == 7e-5
    assert held.names == ("N",)


def test_segments_of_different_length_add_up(rng):
    segments = [drawn(rng, n, TRUTH) for n in (20_000, 3000, 500)]
    together = fit(segments, START)
    assert loglik(segments, TRUTH) == pytest.approx(sum(loglik([s], TRUTH) for s in segments))
    first = fit(segments[:1], START)
    assert together.relative_sd()[0] < first.relative_sd()[0]


def test_density_bands_take_part(rng):
    frequency = np.geomspace(0.05, 0.9, 40)
    averages = np.full(40, 50.0)
    power = NoiseModel(TRUTH, DT).density(frequency) * rng.chisquare(100, 40) / 100
    density = Density(frequency, 0.03 * frequency, power, averages)
    bands = DensityBands.of(density, DT, lowest=0.1)
    assert bands.frequency[0] > 0.1
    assert np.all(bands.dof == 100.0)
    low = drawn(rng, 5000, TRUTH, stride=8).without(((0.03, np.inf),))
    both = fit([bands, low], START)
    # 4000 degrees of freedom in the bands: 1.6 %.
    assert both.values[0] == pytest.approx(4e-3, rel=0.06)
    assert both.relative_sd()[1] < 0.5 * fit([bands], START).relative_sd()[1]


def test_rows_of_averages_tell_the_same_as_samples(rng, make_noise):
    samples = make_noise(64_000, 0.05, rng, N=4e-3, B=1.2e-3, K=5e-4)
    direct = fit(evidence_of([samples[np.newaxis]], 0.05), START)
    rows = samples.reshape(-1, 16).mean(axis=1)
    averaged = fit(evidence_of([rows[np.newaxis]], 0.05, stride=16), START)
    # N is known to 1 % from the averages; what is slow is the same in both.
    np.testing.assert_allclose(averaged.values, direct.values, rtol=0.06)


def test_many_gaps_cost_little(rng, make_noise):
    samples = make_noise(120_000, 0.1, rng, N=4e-3, B=2e-3)
    cuts = np.sort(rng.choice(np.arange(1000, 119_000), 300, replace=False))
    bounds = np.concatenate([[0], cuts, [120_000]])
    segments = list(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True))
    stretches = stretches_of(samples, segments)
    evidence = evidence_of(stretches, 0.1)
    assert len(evidence) == 17
    used = sum(part.dof.sum() for part in evidence)
    assert used > 0.7 * 120_000
    found = fit(evidence, (White(1e-3), Flicker(1e-3)))
    np.testing.assert_allclose(found.values, [4e-3, 2e-3], rtol=0.15)


def test_no_usable_stretch_is_an_error():
    with pytest.raises(ValueError, match="without a gap"):
        stretches_of(np.zeros(30), [(0, 10), (10, 20), (20, 30)])
    with pytest.raises(ValueError, match="no evidence"):
        Likelihood([])


def test_whitened_bands_are_normal_under_the_truth(rng):
    data = (drawn(rng, 200_000, TRUTH),)
    z = whitened(data, Likelihood(data).expected(model_of(TRUTH))).z
    assert len(z) > 30
    assert abs(z.mean()) < 4 / np.sqrt(len(z))
    assert 0.7 < z.std() < 1.35


def test_whitened_bands_show_where_a_model_is_wrong(rng):
    data = (drawn(rng, 200_000, (*TRUTH, GaussMarkov(3e-3, 1.0))),)
    bands = whitened(data, Likelihood(data).maximise(model_of(START)).expected)
    assert abs(bands.worst) > 5
    assert bands.p_value(3) < 1e-6


@pytest.mark.parametrize(
    ("hours", "rate", "expected"),
    [
        (1, 104, (0.117, 8.27, 33.6)),
        (12, 104, (0.0338, 2.37, 9.25)),
        (12, 6664, (0.0042, 2.34, 9.24)),
    ],
)
def test_bounds_are_the_known_ones(hours, rate, expected):
    bounds = relative_bounds(TRUTH, 1 / rate, hours * 3600.0)
    for name, percent in zip("NBK", expected, strict=True):
        assert 100 * bounds[name] == pytest.approx(percent, rel=0.02)


def test_waiting_reaches_the_precision_that_was_asked_for():
    wait = wait_until(TRUTH, 1 / 104, 3600.0, "K")
    reached = relative_bounds(TRUTH, 1 / 104, 3600.0 + wait)["K"]
    assert reached == pytest.approx(0.2, rel=0.02)
    assert wait_until(TRUTH, 1 / 104, 3600.0, "N") == 0.0
    assert wait_until((White(1.0), RandomWalk(0.0)), 1.0, 100.0, "K") is None


def test_quantization_and_rounding_differ_in_shape(rng):
    data = [drawn(rng, 50_000, (White(4e-3), AngleQuantization(3e-3)))]
    found = fit(data, (White(1e-3), AngleQuantization(1e-3)))
    np.testing.assert_allclose(found.values, [4e-3, 3e-3], rtol=0.05)
