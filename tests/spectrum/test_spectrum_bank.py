"""The streaming spectrum against known truth, and its laws: split, merge, gap, state."""

import numpy as np
import pytest

from allanscope.spectrum import SEGMENT, SpectrumBank
from allanscope.spectrum.density import independent_averages
from allanscope.spectrum.ladder import TAPS, Decimator, hann

RATE = 104.0


def bank_of(samples, block=5000, rate=RATE):
    bank = SpectrumBank(rate, samples.shape[1])
    for first in range(0, len(samples), block):
        bank.update(samples[first : first + block])
    return bank


def white(n, axes=1, seed=1, sigma=1.0):
    return sigma * np.random.default_rng(seed).standard_normal((n, axes))


def test_white_noise_is_flat_at_every_level_and_scattered_as_its_averages_say():
    densities = bank_of(white(600_000, axes=8), block=50_000).densities()
    z = np.array([(d.density * RATE / 2 - 1) * np.sqrt(d.averages) for d in densities])
    bands = z[:, densities[0].averages > 3]
    assert bands.shape[1] > 150
    assert abs(bands.mean()) < 0.1
    assert 0.85 < bands.std() < 1.02
    total = [np.average(d.density, weights=d.averages) * RATE / 2 for d in densities]
    assert np.mean(total) == pytest.approx(1.0, abs=4e-3)


def test_sums_over_bands_have_the_variance_that_the_averages_promise():
    # 256 short records: their weighted mean density scatters by 1 / sqrt(sum of averages).
    densities = bank_of(white(5 * SEGMENT, axes=256)).densities()
    high = densities[0].averages > 10
    means = [np.average(d.density[high], weights=d.averages[high]) for d in densities]
    promised = 1 / np.sqrt(densities[0].averages[high].sum())
    assert np.std(means) * RATE / 2 == pytest.approx(promised, rel=0.12)


def test_random_walk_density_is_right_over_five_decades():
    steps = white(1_500_000, axes=2, seed=3)
    density = bank_of(np.cumsum(steps, axis=0)).density(0)
    expected = 1 / RATE / (2 * np.sin(np.pi * density.frequency / RATE) ** 2)
    ratio = density.density / expected
    assert density.frequency[0] < 5e-4
    for low in (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0):
        decade = (density.frequency >= low) & (density.frequency < 10 * low)
        weights = density.averages[decade]
        mean = np.average(ratio[decade], weights=weights)
        assert abs(mean - 1) * np.sqrt(weights.sum()) < 3.5


def test_a_line_shows_once_at_its_frequency_with_its_power():
    t = np.arange(400_000) / RATE
    line = 3.0 * np.sin(2 * np.pi * 30.0 * t)[:, np.newaxis] + white(len(t), seed=4, sigma=1e-3)
    density = bank_of(line).density(0, per_decade=None)
    power = density.density * density.width
    near = np.abs(density.frequency - 30.0) < 0.3
    assert density.frequency[np.argmax(density.density)] == pytest.approx(30.0, abs=0.05)
    assert power[near].sum() == pytest.approx(4.5, rel=2e-3)
    # Whatever folds to lower levels is at least 75 dB down.
    assert power[density.frequency < 25.0].max() < 4.5 * 10**-7.5


def test_a_slow_line_is_resolved_at_a_deep_level():
    t = np.arange(1_000_000) / RATE
    line = np.sin(2 * np.pi * 0.02 * t)[:, np.newaxis] + white(len(t), seed=5)
    density = bank_of(line).density(0, per_decade=None)
    peak = np.argmax(density.density)
    assert density.frequency[peak] == pytest.approx(0.02, abs=1e-3)
    near = np.abs(density.frequency - 0.02) < 4e-3
    assert (density.density * density.width)[near].sum() == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize("block", [1, 7, 333, 4096, 100_000])
def test_splitting_the_stream_changes_nothing(block):
    samples = white(9_000, axes=2, seed=6)
    whole, split = bank_of(samples, block=9_000), bank_of(samples, block=block)
    for one, other in zip(whole.densities(), split.densities(), strict=True):
        np.testing.assert_allclose(one.density, other.density, rtol=1e-4)
        np.testing.assert_array_equal(one.averages, other.averages)


def test_counts_and_values_agree_through_scale_and_rate():
    counts = np.round(white(30_000, axes=1, seed=7, sigma=20)).astype(np.int16)
    by_scale = bank_of(counts, rate=104.0).density(0, rate=99.0, scale=0.5)
    direct = bank_of(counts * 0.5, rate=99.0).density(0)
    np.testing.assert_allclose(by_scale.frequency, direct.frequency)
    np.testing.assert_allclose(by_scale.density, direct.density, rtol=1e-4)


def test_one_g_on_an_axis_does_not_leak():
    noise = np.round(white(200_000, axes=1, seed=8, sigma=2)).astype(np.int16)
    still = bank_of(noise).density(0)
    tilted = bank_of(noise + np.int16(16393)).density(0)
    np.testing.assert_allclose(still.density, tilted.density, rtol=1e-3)


def test_a_gap_joins_nothing():
    samples = white(40_000, axes=1, seed=9)
    stepped = samples + np.where(np.arange(40_000) < 20_000, 0.0, 1e4)[:, np.newaxis]
    bank = SpectrumBank(RATE, 1)
    bank.update(stepped[:20_000])
    bank.gap()
    bank.update(stepped[20_000:])
    density = bank.density(0)
    assert np.max(density.density * RATE / 2) < 12.0
    joined = bank_of(stepped).density(0)
    assert np.max(joined.density) > 1e3 * np.max(density.density)


def test_merge_equals_one_bank_with_a_gap():
    samples = white(50_000, axes=2, seed=10)
    first, second = bank_of(samples[:30_000]), bank_of(samples[30_000:])
    whole = SpectrumBank(RATE, 2)
    whole.update(samples[:30_000])
    whole.gap()
    whole.update(samples[30_000:])
    whole.gap()
    first.merge(second)
    assert first.samples == whole.samples == 50_000
    for one, other in zip(first.densities(), whole.densities(), strict=True):
        np.testing.assert_allclose(one.density, other.density, rtol=1e-3)
        np.testing.assert_array_equal(one.averages, other.averages)


def test_state_goes_on_where_it_stopped():
    samples = np.round(white(20_000, axes=3, seed=11, sigma=30)).astype(np.int16)
    bank = bank_of(samples[:7_777])
    copy = SpectrumBank.from_state(bank.state())
    for one in (bank, copy):
        one.update(samples[7_777:])
    np.testing.assert_array_equal(bank.density(2).density, copy.density(2).density)


def test_state_survives_a_file_and_says_when_it_is_damaged(tmp_path):
    bank = bank_of(white(20_000, axes=2, seed=11))
    np.savez(tmp_path / "state.npz", **bank.state())
    with np.load(tmp_path / "state.npz") as file:
        copy = SpectrumBank.from_state(file)
    np.testing.assert_array_equal(bank.density(1).density, copy.density(1).density)
    good = bank.state()
    broken = [
        {},
        {**good, "format": np.array("something else")},
        {**good, "power": good["power"][:, :1]},
        {**good, "power": good["power"] * np.nan},
        {**good, "pending_sizes": good["pending_sizes"] + 1},
        {**good, "anchor": np.zeros(7)},
        {key: value for key, value in good.items() if key != "rest"},
    ]
    for state in broken:
        with pytest.raises(ValueError, match="state of a spectrum"):
            SpectrumBank.from_state(state)
    assert len(SpectrumBank.from_state(SpectrumBank(RATE, 3).state()).density(0).density) == 0


def test_adding_leaves_both_as_they_were():
    one, other = bank_of(white(9000, seed=16)), bank_of(white(9000, seed=17))
    total = one + other
    assert (one.samples, other.samples, total.samples) == (9000, 9000, 18_000)
    assert total.density(0).averages.sum() > 1.8 * one.density(0).averages.sum()


def test_state_stays_small():
    bank = bank_of(white(3_000_000, axes=1, seed=12, sigma=5.0), block=200_000, rate=6664.0)
    assert sum(array.nbytes for array in bank.state().values()) < 300_000


def test_a_short_run_has_a_spectrum_too():
    bank = bank_of(white(500, seed=13))
    density = bank.density(0)
    assert 0.4 < density.frequency[0] < 1.0
    assert density.frequency[-1] > 0.45 * RATE
    mean = np.average(density.density, weights=density.averages) * RATE / 2
    assert mean == pytest.approx(1.0, abs=0.3)
    assert len(bank_of(white(20)).density(0).density) == 0


def test_bands_do_not_overlap_and_reach_from_the_run_to_nyquist():
    density = bank_of(white(300_000, seed=14)).density(0)
    low = density.frequency - density.width / 2
    high = density.frequency + density.width / 2
    assert np.all(low[1:] >= high[:-1] * (1 - 1e-9))
    assert low[0] * (300_000 / RATE) < 20
    assert high[-1] == pytest.approx(RATE / 2, rel=1e-3)


@pytest.mark.parametrize(
    ("samples", "words"),
    [(np.zeros((5, 2)), "shape"), (np.full((5, 3), np.nan), "not finite"), (np.zeros(5), "shape")],
)
def test_bad_samples_are_refused(samples, words):
    with pytest.raises(ValueError, match=words):
        SpectrumBank(RATE, 3).update(samples)


def test_bad_banks_are_refused():
    with pytest.raises(ValueError, match="rate"):
        SpectrumBank(0.0, 3)
    with pytest.raises(ValueError, match="axis"):
        SpectrumBank(1.0, 0)
    with pytest.raises(ValueError, match="cannot merge"):
        SpectrumBank(1.0, 1).merge(SpectrumBank(1.0, 2))
    with pytest.raises(ValueError, match="2 Hz"):
        SpectrumBank(1.0, 1).merge(SpectrumBank(2.0, 1))
    for anchor in ([1.0, 2.0], 1.0, [np.nan]):
        with pytest.raises(ValueError, match="finite anchors"):
            SpectrumBank(1.0, 1, anchor=anchor)


def test_the_low_pass_is_flat_where_it_is_read_and_closed_where_that_folds_from():
    gain = np.abs(np.fft.rfft(TAPS.astype(np.float64), 4096)) ** 2
    turns = np.linspace(0, 0.5, len(gain))
    assert np.abs(gain[turns <= 0.075] - 1).max() < 5e-4
    assert gain[turns >= 0.175].max() < 10**-7


def test_the_decimator_is_a_plain_convolution():
    samples = white(1_000, axes=2, seed=15).T.astype(np.float32)
    decimator = Decimator(2)
    out = np.concatenate([decimator.push(part) for part in np.split(samples, [3, 50, 777], 1)], 1)
    expected = [np.convolve(row, TAPS[::-1], "valid")[::4] for row in samples]
    np.testing.assert_allclose(out, expected, atol=1e-5)


def test_window_correlations_are_those_of_the_window():
    window = hann(SEGMENT).astype(np.float64)
    turns = np.exp(-2j * np.pi * np.outer(np.arange(4), np.arange(SEGMENT)) / SEGMENT)
    same = np.abs(turns @ window**2 / SEGMENT) ** 2
    half = SEGMENT // 2
    following = np.abs(turns[:, :half] @ (window[:half] * window[half:]) / SEGMENT) ** 2
    total = same[0] + 2 * same[1:].sum() + 2 * (following[0] + 2 * following[1:].sum())
    assert float(independent_averages(1e9, 1e6)) / 1e15 == pytest.approx(1 / total, rel=1e-4)
    assert float(independent_averages(1e9, 1.0, alone=True)) / 1e9 == pytest.approx(
        1 / (1 + 2 * following[0]), rel=1e-4
    )
