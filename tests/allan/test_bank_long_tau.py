"""At long tau a stream has the terms of the archive: those of an array, or nearly."""

import numpy as np
import pytest

from allanscope.allan import AllanBank, deviation
from allanscope.allan.noise_type import NAMES

OVERLAPPING = ("ostdev", "oadev", "ohdev", "mdev", "tdev", "pdev", "totdev")
PLAIN = ("stdev", "adev", "hdev", *OVERLAPPING)


def both_ways(data, kind, per_octave=1):
    """Return the curves of a stream and of the array, on the taus that both have."""
    bank = AllanBank(1.0, axes=1, per_octave=per_octave)
    for i, part in enumerate(np.split(data, np.flatnonzero(np.isnan(data)))):
        if i:
            bank.gap()
        bank.update(part[~np.isnan(part)])
    stream = bank.deviation(kind).axis(0)
    return stream, deviation(data, 1.0, kind, [float(m) for m in stream.m])


@pytest.mark.parametrize("alpha", [2, 0, -2])
@pytest.mark.parametrize("kind", PLAIN)
def test_up_to_8192_samples_a_stream_and_an_array_have_one_curve(kind, alpha, power_law):
    data = power_law(alpha, 8192, 1, seed=12)[0][:8150]
    stream, array = both_ways(data, kind, per_octave=2)
    assert stream.m[-1] >= 1024
    np.testing.assert_array_equal(stream.terms, array.terms)
    np.testing.assert_array_equal(stream.noise, array.noise)
    for name in ("deviation", "lower", "upper", "edf"):
        ours, theirs = getattr(stream, name), getattr(array, name)
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, err_msg=name)


@pytest.mark.parametrize("kind", [kind for kind in OVERLAPPING if kind != "ostdev"])
def test_with_gaps_too(kind):
    data = np.random.default_rng(7).normal(size=6000)
    data[[1500, 1700, 4800]] = np.nan
    stream, array = both_ways(data, kind)
    assert stream.m[-1] >= 512
    np.testing.assert_array_equal(stream.terms, array.terms)
    np.testing.assert_allclose(stream.deviation, array.deviation, rtol=1e-8)
    np.testing.assert_allclose(stream.edf, array.edf, rtol=1e-8)


TOLERANCE = {
    "oadev": {1: 1.0, 0: 0.15, -1: 0.05, -2: 0.05},
    "ohdev": {1: 1.0, 0: 0.15, -1: 0.05, -2: 0.05},
    "mdev": {2: 0.2, 1: 0.05, 0: 0.05, -1: 0.05, -2: 0.05},
    "pdev": {2: 0.1, 1: 0.05, 0: 0.05, -1: 0.05, -2: 0.05},
    "totdev": {1: 1.2, 0: 0.15, -1: 0.05, -2: 0.05},
}
"""Largest difference of a stream from an array in standard errors of the array, by alpha."""


@pytest.mark.parametrize("kind", TOLERANCE)
def test_of_longer_runs_they_differ_by_a_part_of_the_standard_error(kind, power_law):
    for alpha, tolerance in TOLERANCE[kind].items():
        for data in power_law(alpha, 30_000, 3, seed=4):
            stream, array = both_ways(data, kind)
            keep = array.trusted & (array.m >= 64)
            off = np.abs(stream.deviation / array.deviation - 1.0) * np.sqrt(2.0 * array.edf)
            assert off[keep].max() < tolerance, (NAMES[alpha], array.m[keep], off[keep])
            assert (stream.noise == array.noise).all()


def test_rows_far_from_zero_keep_their_digits():
    """A rail for most of the run, and a first sample at the other one: against exact integers."""
    n, m = 1 << 18, 1 << 14
    data = np.round(3 * np.random.default_rng(2).normal(size=n)).astype(np.int64)
    data[0] = 32767
    data[1:200_000] -= 32000
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(data.astype(np.int16))
    stride = bank._archive.stride
    assert stride < m // 64
    x = np.append(0, data.cumsum())
    z = np.append(0, x[:-1].cumsum())[::stride]
    x, k = x[::stride], m // stride
    d = x[2 * k :] - 2 * x[k:-k] + x[: -2 * k]
    third = (z[3 * k :] - z[: -3 * k]) - 3 * (z[2 * k : -k] - z[k : -2 * k])
    allan = np.sqrt((d.astype(float) ** 2).mean() / 2) / m
    modified = np.sqrt((third.astype(float) ** 2).mean() / 2) / float(m) ** 2
    for kind, expected in (("oadev", allan), ("mdev", modified)):
        curve = bank.deviation(kind)
        assert curve.deviation[0, curve.m == m] == pytest.approx(expected, rel=1e-10)


def test_a_stream_has_a_value_where_its_rungs_have_one():
    """However close the rows: `wait` counts the terms of the rungs."""
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(np.random.default_rng(1).normal(size=1024 + 15))
    assert bank.wait("oadev", 512.0) > 0
    assert np.isnan(bank.deviation("oadev").deviation[0, -1])
    bank.update(np.random.default_rng(2).normal(size=round(bank.wait("oadev", 512.0))))
    assert np.isfinite(bank.deviation("oadev").deviation[0, -1])
