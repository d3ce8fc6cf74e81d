"""The streamed sums keep their digits wherever the first sample lies: against exact integers."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pytest

from allanscope.allan import AllanBank

SUB = 1 << 12
"""Samples that are summed in int64 before Python's integers take over."""

KINDS = ("stdev", "ostdev", "oadev", "ohdev", "mdev", "pdev")


def blocks(n: int, first: int | None, seed: int = 1) -> Iterator[np.ndarray]:
    """Yield n int16 samples of three counts of noise about 0, the first one replaced."""
    rng = np.random.default_rng(seed)
    size = min(n, 1 << 20)
    for begin in range(0, n, size):
        block = np.round(3.0 * rng.standard_normal(size)).astype(np.int16)
        if begin == 0 and first is not None:
            block[0] = first
        yield block


def rails(n: int, length: int) -> Iterator[np.ndarray]:
    """Yield n int16 samples at full scale, down and up for `length` each, with noise."""
    for begin, block in zip(range(0, n, min(n, 1 << 20)), blocks(n, None), strict=True):
        up = ((begin + np.arange(block.size)) // length) % 2
        yield np.where(up, 32760 + block, -32760 + block).astype(np.int16)


class Exact:
    """Running sums of a segment at every stride-th sample, in integers; q is held twice."""

    def __init__(self, stream: Iterator[np.ndarray], stride: int) -> None:
        weight = np.arange(SUB, dtype=np.int64)[::-1]
        x = z = q = count = 0
        self.x, self.z, self.q = [0], [0], [0]
        for block in stream:
            y = block.astype(np.int64).reshape(-1, SUB)
            sums = y.sum(1), (y * weight).sum(1), (y * weight**2).sum(1)
            for a, b, c in zip(*(s.tolist() for s in sums), strict=True):
                q += 2 * SUB * z + SUB * SUB * x + c
                z += SUB * x + b
                x += a
                count += SUB
                if count % stride == 0:
                    self.x.append(x)
                    self.z.append(z)
                    self.q.append(q)

    def terms(self, kind: str, m: int, k: int) -> list[Fraction]:
        """Return what is squared, at lag k of the entries."""
        x, z, q = self.x, self.z, self.q
        match kind:
            case "stdev" | "ostdev":
                every = k if kind == "stdev" else 1
                found = [x[i] - x[i - k] for i in range(k, len(x), every)]
            case "oadev":
                found = [x[i] - 2 * x[i - k] + x[i - 2 * k] for i in range(2 * k, len(x))]
            case "ohdev" | "mdev":
                s = x if kind == "ohdev" else z
                found = [
                    s[i] - 3 * s[i - k] + 3 * s[i - 2 * k] - s[i - 3 * k]
                    for i in range(3 * k, len(s))
                ]
            case _:
                found = [
                    m * (z[i] - z[i - 2 * k]) - (q[i] - 2 * q[i - k] + q[i - 2 * k])
                    for i in range(2 * k, len(x))
                ]
        return [Fraction(term) for term in found]


def exact_variance(kind: str, m: int, segments: list[Exact], k: int) -> Fraction:
    terms = [term for segment in segments for term in segment.terms(kind, m, k)]
    n, squares = len(terms), sum(term * term for term in terms)
    match kind:
        case "stdev" | "ostdev":
            return (squares - sum(terms) ** 2 / n) / (n - 1) / m**2
        case "oadev":
            return squares / n / (2 * m**2)
        case "ohdev":
            return squares / n / (6 * m**2)
        case "mdev":
            return squares / n / (2 * m**4)
        case _:
            return squares / n * 18 / m**6


def assert_exact(bank: AllanBank, segments: list[Exact], m: int, k: int, rel: float) -> None:
    for kind in KINDS:
        sums = bank._cascade.settled().variances(kind)
        expected = float(exact_variance(kind, m, segments, k))
        assert sums.variance[0, sums.m == m] == pytest.approx(expected, rel=2 * rel), kind


@pytest.mark.parametrize("level", [12, 15, pytest.param(19, marks=pytest.mark.slow)])
@pytest.mark.parametrize("first", [-32768, 32767])
def test_a_first_sample_at_the_rail_costs_no_digit(level: int, first: int) -> None:
    """Up to m = 2^24, where the mean of m samples lies 10^8 deviations from the first one."""
    m = 32 << level
    bank = AllanBank(1.0, axes=1, per_octave=1)
    for block in blocks(4 * m, first):
        bank.update(block)
    assert_exact(bank, [Exact(blocks(4 * m, first), 1 << level)], m, 32, rel=1e-13)


@pytest.mark.parametrize("level", [12, pytest.param(19, marks=pytest.mark.slow)])
@pytest.mark.parametrize("part", [3, 40])
def test_steps_between_the_rails_cost_no_digit(level: int, part: int) -> None:
    """Steps in the first thirtieth of the longest mean, and steps that are longer than it."""
    m = 32 << level
    length = part << level
    bank = AllanBank(1.0, axes=1, per_octave=1)
    for block in rails(4 * m, length):
        bank.update(block)
    assert_exact(bank, [Exact(rails(4 * m, length), 1 << level)], m, 32, rel=1e-13)


def test_a_rail_for_a_thousandth_of_the_run_costs_no_digit() -> None:
    n, m, k, level = 1 << 20, 1 << 17, 32, 12
    data = np.concatenate(list(blocks(n, None)))
    data[: n >> 10] = -32768
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(data)
    assert_exact(bank, [Exact(iter([data]), 1 << level)], m, k, rel=1e-13)


@pytest.mark.parametrize("firsts", [(-32768, 32767), (32767, -32768, 0, -32768)])
def test_banks_whose_anchors_are_at_the_rails_merge_without_losing_a_digit(
    firsts: tuple[int, ...],
) -> None:
    level, k = 12, 32
    m = k << level
    bank = AllanBank(1.0, axes=1, per_octave=1)
    for seed, first in enumerate(firsts):
        other = AllanBank(1.0, axes=1, per_octave=1)
        for block in blocks(4 * m, first, seed):
            other.update(block)
        bank.merge(other)
    segments = [Exact(blocks(4 * m, first, seed), 1 << level) for seed, first in enumerate(firsts)]
    assert_exact(bank, segments, m, k, rel=1e-13)


def test_banks_of_floats_far_apart_merge_to_what_one_anchor_gives() -> None:
    rng = np.random.default_rng(8)
    parts = [rng.standard_normal(20_000) for _ in range(3)]
    for part, far in zip(parts, (1e8, -1e8, 3e7), strict=True):
        part[0] = far
    shared = AllanBank(1.0, axes=1, anchor=np.zeros(1))
    merged = AllanBank(1.0, axes=1)
    for part in parts:
        other = AllanBank(1.0, axes=1)
        other.update(part)
        merged.merge(other)
        shared.update(part)
        shared.gap()
    for kind in ("stdev", "ostdev"):
        ours, theirs = merged.deviation(kind), shared.deviation(kind)
        np.testing.assert_allclose(ours.deviation, theirs.deviation, rtol=1e-9)


def test_floats_far_from_the_first_lose_only_what_the_distance_rounds() -> None:
    """The promise of the docstring: 1e-16 times distance over deviation."""
    n = 1 << 18
    noise = np.random.default_rng(3).standard_normal(n)
    data = noise.copy()
    data[0] = 1e6
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(data)
    x = np.append(0, np.cumsum(data.astype(np.longdouble)))
    for kind in ("stdev", "ostdev"):
        curve = bank.deviation(kind)
        for m in (64, 1 << 10, 1 << 14):
            stride = m if kind == "stdev" else min(m // 32, bank._archive.stride)
            w = x[::stride][m // stride :] - x[::stride][: -(m // stride)]
            expected = float(np.sqrt(((w - w.mean()) ** 2).sum() / (w.size - 1))) / m
            found = curve.deviation[0, curve.m == m]
            assert found == pytest.approx(expected, rel=1e-16 * 1e6 / expected + 1e-12)


def test_short_segments_that_begin_at_the_rail_cost_no_digit() -> None:
    rng = np.random.default_rng(4)
    segments = [
        np.round(3 * rng.standard_normal(n)).astype(np.int16) for n in (5, 70, 255, 256, 700)
    ]
    bank = AllanBank(1.0, axes=1, per_octave=1)
    means = {m: [] for m in (1, 4, 32)}
    for segment in segments:
        segment[0] = -32768
        bank.update(segment)
        bank.gap()
        x = [0, *np.cumsum(segment, dtype=np.int64).tolist()]
        for m, found in means.items():
            found.extend(Fraction(b - a) for a, b in zip(x, x[m:], strict=False))
    curve = bank.deviation("ostdev")
    for m, w in means.items():
        variance = (sum(a * a for a in w) - sum(w) ** 2 / len(w)) / (len(w) - 1) / m**2
        assert curve.deviation[0, curve.m == m] == pytest.approx(float(variance) ** 0.5, rel=1e-14)
