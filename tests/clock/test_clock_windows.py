"""The earliest arrivals of windows, in C, against their definition in numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from allanscope.clock.clock import Envelope


def earliest(
    index: NDArray[np.int64],
    time_s: NDArray[np.float64],
    segment: NDArray[np.int64],
    window_s: float,
    period_s: float,
    *,
    from_first: bool,
) -> list[Any]:
    """Return the first of the rows with the shortest delay, of each window and segment."""
    window = np.floor(time_s / window_s)
    begins = (np.diff(window, prepend=np.nan) != 0.0) | (np.diff(segment, prepend=-1) != 0)
    starts = np.flatnonzero(begins)
    ends = np.append(starts[1:], len(index))
    origin = np.zeros(len(index), int) if from_first else np.repeat(starts, ends - starts)
    delay = (time_s - time_s[origin]) - period_s * (index - index[origin])
    return [a + np.argmin(delay[a:b]) for a, b in zip(starts, ends, strict=True)]


@pytest.mark.parametrize("from_first", [True, False])
def test_earliest_arrivals_are_those_of_the_definition(from_first: bool) -> None:
    rng = np.random.default_rng(8)
    envelope = Envelope(1e-6, 104.0)
    for n in (1, 2, 700):
        index = np.cumsum(rng.integers(1, 4, n))
        time_s = np.round(index / 103.0 + rng.exponential(2e-3, n), 3)  # many are equal
        segment = np.sort(rng.integers(0, 3, n))
        for envelope._window_s in (2.0**-10, 0.25, 2.0):
            found = envelope._earliest(index, time_s, segment, from_first=from_first)
            known = envelope._window_s, envelope._period_s
            assert found.tolist() == earliest(index, time_s, segment, *known, from_first=from_first)
