"""The loops of the watch in C against plain numpy, and copies that go on by themselves."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr
from scipy.stats import t as student

from allanscope.watch.false_alarms import log_weight
from allanscope.watch.lines import (
    CLEAR_INCREMENT,
    CLEAR_TILT,
    LEAST_BLOCKS,
    LOG_OVERSHOOT,
    MOST_KEPT,
    RATIO_CAP,
    WEAK_EXCESS,
    WEAK_INCREMENT,
    LineCusums,
)
from allanscope.watch.scan import (
    ALPHA_SHARES,
    BORROWED_DOF_RATIO,
    CLIP_SIGMAS,
    HOPS,
    LEAST_DOF,
    LEAST_REFERENCE,
    LOG_OVERLAP,
    MOST_BORROWED_DOF,
    REFERENCE,
    SCALE_DELAY,
    SCALE_MEMORY,
    WINDOWS,
    WINSOR_RATIO,
    Scan,
    log_tail,
)
from allanscope.watch.summary import (
    FIRST_BIN,
    LANES,
    MEDIAN_TO_SIGMA,
    OUTLIER_SIGMAS,
    Summariser,
    _is_usual,
    of_axis,
)


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float64])
@pytest.mark.parametrize(("rows", "axes"), [(32, 1), (104, 6), (150, 8), (833, 11), (6660, 3)])
def test_block_is_summed_up_as_by_numpy(rows: int, axes: int, dtype: type):
    rng = np.random.default_rng(rows)
    blocks = np.rint(rng.normal(300.0, 20.0, (20, rows, axes))).astype(dtype)
    blocks[7, 5:7, :] = blocks[7, 4]
    blocks[19, 20, 0] = 30_000
    summarise = Summariser(axes, rows)
    held = np.zeros(summarise.power.shape, np.int32)
    other = np.zeros(summarise.power.shape[::2], np.bool_)
    mean = np.zeros((summarise.bins, axes))
    for number, block in enumerate(blocks):
        known = summarise.update(block, held, other)
        x = block.astype(np.float64)
        assert known.outliers.sum() == (number == 19)
        assert known.repeats == int((np.diff(x, axis=0) == 0).all(axis=1).sum())
        if number == 19:
            x[20, 0] = np.mean(x[:, 0])
        np.testing.assert_allclose(known.level, x.mean(axis=0), rtol=1e-12)
        spectrum = np.fft.rfft((x - x.mean(axis=0))[: summarise.length], axis=0)
        before, middle, after = (spectrum[FIRST_BIN + i :][: summarise.bins] for i in (-1, 0, 1))
        power = np.abs(0.5 * middle - 0.25 * (before + after)) ** 2
        if 0 < number < 17:
            ratio = np.stack([of_axis(known.ratio, axis) for axis in range(axes)], axis=1)
            np.testing.assert_allclose(ratio * mean, power, rtol=1e-3, atol=1e-4 * mean.mean())
        if number < 17:
            mean += (power - mean) / (number + 1)


class PlainScan:
    """What `compiled/watch.c` does, written in numpy."""

    def __init__(self, channels: int, log_alpha: NDArray[np.float64]) -> None:
        many = len(WINDOWS)
        self.log_alpha = (LOG_OVERLAP + np.log(ALPHA_SHARES * HOPS))[:, np.newaxis] + log_alpha
        self.values: list[NDArray[np.float64]] = []
        self.start = np.zeros(channels, np.int64)
        self.square, self.looks = np.zeros((2, many, channels))
        self.fourth = np.full((many, channels), 3.0)
        self.pending = np.full((SCALE_DELAY, many, channels), np.nan)

    def update(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return by how much the nats of each channel exceed the limit, -inf where not judged."""
        if len(self.values) >= REFERENCE[0]:
            centre = np.mean(self.values[-REFERENCE[0] :], axis=0)
            room = CLIP_SIGMAS * np.sqrt(self.square[0] / (1 / WINDOWS[0] + 1 / REFERENCE[0]))
            clip = (len(self.values) - self.start >= REFERENCE[0]) & (self.looks[0] >= LEAST_DOF)
            values = np.where(clip, np.clip(values, centre - room, centre + room), values)
        self.values.append(values)
        now = len(self.values)
        due = [
            w
            for w in range(len(WINDOWS))
            if not now % HOPS[w] and now >= (WINDOWS + LEAST_REFERENCE)[w]
        ]
        differences = {}
        best = np.full(len(values), -np.inf)
        for w in due:
            window, full = int(WINDOWS[w]), int(REFERENCE[w])
            before = min(now - window, full)  # no series begins anew here
            recent, past = self.values[-window:], self.values[-window - before : -window]
            difference = np.mean(recent, axis=0) - np.mean(past, axis=0)
            difference *= np.sqrt((1 / window + 1 / full) / (1 / window + 1 / before))
            best = np.maximum(best, self.judged(w, difference) - self.limit(w, now))
            differences[w] = difference
        raised = best > 0.0
        self.pending[:, :, raised] = np.nan
        for w in due:
            slot = now // HOPS[w] % SCALE_DELAY
            self.learn(w, self.pending[slot, w])
            self.pending[slot, w] = np.where(raised, np.nan, differences[w])
        return best

    def limit(self, w: int, now: int) -> NDArray[np.float64]:
        return np.asarray(-(self.log_alpha[w] + log_weight(now)))

    def judged(self, w: int, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        window, before, own = WINDOWS[w], REFERENCE[w], self.square[w]
        white = self.square[0] / (1 / WINDOWS[0] + 1 / REFERENCE[0]) * (1 / window + 1 / before)
        nats = np.zeros(len(own))
        for c in np.flatnonzero(own > 0.0):
            coloured = 1.0 - min(white[c] / own[c], 1.0)
            kept = min(self.looks[w, c], 2 * SCALE_MEMORY)
            dof = kept * HOPS[w] / (window + coloured * (window + before / 4))
            if dof < LEAST_DOF:
                continue
            is_white = own[c] < white[c] * (1 + np.sqrt(2 / dof))
            lent = min(MOST_BORROWED_DOF, BORROWED_DOF_RATIO * dof) if is_white else 0.0
            scale = (dof * own[c] + lent * white[c]) / (dof + lent)
            heavy = max(self.fourth[w, c] - 3.0 - 2.0 * np.sqrt(24.0 / dof), 0.005)
            dof = min(dof + lent, 4.0 + 6.0 / heavy)
            nats[c] = log_tail(float(difference[c] / np.sqrt(scale)), dof)
        return nats

    def learn(self, w: int, difference: NDArray[np.float64]) -> None:
        for c in np.flatnonzero(np.isfinite(difference)):
            self.looks[w, c] += 1
            gain, new = 1.0 / min(self.looks[w, c], SCALE_MEMORY), difference[c] ** 2
            usual, early = self.square[w, c], self.looks[w, c] <= 16
            calm = new if early else min(new, WINSOR_RATIO * usual)
            peak = 3.0 if early else min(new / usual, 16.0) ** 2
            self.square[w, c] += gain * (calm - usual)
            self.fourth[w, c] += gain * (peak - self.fourth[w, c])


def test_what_a_count_calls_usual_has_no_outlier_by_the_median():
    rng = np.random.default_rng(6)
    usual = 0
    for trial in range(600):
        away = np.abs(rng.normal(0.0, 9.0, rng.choice([32, 33, 104]))).astype(np.float32)
        away[0] = np.float32(
            OUTLIER_SIGMAS * MEDIAN_TO_SIGMA * np.median(away) * (0.5 + trial / 600)
        )
        limit = np.float32(OUTLIER_SIGMAS * MEDIAN_TO_SIGMA * float(np.median(away)))
        if _is_usual(away):
            usual += 1
            assert not (away > limit).any()
        elif trial < 200:
            raise AssertionError(f"{away.max()} of {limit} is far from an outlier")
    assert usual > 200


def test_ratios_of_white_noise_average_to_one():
    """A level that is a trimmed mean made them 1.05 on the whole."""
    rng, rows = np.random.default_rng(2), 104
    summarise = Summariser(6, rows)
    held = np.zeros(summarise.power.shape, np.int32)
    other = np.zeros(summarise.power.shape[::2], np.bool_)
    means = []
    for number in range(4000):
        known = summarise.update(
            np.rint(rng.normal(0.0, 20.0, (rows, 6))).astype(np.int16), held, other
        )
        if number >= 1000:
            means.append((known.ratio * known.scale[:, np.newaxis])[..., :6].mean())
    assert abs(np.mean(means) - 1.0) < 0.015


def test_ratios_are_kept_in_the_half_precision_of_numpy():
    halves = np.arange(0x7C00, dtype=np.uint16).view(np.float16).astype(np.float32)
    ties = (halves[1:] + halves[:-1]) / np.float32(2.0)
    about = [np.nextafter(ties, np.float32(end)) for end in (0.0, 1e9)]
    ratio = np.resize(np.concatenate([halves, ties, *about]), (1, 15_872, LANES))
    lines = LineCusums(LANES, ratio.shape[1], -9.0)
    lines.update(ratio, np.ones((1, LANES), np.float32), np.zeros(ratio.shape, np.int32))
    expected = np.minimum(ratio, np.float32(MOST_KEPT)).astype(np.float16)
    assert np.array_equal(lines._recent[0].view(np.uint16), expected.view(np.uint16))


def test_scan_is_that_of_plain_numpy():
    blocks, many = 1500, 4
    rng = np.random.default_rng(6)
    x = rng.standard_normal((blocks, many))
    x[:, 1] += 0.1 * np.cumsum(rng.standard_normal(blocks))
    x[:, 2] += rng.standard_t(3, blocks)
    x[1000:, 3] += 3.0
    log_alpha = np.full(many, np.log(2.0))
    loop, plain = Scan(many, log_alpha), PlainScan(many, log_alpha)
    alarms = 0
    for values in x - x[0]:
        found = {alarm.channel for alarm in loop.update(values)}
        assert found == set(np.flatnonzero(plain.update(values) > 0.0).tolist())
        alarms += len(found)
        np.testing.assert_allclose(loop._square, plain.square, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(loop._fourth, plain.fourth, rtol=1e-6)
    assert alarms > 5


def test_tail_is_near_that_of_student():
    for deviate in (0.0, 2.0, 6.0, 30.0):
        exact = -np.log(2.0 * ndtr(-deviate)) if deviate < 30 else deviate**2 / 2
        assert log_tail(deviate, 1e9) == pytest.approx(exact, rel=0.02, abs=0.02)
        if deviate < 30:
            exact = -np.log(2.0 * student.sf(deviate, 8.0))
            assert log_tail(deviate, 8.0) == pytest.approx(exact, rel=0.02, abs=0.02)


def test_copy_of_a_scan_goes_on_by_itself():
    x = np.random.default_rng(1).standard_normal((600, 2))
    scan = Scan(2, np.zeros(2))
    for values in x[:300]:
        scan.update(values)
    other = copy.deepcopy(scan)
    for values in x[300:]:
        scan.update(values)
    assert not np.array_equal(other._square, scan._square)
    for values in x[300:]:
        other.update(values)
    assert other._square.tobytes() == scan._square.tobytes()
    assert other._sums.tobytes() == scan._sums.tobytes()


@pytest.mark.parametrize("clear", [False, True])
def test_sums_of_noise_raise_alarms_as_seldom_as_allowed(clear: bool):
    """By runs of a line, each weighted with the likelihood of noise over that of the line."""
    rng, runs, limit = np.random.default_rng(1), 40_000, 17.0
    by, less = CLEAR_INCREMENT if clear else WEAK_INCREMENT

    def gain(ratio: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(by * (np.sqrt(ratio) if clear else ratio) - less)

    root = np.linspace(0.0, 15.0, 100_001)
    spread = np.cumsum(root * np.exp(CLEAR_TILT * root - root**2))
    total, likelihood, weight = np.zeros((3, runs))
    goes_on, length = np.ones(runs, np.bool_), 0
    while goes_on.any():
        length += 1
        ratio = rng.exponential(1.0 + WEAK_EXCESS, runs)
        if clear:
            ratio = np.interp(rng.random(runs), spread / spread[-1], root) ** 2
        more = gain(np.minimum(ratio, RATIO_CAP))
        total += more
        likelihood += gain(ratio)
        alarm = goes_on & (total >= limit) & (more > 0.0) & (length >= LEAST_BLOCKS)
        weight[alarm] = np.exp(limit - likelihood[alarm])
        goes_on &= (total > 0.0) & ~alarm
    # A sum begins at each block in which the one before it has ended.
    ended, total = 0, np.zeros(1000)
    for _ in range(500):
        total = np.maximum(total + gain(np.minimum(rng.standard_exponential(1000), RATIO_CAP)), 0.0)
        ended += int((total == 0.0).sum())
    exact = -np.log(weight.mean() * ended / 500_000)
    assert LOG_OVERSHOOT[int(clear)] == pytest.approx(exact, abs=0.15)
    assert LOG_OVERSHOOT[int(clear)] < exact + 0.03
