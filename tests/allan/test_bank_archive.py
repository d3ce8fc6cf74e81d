"""The archive holds the run in few rows, and what is evaluated from them is what it should be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.allan import AllanBank
from allanscope.allan.archive import Archive
from allanscope.allan.estimators.htotdev import htot_variance
from allanscope.allan.estimators.mtotdev import mtot_variance
from allanscope.allan.estimators.theo1 import (
    _sum_of_powers,
    theo1_profile,
    theo1_variance,
    thinned_theo1_variance,
    variance_of,
)
from allanscope.allan.estimators.theobr import theobr_ratio

ROWS = 16
SIZES = st.lists(st.integers(0, 200), min_size=1, max_size=8)


def segments(sizes):
    rng = np.random.default_rng(len(sizes))
    return [rng.integers(-50, 50, (2, n)).astype(float) for n in sizes]


def archive_of(parts, block=None):
    archive = Archive(2, rows=ROWS)
    for i, part in enumerate(parts):
        if i:
            archive.gap()
        for start in range(0, part.shape[1], block or max(part.shape[1], 1)):
            archive.extend(part[:, start : start + block].T if block else part.T)
    return archive


@settings(max_examples=80, deadline=None)
@given(sizes=SIZES, block=st.integers(1, 40))
def test_rows_depend_neither_on_blocks_nor_on_when_they_were_thinned(sizes, block):
    parts = segments(sizes)
    archive, split = archive_of(parts), archive_of(parts, block)
    stride = archive.stride
    assert split.stride == stride
    rows = sum(n // stride for n in sizes)
    assert archive.used == split.used == rows <= ROWS
    assert stride == 1 or sum(n // (stride // 2) for n in sizes) > ROWS
    np.testing.assert_array_equal(archive.sums, split.sums)
    assert archive.starts == split.starts


@settings(max_examples=80, deadline=None)
@given(sizes=SIZES)
def test_phases_are_those_of_the_segments(sizes):
    parts = segments(sizes)
    archive = archive_of(parts)
    stride = archive.stride
    for axis in range(2):
        expected = [np.append(0.0, part[axis].cumsum()) for part in parts]
        long = [x for x in expected if x.size > stride]
        picked = [x for x in archive.picked(axis) if x.size > 1]
        averaged = [x for x in archive.averaged(axis) if x.size > (stride == 1)]
        assert len(picked) == len(averaged) == len(long)
        for x, at_borders, over_rows in zip(long, picked, averaged, strict=True):
            rows = (x.size - 1) // stride
            np.testing.assert_allclose(at_borders, x[: rows * stride + 1 : stride], atol=1e-9)
            if stride > 1:
                means = x[: rows * stride].reshape(rows, stride).mean(axis=1)
                np.testing.assert_allclose(over_rows, means, atol=1e-9)
            else:
                np.testing.assert_allclose(over_rows, x, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(left=SIZES, right=SIZES)
def test_merged_archives_are_those_of_one_pass(left, right):
    parts = segments([*left, *right])
    merged = archive_of(parts[: len(left)])
    merged.merge(archive_of(parts[len(left) :]))
    one_pass = archive_of(parts)
    one_pass.gap()
    assert merged.stride == one_pass.stride
    assert merged.starts == one_pass.starts
    np.testing.assert_allclose(merged.sums, one_pass.sums, atol=1e-9)


def test_the_drift_is_found_in_every_segment_whatever_its_level():
    slope = np.array([0.25, -3.0])
    parts = [slope[:, np.newaxis] * np.arange(n) + level for n, level in ((90, 5), (40, -800))]
    np.testing.assert_allclose(archive_of(parts).drift(), slope, rtol=1e-12)
    assert not Archive(2).drift().any()


def noises(n, seed=11):
    rng = np.random.default_rng(seed)
    white = rng.normal(size=n)
    spectrum = np.fft.rfft(rng.normal(size=2 * n))
    spectrum[1:] /= np.sqrt(np.arange(1, spectrum.size))
    spectrum[0] = 0
    return {
        "white PM": np.diff(rng.normal(size=n + 1)),
        "white FM": white,
        "flicker FM": np.fft.irfft(spectrum)[:n],
        "random walk": white.cumsum(),
    }


@pytest.mark.parametrize("name", noises(8))
def test_thinned_totals_and_theo1_stay_near_those_of_the_full_rate(name):
    """One record of 2^15 samples, four to a row, at m of 128, 512 and 2048 samples."""
    n = 1 << 15
    data = noises(n)[name]
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(data)
    bank.update(np.zeros(0))
    phase = np.append(0.0, (data - data.mean()).cumsum())
    # The whiter the phase the more neighbouring windows differ: scatter, the mean error is less.
    mtot, htot, theo1 = {
        "white PM": (0.015, 0.08, 0.06),
        "white FM": (0.005, 0.02, 0.02),
    }.get(name, (0.003, 0.005, 0.004))
    allowed = {
        "mtotdev": (mtot_variance, mtot),
        "htotdev": (htot_variance, htot),
        "theo1": (theo1_variance, theo1),
    }
    assert bank._archive.stride == 4
    for kind, (definition, tolerance) in allowed.items():
        curve = bank.deviation(kind, bias_corrected=False)
        assert curve.m[0] == 128
        for m in (128, 512, 2048):
            full = np.sqrt(definition(phase, m, max(m // 64, 1))[0])
            assert curve.deviation[0, curve.m == m] == pytest.approx(full, rel=tolerance)


@pytest.mark.parametrize(("name", "tolerance"), [("white FM", 0.005), ("white PM", 0.03)])
def test_thinned_theo1_has_no_bias_at_its_shortest_window(name, tolerance):
    """Eight records; the distances below the first row carry a third of THEO1 for white PM."""
    errors = []
    for seed in range(8):
        phase = np.append(0.0, noises(1 << 13, seed)[name].cumsum())
        thinned, windows = thinned_theo1_variance(phase[::16], 32, 16)
        assert windows == (1 << 13) // 16 + 1 - 32
        errors.append(np.sqrt(thinned / theo1_variance(phase, 512)[0]) - 1)
    assert abs(np.mean(errors)) < tolerance


@pytest.mark.parametrize("stride", [1, 3, 7, 100, 1000])
@pytest.mark.parametrize("m", [10, 64, 402])
def test_a_profile_of_some_windows_is_theo1_of_the_same(m, stride):
    phase = np.random.default_rng(3).normal(size=700).cumsum()
    expected, windows = theo1_variance(phase, m, stride)
    assert variance_of(theo1_profile(phase, m, stride)) == pytest.approx(expected, rel=1e-12)
    assert windows == len(range(0, 700 - m, stride))


def test_a_long_run_tells_how_many_windows_it_took():
    """Rows of two samples: as many windows as start at every 128th of m, or of one row."""
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(noises(1 << 14)["white FM"])
    assert bank._archive.stride == 2
    theo1, mtot = bank.deviation("theo1"), bank.deviation("mtotdev")
    rows = theo1.m // 2
    wanted = [len(range(0, (1 << 13) + 1 - k, max(k // 128, 1))) for k in rows.tolist()]
    assert theo1.terms[0].tolist() == wanted
    averaged = [
        len(range(0, (1 << 13) - 3 * k + 1, max(k // 8, 1))) for k in (mtot.m // 2).tolist()
    ]
    assert mtot.terms[0].tolist() == averaged


@pytest.mark.parametrize("exponent", [-1.0, -0.5, 0.0, 0.3, 1.0])
@pytest.mark.parametrize("last", [6.0, 24.0, 64.0, 96.0, 24_576.0])
def test_long_sums_of_powers_are_integrals(exponent, last):
    exact = np.sum(np.arange(1.0, last + 1) ** exponent)
    assert _sum_of_powers(last, exponent) == pytest.approx(exact, rel=1e-5)


def test_thinned_theobr_stays_near_that_of_the_full_rate():
    n = 1 << 15
    data = noises(n)["flicker FM"]
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(data)
    phase = np.append(0.0, data.cumsum())
    ratio = theobr_ratio(phase)
    curve = bank.deviation("theobr")
    for m, tolerance in ((128, 0.03), (4096, 0.01), (16384, 0.01)):
        full = np.sqrt(ratio * theo1_variance(phase, m, max(m // 64, 1))[0])
        assert curve.deviation[0, curve.m == m] == pytest.approx(full, rel=tolerance)


def test_theoh_is_oadev_up_to_a_tenth_of_the_run_and_theobr_above():
    bank = AllanBank(1.0, axes=1, per_octave=4)
    bank.update(noises(20_000)["random walk"])
    theoh, oadev, theobr = (bank.deviation(kind) for kind in ("theoh", "oadev", "theobr"))
    assert np.all(np.diff(theoh.tau) > 0)
    short = theoh.tau <= 2000
    np.testing.assert_array_equal(theoh.deviation[:, short], oadev.deviation[:, : short.sum()])
    np.testing.assert_array_equal(
        theoh.deviation[:, ~short], theobr.deviation[:, theobr.tau > 2000]
    )
    assert theoh.tau[-1] > 0.6 * 20_000


def test_one_exact_segment_is_not_diluted_by_a_gap():
    data = noises(600)["white FM"]
    bank, plain = (AllanBank(1.0, axes=1, per_octave=2) for _ in range(2))
    plain.update(data)
    bank.update(data[:10])
    bank.gap()
    bank.update(data)
    for kind in ("mtotdev", "htotdev", "theo1", "theobr"):
        curve, alone = bank.deviation(kind), plain.deviation(kind)
        long = alone.m > 12
        np.testing.assert_allclose(
            curve.deviation[:, np.isin(curve.m, alone.m[long])],
            alone.deviation[:, long],
            rtol=0.05,  # the noise type, hence the bias, may be told differently
        )


@pytest.mark.parametrize("period", [2, 4, 8, 64])
@pytest.mark.parametrize("kind", ["theo1", "theobr", "theoh"])
def test_a_periodic_record_divides_by_no_zero(kind, period):
    """Rows a whole number of periods apart differ by nothing: log2 of 0 warned."""
    bank = AllanBank(1.0, axes=1)
    bank.update(np.tile(np.arange(period), 40_000 // period))
    curve = bank.deviation(kind)
    assert not np.isinf(curve.deviation).any()
    phase = np.tile([0.0, 1.0, 3.0, 1.0], 60)
    variance, windows = thinned_theo1_variance(phase, 32, 4)
    assert np.isfinite(variance)
    assert windows == phase.size - 32
