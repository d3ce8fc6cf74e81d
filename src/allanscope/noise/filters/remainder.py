"""What the named parts of a model leave over in the spectrum: a smooth factor of the density."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.part import Component, Filter

__all__ = ["Remainder"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Remainder(Filter):
    """A factor of the density that no physics stands for, found by `noise.remainder`.

    Parameters
    ----------
    frequency : tuple of float
        Nodes in Hz, ascending.
    gain : tuple of float
        Logarithm of the factor at each; straight between them over the logarithm of the frequency,
        constant beyond.
    level_error : float
        Standard error of the level at which it is zero, in logarithms of the density.

    Examples
    --------
    >>> Remainder((1.0, 4.0), (0.0, 0.2)).response(np.array([0.5, 2.0, 9.0]), 0.01).round(3)
    array([1.   , 1.105, 1.221])
    """

    frequency: tuple[float, ...]
    gain: tuple[float, ...]
    level_error: float = 0.0

    symbol: ClassVar[str] = "remainder"

    def kinks(self, dt: float) -> tuple[float, ...]:
        """Return the nodes."""
        return tuple(f for f in self.frequency if 0 < f < 0.5 / dt)

    def response(self, f: Array, dt: float) -> Array:
        """Return the factor at frequencies in Hz."""
        del dt
        at = np.log(np.maximum(f, 1e-300))
        return np.asarray(np.exp(np.interp(at, np.log(self.frequency), self.gain)))

    def acts_on(self, component: Component) -> bool:
        """Return whether a component is part of the noise; a line and a ramp stand beside it."""
        return component.is_noise and not component.is_line
