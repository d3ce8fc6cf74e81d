"""Data that the tests of this room share."""

import numpy as np
import pytest

from allanscope.verify.certified import TEN_POINTS, thousand_points


@pytest.fixture(scope="session")
def power_law():
    """Return a generator of Gaussian noise with S(f) ~ |2 sin(pi f)|^alpha, shape (runs, n)."""

    def generate(alpha, n, runs, seed):
        # The first half is thrown away: it still remembers that there was nothing before it.
        k = np.arange(1, 2 * n)
        response = np.append(1.0, np.cumprod((k - 1 - alpha / 2) / k))
        white = np.random.default_rng(seed).standard_normal((runs, 2 * n))
        spectrum = np.fft.rfft(white, 4 * n, axis=1) * np.fft.rfft(response, 4 * n)
        return np.fft.irfft(spectrum, 4 * n, axis=1)[:, n : 2 * n]

    return generate


@pytest.fixture(scope="session")
def nbs14_1000():
    """Return the 1000 points of NIST SP 1065 section 12.4: Lehmer's generator from 1234567890."""
    return thousand_points()


@pytest.fixture(scope="session")
def nbs14_10():
    """Return the nine frequencies of the 10-point set of NBS Monograph 140."""
    return np.array(TEN_POINTS)


@pytest.fixture(scope="session")
def assert_identical():
    """Fail unless two banks are in the same state, to the last bit."""

    def check(one, other):
        ours, theirs = one.state(), other.state()
        assert ours.keys() == theirs.keys()
        for name, array in ours.items():
            np.testing.assert_array_equal(array, theirs[name], err_msg=name)

    return check
