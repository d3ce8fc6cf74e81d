"""Blocks, gaps, merging: whatever happens to the stream, the sums are those of its segments."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from allanscope.allan import AllanBank
from allanscope.allan.estimators import REGISTRY
from allanscope.samples import Block, Ticks

KINDS = sorted(REGISTRY)
CUTS = st.lists(st.integers(0, 3000), max_size=6)


def samples(n, axes=2, seed=0, integer=True):
    rng = np.random.default_rng(seed)
    data = 1000 + rng.normal(scale=30, size=(n, axes)) + rng.normal(size=(n, axes)).cumsum(axis=0)
    return data.astype(np.int16) if integer else data


def pieces(data, cuts):
    return np.split(data, sorted(min(cut, len(data)) for cut in cuts))


def bank_of(segments, axes=2):
    """Return a bank that saw arrays with a gap between each two."""
    bank = AllanBank(100.0, axes=axes, per_octave=2)
    for i, segment in enumerate(segments):
        if i:
            bank.gap()
        bank.update(segment)
    return bank


def assert_same_curves(one, other, rtol, kinds=KINDS):
    for kind in kinds:
        a, b = one.deviation(kind), other.deviation(kind)
        np.testing.assert_array_equal(a.m, b.m)
        np.testing.assert_array_equal(a.terms, b.terms)
        np.testing.assert_allclose(a.deviation, b.deviation, rtol=rtol, atol=0, err_msg=kind)


@settings(max_examples=40, deadline=None)
@given(n=st.integers(0, 3000), cuts=CUTS, integer=st.booleans())
def test_any_split_into_blocks_gives_the_same_bits(assert_identical, n, cuts, integer):
    data = samples(n, integer=integer)
    whole = bank_of([data])
    split = AllanBank(100.0, axes=2, per_octave=2)
    for i, piece in enumerate(pieces(data, cuts)):
        split.update(piece)
        if i % 2:
            split.deviation("oadev")  # a look in between must not change anything
    assert_identical(whole, split)


def test_samples_one_by_one_give_the_same_bits(assert_identical):
    data = samples(1100)
    split = AllanBank(100.0, axes=2, per_octave=2)
    for row in data:
        split.update(row[np.newaxis])
    assert_identical(bank_of([data]), split)


def test_blocks_longer_than_the_conversion_buffer_give_the_same_bits(assert_identical):
    data = samples(50_000)
    split = AllanBank(100.0, axes=2, per_octave=2)
    for piece in np.array_split(data, 7):
        split.update(Block(index=0, counts=piece, ticks=Ticks.none()))
    assert_identical(bank_of([data]), split)


@settings(max_examples=30, deadline=None)
@given(n=st.integers(0, 3000), cuts=CUTS)
def test_no_term_spans_a_gap(n, cuts):
    """Sums over segments are the sums of each, so the pooled variance is their weighted mean."""
    data = samples(n)
    segments = pieces(data, cuts)
    together = bank_of(segments)
    alone = [bank_of([segment]) for segment in segments]
    for kind in ("adev", "oadev", "hdev", "ohdev", "mdev", "pdev", "totdev"):
        whole = together._cascade.settled().variances(kind)
        parts = [bank._cascade.settled().variances(kind) for bank in alone]
        for t, m in enumerate(whole.m):
            found = [(part, np.flatnonzero(part.m == m)[0]) for part in parts if m in part.m]
            terms = sum(part.terms[:, at] for part, at in found)
            squares = sum(part.terms[:, at] * part.variance[:, at] for part, at in found)
            np.testing.assert_array_equal(whole.terms[:, t], terms)
            np.testing.assert_allclose(whole.variance[:, t], squares / terms, rtol=1e-11)


@settings(max_examples=30, deadline=None)
@given(n=st.integers(2, 3000), cuts=CUTS)
def test_the_standard_deviation_pools_all_segments_about_one_mean(n, cuts):
    segments = pieces(samples(n), cuts)
    for kind, step in (("ostdev", 1), ("stdev", None)):
        sums = bank_of(segments)._cascade.settled().variances(kind)
        for t, m in enumerate(sums.m.tolist()):
            every = 2 ** max(m.bit_length() - 6, 0) if step else m
            w = []
            for segment in segments:
                x = np.concatenate([np.zeros((1, 2)), segment.cumsum(axis=0, dtype=float)])
                w.append((x[m:] - x[:-m])[::every] / m if len(x) > m else x[:0])
            w = np.concatenate(w)
            assert sums.terms[0, t] == len(w)
            if len(w) > 1:
                np.testing.assert_allclose(
                    np.sqrt(sums.variance[:, t]), w.std(axis=0, ddof=1), rtol=1e-9, atol=1e-9
                )


def test_gaps_that_separate_nothing_change_nothing(assert_identical):
    data = samples(500)
    bank = AllanBank(100.0, axes=2, per_octave=2)
    bank.gap()
    bank.update(data[:300])
    bank.gap()
    bank.gap()
    bank.update(data[300:300])
    bank.gap()
    bank.update(data[300:])
    assert_identical(bank_of([data[:300], data[300:]]), bank)


@settings(max_examples=25, deadline=None)
@given(sizes=st.lists(st.integers(0, 1500), min_size=3, max_size=3), seed=st.integers(0, 99))
@example(sizes=[0, 2, 14], seed=0)  # windows of THEO1 beyond the record
def test_merging_is_one_pass_with_a_gap_between(sizes, seed):
    parts = [samples(n, seed=seed + i) for i, n in enumerate(sizes)]
    one_pass = bank_of([part for part in parts if len(part)])
    a, b, c = (bank_of([part]) for part in parts)
    left, right = (a + b) + c, a + (b + c)
    assert left.samples == right.samples == sum(sizes)
    assert_same_curves(left, one_pass, rtol=1e-10)
    assert_same_curves(right, left, rtol=1e-10)


def test_sums_of_integers_merge_without_any_rounding():
    parts = [samples(700, seed=1), samples(3000, seed=2), samples(40, seed=3)]
    a, b, c = (bank_of([part]) for part in parts)
    assert_same_curves(
        a + b + c, bank_of(parts), rtol=0, kinds=["oadev", "ohdev", "adev", "totdev"]
    )


def test_merging_long_runs_thins_their_archives_alike():
    parts = [samples(9000, seed=1), samples(20_000, seed=2)]
    a, b = (bank_of([part]) for part in parts)
    merged, one_pass = a + b, bank_of(parts)
    assert_same_curves(merged, one_pass, rtol=1e-9)
    assert_same_curves(b + a, one_pass, rtol=1e-9, kinds=["oadev", "mdev", "stdev"])


def test_adding_leaves_both_banks_as_they_were():
    a, b = bank_of([samples(300)]), bank_of([samples(200)])
    before = a.state(), b.state()
    total = a + b
    total.update(samples(100))
    for bank, state in zip((a, b), before, strict=True):
        for name, array in bank.state().items():
            np.testing.assert_array_equal(array, state[name])


def test_a_merged_bank_goes_on_in_a_segment_of_its_own():
    a, b, c = samples(300, seed=1), samples(200, seed=2), samples(400, seed=3)
    bank = bank_of([a])
    bank.merge(bank_of([b]))
    bank.update(c)
    assert_same_curves(bank, bank_of([a, b, c]), rtol=1e-10)


def test_banks_that_do_not_fit_are_not_merged():
    bank = bank_of([samples(10)])
    for other in (
        AllanBank(100.0, axes=3, per_octave=2),
        AllanBank(100.0, axes=2, per_octave=4),
        AllanBank(100.0, axes=2, per_octave=2, scale=[1.0, 2.0]),
    ):
        with pytest.raises(ValueError, match="cannot be merged"):
            bank.merge(other)


@settings(max_examples=20, deadline=None)
@given(n=st.integers(1, 2500), cuts=CUTS)
def test_axes_do_not_know_of_each_other(n, cuts):
    data = samples(n, axes=3)
    together = bank_of(pieces(data, cuts), axes=3)
    for axis in range(3):
        alone = bank_of(pieces(data[:, axis : axis + 1], cuts), axes=1)
        for kind in ("oadev", "mdev", "stdev", "totdev", "mtotdev", "theoh"):
            curve, single = together.deviation(kind), alone.deviation(kind)
            np.testing.assert_array_equal(curve.deviation[axis], single.deviation[0])
            np.testing.assert_array_equal(curve.noise[axis], single.noise[0])


@pytest.mark.parametrize("integer", [True, False])
@pytest.mark.parametrize("axes", [1, 3, 4, 5, 8, 11])
def test_an_axis_has_the_same_bits_whatever_lies_beside_it(axes, integer):
    """Axes are summed up in registers of four; the last row of an array ends what may be read."""
    data = samples(9000, axes, seed=3, integer=integer)
    together = bank_of([data[:3001], data[3001:]], axes)
    for axis in range(axes):
        alone = bank_of([data[:3001, axis : axis + 1], data[3001:, axis : axis + 1]], axes=1)
        for kind in ("oadev", "mdev", "pdev", "stdev", "totdev", "ttotdev"):
            curve, single = together.deviation(kind), alone.deviation(kind)
            np.testing.assert_array_equal(curve.deviation[axis], single.deviation[0])


def test_counts_have_the_same_bits_whatever_their_type(assert_identical):
    data = samples(9000, seed=4)
    for kind in (np.int32, np.float64):
        assert_identical(bank_of([data]), bank_of([data.astype(kind)]))


def test_the_noise_type_is_told_from_the_streamed_sums():
    rng = np.random.default_rng(4)
    white = rng.normal(size=(20_000, 1))
    data = np.hstack([np.diff(white, axis=0, prepend=0), white, white.cumsum(axis=0)])
    bank = bank_of([data], axes=3)
    for kind in ("oadev", "mdev", "htotdev", "theoh"):
        curve = bank.deviation(kind)
        middle = (curve.m >= 2) & (curve.m <= 200)
        assert (curve.noise[:, middle] == [["WPM"], ["WFM"], ["RWFM"]]).all()
    assert bank.deviation("oadev").noise[:, 0].tolist() == ["WPM", "WFM", "RWFM"]


def test_the_rate_and_the_scale_enter_at_the_query():
    data = samples(2000)
    bank = AllanBank(100.0, axes=2, per_octave=2, scale=[1.0, 0.5])
    bank.update(data)
    counts = bank_of([data])
    for kind in KINDS:
        nominal, measured = bank.deviation(kind), bank.deviation(kind, rate=103.0)
        np.testing.assert_allclose(measured.tau * 103.0, nominal.tau * 100.0)
        per_s = 103.0 if kind in ("tdev", "ttotdev") else 1.0
        np.testing.assert_allclose(
            measured.deviation * per_s, nominal.deviation * (100.0 if per_s > 1 else 1.0)
        )
        plain = counts.deviation(kind)
        np.testing.assert_array_equal(nominal.deviation[0], plain.deviation[0])
        np.testing.assert_allclose(nominal.deviation[1], 0.5 * plain.deviation[1])
        np.testing.assert_array_equal(nominal.noise, plain.noise)


def test_the_state_of_an_axis_stays_below_a_mebibyte_for_any_length():
    bank = AllanBank(6660.0, axes=6)
    bank.update(np.zeros((20_000, 6), np.int16))
    bank._cascade.grow(24)  # m = 2^28 and more, eleven hours at 6.66 kHz
    assert bank.deviation("oadev").m.size < bank._cascade.m.size
    assert bank._cascade.m.max() > 2**28
    assert bank.nbytes / 6 < 2**20


@pytest.mark.parametrize("kind", ["oadev", "ohdev", "mdev", "totdev", "adev", "pdev"])
def test_degrees_of_freedom_of_separate_segments_add_up(kind):
    """Ten stretches of 200 samples, m = 32: against the scatter of 1200 such estimates."""
    rng = np.random.default_rng(8)
    variances = []
    for _ in range(200):
        bank = AllanBank(1.0, axes=6, per_octave=1)
        for _ in range(10):
            bank.update(rng.normal(size=(200, 6)))
            bank.gap()
        curve = bank.deviation(kind)
        variances.append(curve.deviation[:, curve.m == 32] ** 2)
    true_edf = 2 * np.mean(variances) ** 2 / np.var(variances)
    white = curve.edf[:, curve.m == 32]
    assert np.median(white) == pytest.approx(true_edf, rel=0.15)


def test_a_stretch_too_short_for_a_tau_adds_no_degrees_of_freedom():
    data = samples(4000)
    alone = bank_of([data])
    with_scraps = bank_of([data, *np.split(samples(600, seed=9), 30)])
    for kind in KINDS:
        curve, expected = with_scraps.deviation(kind), alone.deviation(kind)
        at = np.isin(expected.m, curve.m) & (expected.m > 100) & np.isfinite(expected.edf[0])
        same_noise = curve.noise[0, np.isin(curve.m, expected.m[at])] == expected.noise[0, at]
        np.testing.assert_allclose(
            curve.edf[0, np.isin(curve.m, expected.m[at])][same_noise],
            expected.edf[0, at][same_noise],
            rtol=1e-6,
        )


@pytest.mark.parametrize("kind", sorted(REGISTRY))
def test_the_wait_ends_with_the_sample_that_brings_a_value(kind):
    rng = np.random.default_rng(30)
    bank = AllanBank(rate=10.0, axes=2)
    bank.update(rng.normal(size=(10, 2)))
    tau = 1.6 * REGISTRY[kind].tau_factor if kind != "theoh" else 9.6

    def known():
        curve = bank.deviation(kind)
        return np.isfinite(curve.deviation[:, np.isclose(curve.tau, tau)]).all(axis=0).any()

    missing = round(10 * bank.wait(kind, tau))
    assert missing > 0
    assert not known()
    bank.update(rng.normal(size=(missing - 1, 2)))
    assert not known()
    assert bank.wait(kind, tau) == pytest.approx(0.1)
    bank.update(rng.normal(size=(1, 2)))
    assert known()
    assert bank.wait(kind, tau) == 0.0


def test_what_a_gap_has_cut_off_is_waited_for_again():
    bank = AllanBank(rate=10.0, axes=1)
    bank.update(np.arange(30.0) % 7)
    assert bank.wait("oadev", 1.6) == pytest.approx(0.3)
    bank.gap()
    assert bank.wait("oadev", 1.6) == pytest.approx(3.3)
    assert bank.wait("oadev", 0.8) == 0.0
    with pytest.raises(ValueError, match="tau must be positive"):
        bank.wait("oadev", 0.0)
    with pytest.raises(ValueError, match="unknown estimator"):
        bank.wait("allan", 1.0)
