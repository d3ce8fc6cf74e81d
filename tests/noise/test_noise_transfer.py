"""Averaging samples into rows, in the frequency domain."""

import numpy as np
import pytest

from allanscope.noise.transfer import aliases, estimator_variance, fold, response

PHASE = np.array([0.01, 0.5, 1.5, 3.0])


def direct(spectrum, phase, stride):
    """Return the sum over all aliases, one by one."""
    w = (phase + 2 * np.pi * np.arange(stride)[:, np.newaxis]) / stride
    weight = (np.sin(phase / 2) / (stride * np.sin(w / 2))) ** 2
    return np.sum(weight * spectrum(w), axis=0) / stride


@pytest.mark.parametrize("stride", [1, 2, 3, 17, 33, 100, 4096])
@pytest.mark.parametrize(
    "spectrum",
    [
        np.ones_like,
        lambda w: 1 / np.abs(np.sin(w / 2)),
        lambda w: 1 / np.sin(w / 2) ** 2,
        lambda w: 1 / (1 + (np.minimum(w, 2 * np.pi - w) / 0.3) ** 4),
    ],
)
def test_folding_is_the_sum_over_aliases(spectrum, stride):
    np.testing.assert_allclose(
        fold(spectrum, PHASE, stride), direct(spectrum, PHASE, stride), rtol=1e-3
    )


@pytest.mark.parametrize("stride", [2, 17, 33, 1000])
def test_weights_of_the_aliases_sum_to_one_and_lie_in_the_band(stride):
    phases, weights = aliases(PHASE, stride)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    assert np.all(weights >= 0)
    assert np.all((phases > 0) & (phases <= np.pi + 1e-12))


@pytest.mark.parametrize("m", [1, 2, 7, 100, 5000, 10**6])
def test_integrals_of_power_laws_are_the_known_variances(m):
    def variance(spectrum, kind):
        return float(estimator_variance(spectrum, kind, m))

    white, walk = np.ones_like, lambda w: 1 / (4 * np.sin(w / 2) ** 2)
    assert variance(white, "avar") == pytest.approx(1 / m, rel=2e-6)
    assert variance(white, "hvar") == pytest.approx(1 / m, rel=2e-6)
    assert variance(white, "mvar") == pytest.approx((m**2 + 1) / (2 * m**3), rel=2e-6)
    assert variance(walk, "avar") == pytest.approx((2 * m**2 + 1) / (6 * m), rel=2e-6)
    assert variance(walk, "hvar") == pytest.approx((m**2 + 1) / (6 * m), rel=2e-6)


def test_mean_response_is_the_mean_over_a_period():
    w = np.linspace(1.0, 1.0 + 2 * np.pi / 1000, 20_001)[:-1]
    for kind in ("avar", "mvar", "hvar"):
        exact = np.mean(response(kind, w, 1000.0))
        assert exact == pytest.approx(np.mean(response(kind, w, 1000.0, mean=True)), rel=3e-3)
