"""Sums of exponentials: the closed forms against sums over the autocovariance."""

import numpy as np
import pytest

from allanscope.noise.components.correlated import ExponentialCovariance

PROCESSES = [
    ExponentialCovariance((2.0,), (0.05,)),
    ExponentialCovariance((1.0,), (3e-4,), delta=0.3),
    ExponentialCovariance.second_order(0.2, 0.1),
    ExponentialCovariance.second_order(2e-3, 0.7),
    ExponentialCovariance((1.0, 0.5 - 0.2j), (0.3, 0.1 + 0.4j), delta=0.1),
]


def variance_of_sum(process, m):
    lag = np.arange(1, m)
    return m * process.autocovariance(0) + 2 * np.sum((m - lag) * process.autocovariance(lag))


@pytest.mark.parametrize("process", PROCESSES)
def test_allan_and_hadamard_variance_are_combinations_of_sums(process):
    for m in (1, 2, 7, 60, 400):
        one, two, three = (float(variance_of_sum(process, j * m)) for j in (1, 2, 3))
        assert process.avar(m) == pytest.approx((4 * one - two) / (2 * m**2), rel=1e-6)
        assert process.hvar(m) == pytest.approx((15 * one - 6 * two + three) / (6 * m**2), rel=1e-6)


def test_short_windows_keep_their_precision():
    # At m = 1 the Allan variance is the mean square step: 1 - p, here 1e-9.
    process = ExponentialCovariance((1.0,), (1e-9,))
    assert process.avar(1) == pytest.approx(1e-9, rel=1e-6)
    assert process.hvar(1) == pytest.approx(1e-9 * 2 / 3, rel=1e-6)
    assert process.avar(1000) == pytest.approx(2e-9 * 1000 / 3, rel=1e-5)


@pytest.mark.parametrize("process", PROCESSES)
def test_spectrum_is_the_transform_of_the_autocovariance(process):
    w = np.array([0.01, 0.2, 1.0, 3.0])
    lag = np.arange(1, 200_000)
    gamma = process.autocovariance(lag)
    series = [process.autocovariance(0) + 2 * np.sum(gamma * np.cos(x * lag)) for x in w]
    np.testing.assert_allclose(process.spectrum(w), series, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("stride", [2, 5, 40, 700])
@pytest.mark.parametrize("process", PROCESSES)
def test_averaging_in_blocks_gives_the_covariance_of_the_means(process, stride):
    means = process.averaged(stride)
    inner = np.arange(-(stride - 1), stride)
    weight = stride - np.abs(inner)
    for h in range(4):
        direct = np.sum(weight * process.autocovariance(h * stride + inner)) / stride**2
        assert means.autocovariance(h) == pytest.approx(direct, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("process", [*PROCESSES, PROCESSES[0].averaged(400)])
def test_ordinates_are_quadratic_forms_of_the_covariance(process):
    n = 40
    rows = np.arange(n)
    matrix = process.autocovariance(rows[:, np.newaxis] - rows)
    for k in (1, 2, 3, 20, 39):
        cosine = np.sqrt(2 / n) * np.cos(np.pi * k * (rows + 0.5) / n)
        assert process.ordinates(k, n) == pytest.approx(cosine @ matrix @ cosine, rel=1e-7)


def test_means_cannot_be_averaged_again_where_that_would_be_wrong():
    with pytest.raises(ValueError, match="samples themselves"):
        PROCESSES[0].averaged(400).averaged(2)


@pytest.mark.parametrize("stride", [1, 40])
def test_the_misfit_of_powers_is_that_of_the_spectrum(stride: int) -> None:
    rng = np.random.default_rng(5)
    w = np.linspace(0.01, 3.0, 403)
    covariance = ExponentialCovariance.second_order(0.8, 0.05).averaged(stride)
    beside, power = rng.uniform(0.5, 2.0, len(w)), rng.exponential(2.0, len(w))
    expected = beside + 0.7 * covariance.spectrum(w)
    misfit = covariance.misfit(0.7, 2 * np.sin(w / 2) ** 2, power, beside)
    assert misfit == pytest.approx(np.sum(np.log(expected) + power / expected), rel=1e-12)
