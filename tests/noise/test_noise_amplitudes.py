"""The maximum of a likelihood that is linear in variances."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.noise.amplitudes import maximise


@pytest.mark.parametrize("bins", [1, 4, 414, 415])
def test_the_log_likelihood_is_that_of_its_definition(bins: int) -> None:
    rng = np.random.default_rng(bins)
    shape = 10.0 ** rng.uniform(-30.0, 30.0, bins)
    count = rng.integers(1, 1000, bins).astype(float)
    power = shape * rng.chisquare(count) / count
    theta, loglik, variance = maximise(shape[np.newaxis], power, count, np.zeros(bins))
    assert variance == pytest.approx(np.maximum(theta[0] * shape, variance.min()), rel=1e-14)
    expected = -0.5 * np.sum(count * (np.log(variance) + power / variance))
    assert loglik == pytest.approx(expected, rel=1e-13)
