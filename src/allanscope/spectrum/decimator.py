"""One step down the ladder of rates: a low-pass and every fourth sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import njit

__all__ = ["FACTOR", "TAPS", "Decimator"]

FACTOR = 4
_LENGTH = 48
_STOP_DB = 75.0


def _design() -> NDArray[np.float32]:
    """Windowed sinc with its edge at half the new Nyquist band and 75 dB beyond (Kaiser, 1974).

    Flat to 5e-4 in power up to 0.3 of the new rate, closed from 0.7 of it on: what folds onto the
    band in between, which nobody reads, may be wrong.
    """
    beta = 0.1102 * (_STOP_DB - 8.7)
    at = np.arange(_LENGTH) - (_LENGTH - 1) / 2
    taps = np.sinc(at / FACTOR) * np.kaiser(_LENGTH, beta)
    return np.asarray(taps / taps.sum(), np.float32)


TAPS = _design()


# A sum of 48 products in another order differs by rounding alone, so fastmath does no harm here;
# it lets the compiler use vector instructions.
@njit(cache=True, nogil=True, fastmath=True)
def _filter(
    samples: NDArray[np.float32], taps: NDArray[np.float32], out: NDArray[np.float32]
) -> None:
    for axis in range(out.shape[0]):
        for i in range(out.shape[1]):
            total = np.float32(0.0)
            for j in range(taps.shape[0]):
                total += taps[j] * samples[axis, 4 * i + j]
            out[axis, i] = total


class Decimator:
    """Low-pass and keep every fourth sample, as a stream; nothing comes out of half-filled taps.

    Parameters
    ----------
    axes : int
        Number of rows.

    Examples
    --------
    >>> Decimator(1).push(np.ones((1, 56), np.float32)).round(3).tolist()
    [[1.0, 1.0, 1.0]]
    """

    def __init__(self, axes: int) -> None:
        self.rest = np.empty((axes, 0), np.float32)

    def push(self, samples: NDArray[np.float32]) -> NDArray[np.float32]:
        """Take contiguous samples, shape (axes, n), and return what comes out of them."""
        joined = np.concatenate([self.rest, samples], axis=1)
        count = max(0, (joined.shape[1] - _LENGTH) // FACTOR + 1)
        out = np.empty((joined.shape[0], count), np.float32)
        _filter(joined, TAPS, out)
        self.rest = joined[:, FACTOR * count :].copy()
        return out

    def clear(self) -> None:
        """Forget what is half filtered: a gap follows."""
        self.rest = self.rest[:, :0].copy()
