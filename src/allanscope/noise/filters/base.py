"""What a filter is: named numbers and a power response."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components.base import Component
from allanscope.noise.part import Part

__all__ = ["Filter"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Filter(Part):
    """A power response by which the density of some components is multiplied."""

    @abstractmethod
    def response(self, f: Array, dt: float) -> Array:
        """Return the power response at frequencies in Hz, for samples `dt` apart."""

    def acts_on(self, component: Component) -> bool:
        """Tell whether a component passes through it."""
        return component.is_filtered
