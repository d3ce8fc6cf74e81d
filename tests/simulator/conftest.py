"""Reference estimators for the simulator's tests, written for clearness and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

Variance = Callable[[NDArray[np.float64], int], float]


def overlapped_allan(samples: NDArray[np.float64], m: int) -> float:
    phase = np.concatenate(([0.0], np.cumsum(samples - samples.mean())))
    second = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m]
    return float(np.mean(second**2) / (2.0 * m**2))


def overlapped_hadamard(samples: NDArray[np.float64], m: int) -> float:
    phase = np.concatenate(([0.0], np.cumsum(samples - samples.mean())))
    third = phase[3 * m :] - 3.0 * phase[2 * m : -m] + 3.0 * phase[m : -2 * m] - phase[: -3 * m]
    return float(np.mean(third**2) / (6.0 * m**2))


@pytest.fixture
def avar() -> Variance:
    return overlapped_allan


@pytest.fixture
def hvar() -> Variance:
    return overlapped_hadamard
