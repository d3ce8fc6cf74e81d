"""allantools as an oracle: values to 1e-10 and the same number of terms."""

import allantools
import numpy as np
import pytest

from allanscope.allan import deviation
from allanscope.allan.estimators import REGISTRY

FAST = ["adev", "oadev", "mdev", "tdev", "hdev", "ohdev", "totdev", "pdev"]
SLOW = ["mtotdev", "ttotdev", "htotdev", "theo1"]


def signals(n):
    rng = np.random.default_rng(14)
    white = rng.standard_normal(n)
    flicker = np.fft.irfft(
        np.fft.rfft(rng.standard_normal(2 * n)) / np.sqrt(np.arange(n + 1) + 1.0)
    )[:n]
    return {
        "white": white,
        "flicker": flicker,
        "random walk": np.cumsum(white),
        "ramp with noise": np.arange(n) * 0.1 + white,
        "int16 extremes": rng.choice([-32768, 32767], n).astype(np.int16),
        "int16 alternating": np.where(np.arange(n) % 2, 32767, -32768).astype(np.int16),
        "uint8": rng.integers(0, 256, n).astype(np.uint8),
    }


def compare(kind, data, rate, factors):
    factors = np.array([m for m in factors if REGISTRY[kind].needed(m) <= len(data)])
    curve = deviation(data, rate, kind, taus=factors / rate, bias_corrected=False)
    _, expected, _, terms = getattr(allantools, kind)(
        np.asarray(data, np.float64), rate=rate, data_type="freq", taus=factors / rate
    )
    assert curve.m.tolist() == factors.tolist()
    # Where the truth is zero allantools leaves rounding.
    np.testing.assert_allclose(curve.deviation, expected, rtol=1e-10, atol=1e-14 * max(expected))
    if kind != "theo1":  # allantools counts the inner sum as well
        assert curve.terms.tolist() == terms.tolist()


@pytest.mark.parametrize("name", signals(10))
@pytest.mark.parametrize("kind", FAST)
def test_fast_estimators_agree(kind, name):
    compare(kind, signals(500)[name], 100.0, np.array([1, 2, 3, 7, 30, 101, 155]))


@pytest.mark.parametrize("name", signals(10))
@pytest.mark.parametrize("kind", SLOW)
def test_slow_estimators_agree(kind, name):
    factors = np.array([2, 4, 10, 20]) if kind == "theo1" else np.array([1, 2, 3, 8, 13])
    compare(kind, signals(70)[name], 10.0, factors)


@pytest.mark.parametrize("kind", FAST)
def test_phase_is_read_as_allantools_reads_it(kind):
    phase = np.cumsum(signals(400)["random walk"])
    factors = np.array([1, 2, 5, 40])
    curve = deviation(phase, 4.0, kind, taus=factors / 4.0, data_kind="phase")
    _, expected, _, _ = getattr(allantools, kind)(phase, rate=4.0, taus=factors / 4.0)
    np.testing.assert_allclose(curve.deviation, expected, rtol=1e-10)
