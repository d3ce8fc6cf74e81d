r"""Samples that repeat the one before: what holding does to white noise.

White noise held with probability d has :math:`(1 - d^2) / (1 - 2 d \cos 2\pi f dt + d^2)` times its
density. Where repeats come in a pattern (a reader at twice the rate of the sensor) the chance
:math:`r_j` that j rows in a row are repeats is not d^j, and the factor is
:math:`1 + 2 \sum_j r_j \cos 2\pi j f dt`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components.base import Component
from allanscope.noise.components.white import White
from allanscope.noise.filters.base import Filter
from allanscope.noise.part import Quantity

__all__ = ["HeldPattern", "HeldSamples"]

Array = NDArray[np.float64]

_DARKEST = 1e-5
"""Least factor: samples held in pairs have no power at Nyquist but what leaks there."""


@dataclass(frozen=True)
class HeldSamples(Filter):
    """Samples that are independent of each other held with the probability `fraction`."""

    fraction: float
    symbol: ClassVar[str] = "repeated_samples"
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("fraction", "", "shape", 0.0, 0.99),)

    def response(self, f: Array, dt: float) -> Array:
        """Return (1 - d^2) / (1 - 2 d cos(2 pi f dt) + d^2)."""
        d = self.fraction
        sine = np.sin(np.pi * f * dt)
        return np.asarray((1 - d * d) / ((1 - d) ** 2 + 4 * d * sine**2))

    def acts_on(self, component: Component) -> bool:
        """Tell whether it is white: what is slower hardly changes while it is held."""
        return isinstance(component, White)


@dataclass(frozen=True)
class HeldPattern(Filter):
    """Samples that are held in a pattern.

    Parameters
    ----------
    chances : tuple of float
        Chance that 1, 2, ... samples in a row are repeats.
    """

    chances: tuple[float, ...]
    symbol: ClassVar[str] = "repeated_samples"

    @property
    def fraction(self) -> float:
        """Share of the samples that are repeats."""
        return self.chances[0]

    def response(self, f: Array, dt: float) -> Array:
        """Return 1 + 2 sum_j r_j cos(2 pi j f dt)."""
        total = np.ones_like(f)
        for j, chance in enumerate(self.chances, start=1):
            total += 2 * chance * np.cos(2 * np.pi * j * dt * f)
        return np.asarray(np.maximum(total, _DARKEST))

    def acts_on(self, component: Component) -> bool:
        """Tell whether it is white."""
        return isinstance(component, White)
