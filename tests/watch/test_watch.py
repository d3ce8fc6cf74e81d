"""The watch: what begins is found soon, named, and told to be there or gone."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.quantities import TWO_SIDED_95
from allanscope.samples import Gap, StreamInfo, Ticks
from allanscope.watch import ALPHA, Event, Watch
from allanscope.watch.false_alarms import log_weight
from allanscope.watch.lines import LineCusums
from allanscope.watch.scan import Scan, locate, moment_of_powers
from allanscope.watch.tracks import Track
from allanscope.watch.watch import ALPHA_SHARES

RATE = 104
INFO = StreamInfo(axes=("gx", "az"), scale=(0.00437, 6.1e-5), nominal_hz=float(RATE))
AT = 600
"""When changes begin, in s."""


def rows(seconds: int, seed: int = 1) -> np.ndarray:
    """White noise of 5 counts, with a little flicker of the level."""
    rng = np.random.default_rng(seed)
    slow = np.cumsum(rng.normal(0.0, 0.01, (seconds, 2)), axis=0)
    values = rng.normal(0.0, 5.0, (seconds * RATE, 2)) + np.repeat(slow, RATE, axis=0)
    return values


def counts(values: np.ndarray) -> np.ndarray:
    return np.rint(values).astype(np.int16)


def ticks(times: np.ndarray) -> Ticks:
    unknown = np.full(len(times), np.nan)
    return Ticks(np.arange(len(times)), times, unknown, unknown)


def watched(samples: np.ndarray, piece: int = 5000, times: np.ndarray | None = None) -> Watch:
    watch = Watch(INFO)
    for first in range(0, len(samples), piece):
        if times is not None:
            watch.ticks(first, ticks(times[first : first + piece]))
        watch.rows(samples[first : first + piece])
    return watch


def events(watch: Watch) -> dict[str, Event]:
    found = watch.events(float(RATE))
    assert len({event.kind for event in found}) == len(found), [event.words for event in found]
    return {event.kind: event for event in found}


def test_clean_axes_are_silent():
    for seed in range(4):
        assert events(watched(counts(rows(2400, seed)))) == {}


def test_shift_is_found_named_and_timed():
    values = rows(900)
    values[AT * RATE :, 0] += 4.0  # of a mean over a second 8 standard deviations
    step = events(watched(counts(values)))["step"]
    (once,) = step.occurrences
    assert step.axes == ("gx",)
    assert step.is_present
    assert once.lower_s <= AT <= once.upper_s
    assert once.found_s - AT <= 4.0
    assert step.size == pytest.approx(4.0 * INFO.scale[0], rel=0.2)


@pytest.mark.parametrize("size", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("share", [0.1, 0.37, 0.5, 0.8])
def test_large_shift_within_a_block_is_one_event_whose_interval_holds_it(size, share):
    values = rows(900)
    values[int((AT + share) * RATE) :, 0] += size
    step = events(watched(counts(values)))["step"]
    (once,) = step.occurrences
    assert once.lower_s - 0.01 <= AT + share <= once.upper_s + 0.01  # a row is 0.01 s
    assert once.upper_s - once.lower_s < 0.3
    # of a block that holds a little of both levels at most
    assert step.size == pytest.approx(size * INFO.scale[0], abs=1.5 * INFO.scale[0])


@pytest.mark.parametrize("size", [3.0, 20.0, 200.0])
@pytest.mark.parametrize("apart", [7.3, 14.25, 20.3])
def test_shifts_that_follow_each_other_are_told_each_and_nothing_besides(size, apart):
    """Seconds apart, some within a block: in a block of both levels there is no line."""
    moments = [AT + k * apart for k in range(8)]
    values = rows(round(AT + 9 * apart))
    time_s = np.arange(len(values)) / RATE
    values[:, 0] += size * np.searchsorted(moments, time_s, side="right")
    found = watched(counts(values)).events(float(RATE))
    assert {(event.kind, event.axes) for event in found} == {("step", ("gx",))}
    onsets = [event.occurrences[0] for event in found]
    assert len(onsets) == len(moments)
    away = [
        max(once.lower_s - moment, moment - once.upper_s)
        for moment, once in zip(moments, onsets, strict=True)
    ]
    assert sum(one > 0.01 for one in away) <= 1  # of eight intervals of 95 %
    assert max(away) < 0.1
    assert max(once.found_s - at for at, once in zip(moments, onsets, strict=True)) <= 9.0
    assert [event.size for event in found] == pytest.approx([size * INFO.scale[0]] * 8, rel=0.5)


def test_ramp_is_one_event():
    values = rows(1500)
    time_s = np.arange(len(values)) / RATE
    values[:, 1] += np.maximum(time_s - AT, 0.0) * 0.05
    ramp = events(watched(counts(values)))["ramp"]
    assert ramp.axes == ("az",)
    assert ramp.occurrences[0].lower_s - 10 <= AT <= ramp.occurrences[0].upper_s + 10
    assert ramp.size > 10 * INFO.scale[1]


def test_pieces_in_which_a_ramp_was_seen_are_one_event_that_began_where_it_did():
    """In white noise it looks like a step or two before enough of it is seen: in three of ten."""
    rng, n, at = np.random.default_rng(7), 330 * RATE, 240.0
    late = np.maximum(np.arange(n) / RATE - at, 0.0)
    for _ in range(10):
        values = rng.normal(0.0, 5.0, (n, 2))
        values[:, 0] += 0.15 * late
        ramp = events(watched(counts(values)))
        assert set(ramp) == {"ramp"}
        once = ramp["ramp"].occurrences[0]
        assert once.lower_s - 1 <= at <= once.upper_s + 1


def test_change_of_the_noise_is_no_line_and_no_outliers():
    values = rows(900)
    values[AT * RATE : 760 * RATE, 1] *= 1.5
    noise = events(watched(counts(values)))["variance_change"]
    (once,) = noise.occurrences
    assert noise.size == pytest.approx(1.5, rel=0.15)
    assert once.lower_s - 1 <= AT <= once.upper_s + 1
    assert once.end_s == pytest.approx(760, abs=8)


def test_line_is_found_with_frequency_and_amplitude():
    values = rows(900)
    time_s = np.arange(len(values)) / RATE
    line = (time_s >= AT) * 3.0 * np.sin(2 * np.pi * 17.4 * time_s)
    values[:, 0] += line
    found = events(watched(counts(values)))["sinusoid"]
    assert found.frequency_interval_hz is not None
    lower, upper = found.frequency_interval_hz
    assert lower < 17.4 < upper < lower + 0.4
    assert f"{17.4:g}" in found.words
    assert found.size == pytest.approx(3.0 * INFO.scale[0], rel=0.25)
    assert found.occurrences[0].found_s - AT < 12


def test_frequency_of_a_line_is_within_its_interval():
    """Wherever it is between two bins, soon after it was found and later."""
    held = 0
    for seed, frequency in enumerate(np.linspace(16.0, 18.0, 15)):
        values = rows(400, seed)
        time_s = np.arange(len(values)) / RATE
        values[:, 0] += (time_s >= 300) * 3.0 * np.sin(2 * np.pi * frequency * time_s)
        for end, width in ((330, 1.0), (400, 0.4)):
            interval = events(watched(counts(values[: end * RATE])))["sinusoid"]
            assert interval.frequency_interval_hz is not None
            lower, upper = interval.frequency_interval_hz
            assert upper - lower < width
            held += lower <= frequency <= upper
    assert held >= 28


def test_the_interval_of_a_line_is_as_wide_as_its_frequency_scatters():
    """Where few bins are beside it, it is in the noise level of the block as well."""
    info, away = StreamInfo(axes=("gx",), scale=(1e-3,), nominal_hz=26.0), []
    for seed in range(40):
        rng, time_s = np.random.default_rng(seed), np.arange(300 * 26) / 26
        frequency = rng.uniform(4.0, 10.0)
        values = rng.normal(0.0, 5.0, len(time_s))
        values += (time_s >= 200) * 7.0 * np.sin(2 * np.pi * (frequency * time_s + rng.random()))
        watch = Watch(info)
        watch.rows(counts(values)[:, np.newaxis])
        for found in watch.events(26.0):
            assert found.frequency_interval_hz is not None
            lower, upper = found.frequency_interval_hz
            away.append((found.frequency_hz - frequency) / (upper - lower) * 2 * TWO_SIDED_95)
    assert len(away) > 35
    assert 0.7 < np.sqrt(np.mean(np.square(away))) < 1.2


def test_burst_of_outliers():
    samples = counts(rows(900))
    samples[np.array([100, 250, 400]) * RATE, 1] += 200  # as many as usual
    where = AT * RATE + np.arange(6) * 97
    samples[where, 1] += 200
    burst = events(watched(samples))["outliers"]
    assert burst.axes == ("az",)
    assert burst.size == 6
    assert not burst.is_present


def test_onset_of_a_burst_is_within_its_interval():
    """Also where its first seconds had no outlier yet."""
    held = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        samples = counts(rows(700, seed))
        samples[AT * RATE :, 1] += 200 * (rng.random(100 * RATE) < 1.0 / RATE)
        (once,) = events(watched(samples))["outliers"].occurrences
        held += once.lower_s <= AT <= once.upper_s
    assert held >= 18


def test_repeats_are_counted():
    samples = counts(rows(900))
    again = AT * RATE + np.arange(10, 4000, 40)
    samples[again] = samples[again - 1]
    repeats = events(watched(samples))["repeated_samples"]
    assert repeats.axes == ()
    assert repeats.size == pytest.approx(100, abs=8)


def test_losses():
    samples = counts(rows(900))
    watch = Watch(INFO)
    watch.rows(samples[: AT * RATE])
    for number in range(3):
        watch.gap(Gap("link", 5))
        first = (AT + number) * RATE
        watch.rows(samples[first : first + RATE])
    watch.rows(samples[(AT + 3) * RATE :])
    (once,) = events(watch)["lost_samples"].occurrences
    assert once.sample == AT * RATE  # the first that is missing
    assert once.lower_s < AT - 1.0
    assert once.upper_s == once.onset_s


def test_burst_begins_with_the_first_of_it_that_no_window_shows():
    """Outliers that come every few seconds began with one that is too long ago for a window."""
    samples = counts(rows(700))
    where = AT * RATE + np.array([0, 20, 33, 35, 37, 39, 41, 43]) * RATE
    samples[where, 1] += 200
    (once,) = events(watched(samples))["outliers"].occurrences
    assert once.sample == where[0]
    samples = counts(rows(700))
    where = AT * RATE + np.array([0, *range(33, 41)]) * RATE
    samples[where, 1] += 200
    (once,) = events(watched(samples))["outliers"].occurrences
    assert once.sample == where[1]  # one a second has no pause of half a minute


def test_change_of_the_rate():
    samples = counts(rows(900))
    periods = np.full(len(samples), 1.0 / RATE)
    periods[AT * RATE :] *= 1.0 + 200e-6
    jitter = np.random.default_rng(2).uniform(0.0, 1e-5, len(samples))
    times = np.cumsum(periods) + jitter
    rate = events(watched(samples, times=times))["rate_change"]
    assert rate.size == pytest.approx(-200, rel=0.1)
    assert rate.occurrences[0].onset_s == pytest.approx(AT, abs=2)


def test_what_comes_back_is_one_event():
    values = rows(3000)
    for begin in (600, 1200, 1800):
        values[begin * RATE : (begin + 200) * RATE, 0] += 4.0
    fridge = events(watched(counts(values)))["step"]
    assert fridge.count == 3
    assert [round(one.onset_s / 100) for one in fridge.occurrences] == [6, 12, 18]
    assert [round((one.end_s or 0) / 100) for one in fridge.occurrences] == [8, 14, 20]
    assert "3 times" in fridge.words


def test_axes_that_change_together_are_one_event():
    values = rows(900)
    values[AT * RATE :] += 4.0
    step = events(watched(counts(values)))["step"]
    assert sorted(step.axes) == ["az", "gx"]


@pytest.mark.parametrize("piece", [1, 37, 104, 4096])
def test_pieces_do_not_matter(piece: int):
    """Bit for bit: a replay hands over megabytes, a port three rows."""
    values = rows(240 if piece == 1 else 700)
    values[150 * RATE :, 0] += 4.0
    values[160 * RATE :, 1] += 3.0 * np.sin(np.arange(len(values) - 160 * RATE))
    times = np.arange(len(values)) / RATE
    whole, cut = (watched(counts(values), n, times) for n in (len(values), piece))
    assert pickle.dumps(whole.events(100.0)) == pickle.dumps(cut.events(100.0))
    assert whole.events(100.0)
    assert whole._scan._sums.tobytes() == cut._scan._sums.tobytes()


def test_copy_goes_on_by_itself():
    samples = counts(rows(700))
    watch = watched(samples[: 300 * RATE + 7])
    frozen = copy.deepcopy(watch)
    watch.rows(samples[300 * RATE + 7 :])
    assert frozen.blocks == 300
    assert watch.blocks == 700


def test_one_knock_is_no_shift():
    values = rows(900)
    values[AT * RATE : AT * RATE + RATE // 2, 0] += 100.0
    assert "step" not in events(watched(counts(values)))


def test_memory_does_not_grow():
    short, long = (len(pickle.dumps(watched(counts(rows(n))))) for n in (300, 1500))
    assert long < 1.01 * short + 20_000
    assert long < 1 << 21


def cusum_delays(x: np.ndarray, at: int, size: float) -> np.ndarray:
    """Delays of a CUSUM that knows the change, with one false alarm in 40 nights (Siegmund)."""
    wanted, limit = 40 * 43_200, 1.0
    while 2 / size**2 * (np.exp(limit + 1.166 * size) - limit - 1.166 * size - 1) < wanted:
        limit += 0.02
    total, delay = np.zeros(x.shape[1]), np.full(x.shape[1], np.inf)
    for time in range(at - 200, len(x)):
        total = np.maximum(total, 0.0) + size * x[time] - size**2 / 2
        new = (total > limit) & ~np.isfinite(delay) & (time >= at)
        delay[new] = time - at + 1
    return delay


def test_delay_is_near_that_of_an_oracle():
    """At three times the least shift that the longest window shows, 0.37 standard deviations."""
    size, at, many = 3 * 0.37, 7200, 200
    x = np.random.default_rng(5).standard_normal((at + 200, many))
    x[at:] += size
    scan = Scan(many, np.full(many, np.log(ALPHA * ALPHA_SHARES["level"])))
    delay = np.full(many, np.inf)
    for time, values in enumerate(x):
        for alarm in scan.update(values):
            assert time >= at
            delay[alarm.channel] = min(delay[alarm.channel], time - at + 1)
    ratio = np.median(delay) / np.median(cusum_delays(x, at, size))
    assert ratio <= 1.5


def test_wide_words_are_judged_without_dividing_by_nothing():
    """Of 24 or 32 bits, whose variance over that of a window not yet looked at is not a number."""
    scan = Scan(1, np.full(1, np.log(ALPHA)))
    for value in np.random.default_rng(1).normal(0.0, 1e6, 700):
        assert scan.update(np.full(1, value)) == []
    assert scan.spread(0) == pytest.approx(1e6, rel=0.2)


@pytest.mark.parametrize("noise", ["white", "flicker", "walk"])
def test_false_alarms_stay_below_what_is_allowed(noise: str):
    """With an allowance of two an axis, so that there are enough to count."""
    blocks, many, log_alpha = 1500, 600, np.log(2.0)
    rng = np.random.default_rng(3)
    x = rng.standard_normal((blocks, many))
    if noise == "walk":
        x += 0.1 * np.cumsum(rng.standard_normal((blocks, many)), axis=0)
    if noise == "flicker":
        shape = np.fft.rfft(rng.standard_normal((2 * blocks, many)), axis=0)
        shape *= np.maximum(np.arange(len(shape)) / len(shape), 1e-4)[:, np.newaxis] ** -0.5
        x += 0.3 * np.fft.irfft(shape, axis=0)[:blocks]
    scan = Scan(many, np.full(many, log_alpha))
    alarmed = {alarm.channel for values in x for alarm in scan.update(values)}
    spent = sum(np.exp(log_weight(block)) for block in range(blocks))
    assert len(alarmed) <= many * np.exp(log_alpha) * spent


@pytest.mark.parametrize("alike", [0.0, 0.5])
def test_moment_of_a_change_has_an_interval(alike):
    """Also in noise whose neighbours are alike, which tells less."""
    held = 0
    for seed in range(400):
        rng = np.random.default_rng(seed)
        values = lfilter([np.sqrt(1 - alike**2)], [1.0, -alike], rng.standard_normal(220))[100:]
        values[80:] += 1.5
        change = locate(values, 40, 1.0)
        held += change.lower <= 80 <= change.upper
    assert 0.92 < held / 400 < 0.98


def test_the_moment_of_a_clear_step_is_known_to_a_part_of_its_block():
    """A block of which a third had passed is a third of the old level."""
    rng, ranks = np.random.default_rng(12), []
    for _ in range(200):
        at, size = rng.uniform(40.0, 60.0), np.exp(rng.uniform(0.0, np.log(20.0)))
        share = np.clip(np.arange(70) + 1.0 - at, 0.0, 1.0)
        change = locate(size * share + rng.standard_normal(70), 20, 1.0)
        ranks.append(change.lower <= at <= change.upper)
        assert size < 10.0 or change.upper - change.lower < 0.8
    assert 0.9 < np.mean(ranks) < 0.995


def test_the_moment_of_louder_noise_is_that_of_its_power():
    """Half a block of eight times the power is halfway, and what is louder scatters more.

    As a step of equal scatter it was told too late.
    """
    power = np.where(np.arange(70) < 50, 1.0, 8.0)
    power[50] = 4.5
    power *= 1.0 + 0.01 * np.cos(np.arange(70) ** 2)
    _, lower, upper = moment_of_powers(power, 20, 50)
    assert lower <= 50.5 <= upper
    assert upper - lower < 0.25
    rng, ranks = np.random.default_rng(12), []
    for _ in range(200):
        at, ratio = rng.uniform(40.0, 60.0), np.exp(rng.uniform(np.log(1.5), np.log(8.0)))
        share = np.clip(np.arange(70) + 1.0 - at, 0.0, 1.0)
        power = (1.0 + share * (ratio - 1.0)) * rng.chisquare(40, 70) / 40
        _, lower, upper = moment_of_powers(power, 20, round(at))
        ranks.append((at > lower) + (at > upper))
    assert 0.9 < np.mean(np.equal(ranks, 1)) < 0.995
    assert max(ranks.count(0), ranks.count(2)) <= 12


def test_a_weak_line_is_not_told_late():
    """Its own power raises the mean square of its bin, by which ratios are divided."""
    rng, early, held = np.random.default_rng(15), [], []
    unheld, scale = np.zeros((1, 24, 8), np.int32), np.ones((1, 8), np.float32)
    for _ in range(120):
        lines, at, excess = (
            LineCusums(1, 24, np.log(1e-4)),
            140 + rng.uniform(0, 4),
            rng.uniform(3, 7),
        )
        for block in range(220):
            wave = np.sqrt(0.5) * rng.standard_normal((1, 24, 8, 2))
            left = np.clip(block + 1 - at, 0, 1)  # of the block, in a Hann window
            wave[0, 9, 0, 0] += np.sqrt(excess) * (left - np.sin(2 * np.pi * left) / (2 * np.pi))
            found = lines.update(np.sum(wave**2, axis=-1).astype(np.float32), scale, unheld)
            if found and block > at:
                early.append(found[0].moment < at)
                held.append(found[0].lower <= at <= found[0].upper)
                break
    assert len(early) > 60
    assert 0.35 < np.mean(early) < 0.65
    assert np.mean(held) > 0.9


def test_the_interval_of_the_frequency_of_a_line_holds_it_as_often_as_it_says():
    """Hann windows of 50 rows, sixty of them, in noise of 1."""
    rng, n, held = np.random.default_rng(13), 50, []
    window = np.hanning(n + 1)[:-1]
    noise = float(np.sum(window**2))
    for _ in range(300):
        place, size = 10.0 + rng.uniform(-0.5, 0.5), rng.uniform(0.4, 1.0)
        phase = rng.uniform(0.0, 2 * np.pi, (60, 1))
        wave = size * np.sin(2 * np.pi * place * np.arange(n) / n + phase)
        power = np.abs(np.fft.rfft(window * (wave + rng.standard_normal((60, n))))) ** 2 - noise
        track = Track("sinusoid", 0, 0.0, 16, 20.0, [], bin=10.0)
        for block in power[:, [10, 9, 11]]:
            track.follow(1.0, np.array([*block, noise]))
        _, lower, upper = track.place
        held.append(lower <= place <= upper)
    assert 0.92 < np.mean(held) < 0.985
