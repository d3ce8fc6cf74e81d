"""Above m = 64 the cascade keeps every 2^L-th term, each exact, and loses next to nothing by it."""

import allantools
import numpy as np
import pytest

from allanscope.allan import AllanBank, kernels
from allanscope.allan.cascade import Cascade, lags_of_level
from allanscope.allan.kernels import BATCH, COLUMNS


def thinned(data, kind, m, stride):
    """Evaluate terms at every stride-th sample from definitions, in extended precision."""
    y = data.astype(np.longdouble) - int(data[0])
    x = np.append(np.longdouble(0), y.cumsum())
    z = np.append(np.longdouble(0), x.cumsum())[: x.size]
    q = np.append(np.longdouble(0), (z + x / 2).cumsum())[: x.size]

    def lag(series, times):
        start = 3 * m if kind in ("ohdev", "mdev") else 2 * m if kind != "ostdev" else m
        last = series.size - 1
        return series[start - times * m : last + 1 - times * m : stride]

    match kind:
        case "ostdev":
            w = lag(x, 0) - lag(x, 1)
            return ((w - w.mean()) ** 2).sum() / (w.size - 1) / m**2
        case "oadev":
            return ((lag(x, 0) - 2 * lag(x, 1) + lag(x, 2)) ** 2).mean() / 2 / m**2
        case "ohdev":
            d = lag(x, 0) - 3 * lag(x, 1) + 3 * lag(x, 2) - lag(x, 3)
            return (d**2).mean() / 6 / m**2
        case "mdev":
            d = lag(z, 0) - 3 * lag(z, 1) + 3 * lag(z, 2) - lag(z, 3)
            return (d**2).mean() / 2 / np.longdouble(m) ** 4
        case _:
            d = np.longdouble(m) / 2 * (lag(z, 0) - lag(z, 2))
            d -= lag(q, 0) - 2 * lag(q, 1) + lag(q, 2)
            return 72 * (d**2).mean() / np.longdouble(m) ** 6


def summed(bank, kind):
    """Return the factors and deviations of the cascade alone, without the rows of the archive."""
    sums = bank._cascade.settled().variances(kind)
    return sums.m, np.where(sums.terms > 1, np.sqrt(sums.variance), np.nan)[0]


def walk(n, seed=3):
    """Return int16 samples at 1 g, with noise, drift and a random walk."""
    rng = np.random.default_rng(seed)
    slow = 0.05 * rng.normal(size=n).cumsum() + 20 * np.arange(n) / n
    return np.clip(16384 + 10 * rng.normal(size=n) + slow, -32768, 32767).astype(np.int16)


@pytest.mark.parametrize("kind", ["ostdev", "oadev", "ohdev", "mdev", "pdev"])
def test_terms_of_the_upper_rungs_are_those_of_the_full_rate(kind):
    n = 40_000
    data = walk(n)
    bank = AllanBank(1.0, axes=1, per_octave=3)
    bank.update(data)
    factors, deviations = summed(bank, kind)
    for m, value in zip(factors.tolist(), deviations, strict=True):
        if m >= 64 and np.isfinite(value):
            stride = 2 ** (m.bit_length() - 6)
            assert value == pytest.approx(float(np.sqrt(thinned(data, kind, m, stride))), rel=1e-11)


@pytest.mark.parametrize("kind", ["adev", "hdev", "stdev"])
def test_kinds_without_overlap_lose_nothing_on_the_upper_rungs(kind):
    data = walk(40_000)
    bank = AllanBank(1.0, axes=1, per_octave=3)
    bank.update(data)
    curve = bank.deviation(kind)
    for m, value in zip(curve.m.tolist(), curve.deviation[0], strict=True):
        w = data[: data.size // m * m].reshape(-1, m).mean(axis=1)
        match kind:
            case "stdev":
                variance = np.var(w, ddof=1) if w.size > 1 else np.nan
            case "adev":
                variance = np.mean(np.diff(w) ** 2) / 2
            case _:
                variance = np.mean(np.diff(w, n=2) ** 2) / 6
        if np.isfinite(value):
            assert value == pytest.approx(np.sqrt(variance), rel=1e-9)


def test_thinning_changes_a_deviation_by_less_than_a_per_cent():
    """White noise, N = 16 m and more: 0.5, 0.7 and 0.07 % rms are the figures for R = 32."""
    limits = {"oadev": 0.006, "ohdev": 0.008, "mdev": 0.001}
    errors = {kind: [] for kind in limits}
    for seed in range(12):
        data = np.random.default_rng(seed).normal(size=1 << 15)
        bank = AllanBank(1.0, axes=1, per_octave=1)
        bank.update(data)
        for kind in limits:
            factors, deviations = summed(bank, kind)
            keep = (factors >= 64) & (factors <= data.size // 16)
            _, full, _, _ = getattr(allantools, kind)(
                data, rate=1.0, data_type="freq", taus=factors[keep].astype(float)
            )
            errors[kind].extend(deviations[keep] / full - 1)
    for kind, limit in limits.items():
        rms = np.sqrt(np.mean(np.square(errors[kind])))
        assert 0.1 * limit < rms < limit


def test_totdev_reflects_on_every_rung():
    data = walk(20_000)
    bank = AllanBank(1.0, axes=1, per_octave=2)
    bank.update(data)
    sums = bank._cascade.settled().variances("totdev")
    values = np.sqrt(sums.variance[0])
    for m, value, terms in zip(sums.m.tolist(), values, sums.terms[0], strict=True):
        stride = max(2 ** (m.bit_length() - 6), 1)
        x = np.append(0, (data - 16384.0).cumsum())[::stride]
        expected = allantools.totdev(x, rate=1.0, data_type="phase", taus=[float(m // stride)])
        if m // stride < x.size - 1:
            assert value == pytest.approx(expected[1][0] / stride, rel=1e-10)
            assert terms == expected[3][0]


@pytest.mark.parametrize("n", [1_000_000, pytest.param(10_000_000, marks=pytest.mark.slow)])
def test_a_long_run_far_from_zero_loses_no_digit(n):
    """16384 counts a sample, noise of one count, first differences exact in integers."""
    rng = np.random.default_rng(5)
    data = (16384 + rng.integers(-1, 2, n)).astype(np.int16)
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(data)
    x = np.append(0, data.astype(np.int64).cumsum())
    oadev, ohdev = bank.deviation("oadev"), bank.deviation("ohdev")
    for m in (1, 32, 1 << 12, 1 << 14):
        stride = min(max(m // 32, 1), bank._archive.stride)
        w = x[m:] - x[:-m]
        d = (w[m:] - w[:-m])[::stride]
        h = (w[2 * m :] - 2 * w[m:-m] + w[: -2 * m])[::stride]
        allan = np.sqrt(int((d * d).sum()) / d.size / 2) / m
        hadamard = np.sqrt(int((h * h).sum()) / h.size / 6) / m
        assert oadev.deviation[0, oadev.m == m] == pytest.approx(allan, rel=1e-13)
        assert ohdev.deviation[0, ohdev.m == m] == pytest.approx(hadamard, rel=1e-13)
    mdev = bank.deviation("mdev")
    d = x[2:] - 2 * x[1:-1] + x[:-2]
    assert mdev.deviation[0, 0] == pytest.approx(np.sqrt((d * d).mean() / 2), rel=1e-13)


def test_a_term_larger_than_an_int64_does_not_wrap():
    """A step of full scale makes third differences of 2^66 at m = 2^26: beyond any integer here."""
    level, k = 21, 32
    cascade = Cascade(axes=1, per_octave=1)
    cascade.grow(level + 1)
    stride, m = 1 << level, k << level
    # Hand the rung what samples would have brought it: half a batch low, then at full scale.
    rate = np.where(np.arange(BATCH) < BATCH // 2, 0.0, 65535.0)
    blocks = np.zeros((1, BATCH, 3))
    blocks[0, :, 0], blocks[0, :, 1] = rate * stride, rate * stride * (stride - 1) / 2.0
    kernels.add_block_sums(blocks, level, 0, cascade.ladder())
    x = np.append(0.0, np.cumsum(blocks[0, :, 0]))
    z = np.append(0.0, np.cumsum(stride * x[:-1] + blocks[0, :, 1]))
    third = z[3 * k :] - 3 * z[2 * k : -k] + 3 * z[k : -2 * k] - z[: -3 * k]
    assert np.abs(third).max() > 2.0**63
    summed = cascade.sums[0, cascade.m == m, COLUMNS.index("mdev")]
    assert summed == pytest.approx(np.sum(third**2), rel=1e-12)


def test_m_reaches_from_one_sample_to_the_whole_run():
    bank = AllanBank(1.0, axes=1, per_octave=4)
    bank.update(np.zeros(100_000, np.int16))
    m = bank.deviation("oadev").m
    assert m[0] == 1
    assert 1 / 1.2 < m[-1] / 50_000 <= 1
    assert np.all(np.diff(np.log2(m[m >= 8])) < 0.35)


def test_any_density_of_taus_is_served():
    for per_octave in (1, 2, 5, 12, 200):
        lags = lags_of_level(3, per_octave)
        assert lags[0] == 32
        assert lags[-1] < 64
        assert lags.size == min(per_octave, 32)


@pytest.mark.parametrize("sigma", [0.6, 20.0, 300.0, 5000.0])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_sums_of_whole_numbers_are_exact(sigma: float, level: int) -> None:
    """In 16 bits, in 32 and in doubles, by the size of the numbers and of the lag."""
    counts = np.rint(np.random.default_rng(8).normal(0.0, sigma, 6000)).astype(np.int64)
    cascade = Cascade(axes=1, per_octave=4)
    cascade.extend(counts[:, np.newaxis])
    settled = cascade.settled()
    x = np.append(0, counts.cumsum())
    z = np.append(0, x.cumsum())
    twice_q = np.append(0, (2 * z[:-1] + x).cumsum())
    x, z, twice_q = x[:: 1 << level], z[: None if level == 0 else -1 : 1 << level], twice_q[:-1]
    twice_q = twice_q[:: 1 << level]
    for t in range(cascade.first[level], cascade.first[level + 1]):
        k = int(cascade.lags[t])
        d = x[2 * k :] - 2 * x[k:-k] + x[: -2 * k]
        h = x[3 * k :] - 3 * x[2 * k : -k] + 3 * x[k : -2 * k] - x[: -3 * k]
        e = z[3 * k :] - 3 * z[2 * k : -k] + 3 * z[k : -2 * k] - z[: -3 * k]
        own_z, m = z[: x.size], k << level
        slope = m * (own_z[2 * k :] - own_z[: -2 * k])
        r = slope - (twice_q[2 * k :] - 2 * twice_q[k:-k] + twice_q[: -2 * k])
        apart = np.diff(x[::k], 2)
        terms = {"oadev": d, "ohdev": h, "mdev": e, "pdev": r, "adev": apart}
        terms |= {"hdev": np.diff(apart)}
        for kind, term in terms.items():
            wanted = (term.astype(np.longdouble) ** 2).sum() / (4 if kind == "pdev" else 1)
            found = settled.sums[0, t, COLUMNS.index(kind)]
            # No sum below 2^53 is rounded; those of PDEV are of quarters.
            assert found == pytest.approx(float(wanted), rel=0.0 if 4 * wanted < 2.0**53 else 1e-14)
