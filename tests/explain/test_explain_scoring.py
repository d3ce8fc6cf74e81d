"""The compiled fit: its maximum is the maximum, at a boundary or not; properties computed once."""

from __future__ import annotations

from threading import Barrier, Thread

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import nnls

from allanscope.compiled import Pointer, kernel
from allanscope.explain.stationarity import demodulate
from allanscope.lazy import once
from allanscope.noise.amplitudes import maximise
from allanscope.noise.components import AngleQuantization, Flicker, RandomWalk, White
from allanscope.noise.grid import grid_of

Array = NDArray[np.float64]

GRID = grid_of(20_000, 50.0)
NONE = np.zeros(len(GRID.count))
_IN, _OUT = Pointer(np.float64, 1), Pointer(np.float64, 1, written=True)
_MATRIX, _OUT_MATRIX = Pointer(np.float64, 2), Pointer(np.float64, 2, written=True)
TEXTBOOK = {"N": White, "B": Flicker, "K": RandomWalk, "Q": AngleQuantization}


def textbook(letters: str) -> Array:
    return np.array([GRID.column(TEXTBOOK[letter](1.0)) for letter in letters])


def triangle_of(columns: Array, target: Array) -> tuple[Array, Array]:
    p, n = columns.shape
    triangle, right = np.empty((p, p)), np.empty(p)
    run = kernel("triangulate", _OUT_MATRIX, _OUT, int, int, _OUT_MATRIX, _OUT)
    run(columns.copy(), target.copy(), p, n, triangle, right)
    return triangle, right


def nonnegative(triangle: Array, right: Array) -> Array:
    p = len(right)
    solution = np.empty(p)
    run = kernel("nonnegative", _MATRIX, _IN, int, _OUT, _OUT)
    run(np.ascontiguousarray(triangle), right, p, np.empty(2 * p * (p + 5)), solution)
    return solution


def drawn(variance: Array, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return variance * rng.chisquare(GRID.count) / GRID.count


def slope(columns: Array, power: Array, expected: Array) -> Array:
    """Return the derivative of the log-likelihood by every variance times its standard error."""
    weight = GRID.count / (2 * expected)
    error = np.sqrt(np.sum((GRID.count / 2) * (columns / expected) ** 2, axis=1))
    return np.asarray(columns @ (weight * (power / expected - 1)) / error)


@pytest.mark.parametrize("seed", range(6))
def test_the_likelihood_is_level_at_the_maximum_or_falls_from_zero(seed: int) -> None:
    columns = textbook("NBKQ")
    truth = np.array([1e-4, 1e-6 * (seed % 2), 1e-8, 0.0])
    power = drawn(truth @ columns, seed)
    theta, _, expected = maximise(columns, power, GRID.count, NONE)
    assert np.all(theta >= 0)
    np.testing.assert_allclose(expected, theta @ columns, rtol=1e-12)
    at_zero = theta == 0
    assert np.all(np.abs(slope(columns, power, expected)[~at_zero]) < 2e-2)  # 2e-4 nats
    assert np.all(slope(columns, power, expected)[at_zero] < 2e-2)


def test_what_is_not_there_is_exactly_zero() -> None:
    columns = textbook("NBKQ")
    power = np.array([1e-4, 0.0, 1e-8, 0.0]) @ columns
    theta, *_ = maximise(columns, power, GRID.count, NONE)
    np.testing.assert_allclose(theta, [1e-4, 0.0, 1e-8, 0.0], rtol=1e-6, atol=1e-12)


def test_a_known_floor_is_no_part_of_the_white_noise() -> None:
    columns = textbook("NK")
    power = np.array([1e-4, 1e-8]) @ columns + 2e-3
    theta, *_ = maximise(columns, power, GRID.count, NONE + 2e-3)
    np.testing.assert_allclose(theta, [1e-4, 1e-8], rtol=1e-6)


def test_least_squares_without_negative_unknowns_are_those_of_scipy() -> None:
    rng = np.random.default_rng(4)
    held = 0
    for _ in range(200):
        matrix = np.triu(rng.normal(size=(5, 5))) + 0.7 * np.triu(rng.normal(size=(5, 1)) + 1)
        right = rng.normal(size=5)
        expected, _ = nnls(matrix, right)
        np.testing.assert_allclose(nonnegative(matrix, right), expected, atol=1e-9)
        held += int(np.any(expected == 0))
    assert held > 100


def test_unknowns_of_equal_columns_share_what_one_would_have() -> None:
    columns = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [1.0, 0.0, 1.0]])
    target = 2 * columns[0] + 3 * columns[2]
    theta = nonnegative(*triangle_of(columns, target))
    np.testing.assert_allclose(theta @ columns, target, rtol=1e-12)
    assert np.all(np.abs(theta) < 10)


def test_a_column_that_repeats_another_changes_nothing() -> None:
    columns = textbook("NBK")
    power = drawn(np.array([1e-4, 1e-6, 1e-8]) @ columns, 1)
    _, once_each, _ = maximise(columns, power, GRID.count, NONE)
    twice = np.vstack([columns, columns[1]])
    theta, loglik, _ = maximise(twice, power, GRID.count, NONE)
    assert loglik == pytest.approx(once_each, abs=1e-5)
    assert np.all(theta >= 0)


def test_where_the_search_starts_makes_no_difference() -> None:
    columns = textbook("NBK")
    power = drawn(np.array([1e-4, 1e-6, 1e-8]) @ columns, 2)
    _, cold, _ = maximise(columns, power, GRID.count, NONE)
    _, warm, _ = maximise(columns, power, GRID.count, 0.0, np.array([1e-2, 0.0, 1e-4]))
    assert warm == pytest.approx(cold, abs=1e-4)


def test_the_amplitude_of_a_tone_in_parts_is_the_sum_with_the_wave() -> None:
    data = np.random.default_rng(3).normal(size=10_007)
    found = demodulate(data, 100.0, 12.34, 3)
    used = data[: 3335 * 3]
    wave = np.exp(-2j * np.pi * 12.34 * np.arange(len(used)) / 100.0)
    mixed = 2 * ((used - used.mean()) * wave).reshape(3, -1).mean(axis=1)
    np.testing.assert_allclose(found, mixed, atol=1e-13)


def test_two_instances_compute_a_property_at_the_same_time() -> None:
    both = Barrier(2, timeout=20)

    class Waiting:
        @once
        def value(self) -> int:
            return both.wait()

    instances = Waiting(), Waiting()
    threads = [Thread(target=lambda one=one: one.value) for one in instances]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not both.broken
    assert {one.value for one in instances} == {0, 1}
