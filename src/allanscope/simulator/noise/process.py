"""What every noise generator is: an endless sequence of which one takes the next n samples."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Process"]


class Process(Protocol):
    """A stream of samples at a fixed rate.

    ``take(3)`` then ``take(5)`` gives, bit for bit, what ``take(8)`` gives.
    """

    def take(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` samples, shape (n,), in the unit of the axis."""
