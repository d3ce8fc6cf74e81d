"""The counts behind numbers that a device scaled and cut.

Stock ST firmware sends ``(int32_t)(raw * sensitivity)``: milli-units, cut towards zero. Where the
sensitivity is above one unit (any gyroscope range: 4.375 mdps and more) two counts never give the
same number, so the count can be had back exactly. Below (0.061 mg) it is lost.

The numbers also give the sensitivity away: at 2000 dps all of them are multiples of 70.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["fits", "recover", "truncate"]


def truncate(
    counts: NDArray[np.generic], milli_per_count: float | NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return what stock firmware sends for these counts.

    >>> truncate(np.array([-4, -1, 1, 4]), 8.75).tolist()
    [-35, -8, 8, 35]
    """
    return np.trunc(np.asarray(counts, np.float64) * milli_per_count).astype(np.int64)


def recover(
    sent: NDArray[np.int64], milli_per_count: float | NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the counts that `truncate` made these numbers of, where there are such counts.

    >>> recover(np.array([-35, -8, 8, 35]), 8.75).tolist()
    [-4, -1, 1, 4]
    """
    size = np.ceil(np.abs(sent) / milli_per_count)
    return (np.sign(sent) * size).astype(np.int64)


def fits(
    sent: NDArray[np.int64], milli_per_count: float | NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return for each number whether some count gives it."""
    same: NDArray[np.bool_] = truncate(recover(sent, milli_per_count), milli_per_count) == sent
    return same
