"""Named numbers with their ranges: what components and filters of a model have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np

__all__ = ["Part", "Quantity"]


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number of a part.

    Attributes
    ----------
    name : str
        Field of the part that holds it.
    unit : str
        With ``{unit}`` for the unit of the axis, e.g. ``{unit}/sqrt(Hz)``.
    role : {'amplitude', 'shape'}
        The power of a component is proportional to the square of its one amplitude, which a fit
        varies as a power from zero up. A shape is varied as a logarithm between its bounds.
    lower, upper : float
        Bounds of a shape.
    """

    name: str
    unit: str
    role: Literal["amplitude", "shape"] = "amplitude"
    lower: float = 0.0
    upper: float = np.inf


@dataclass(frozen=True)
class Part:
    """A part of a model; a frozen dataclass whose fields are described by `quantities`."""

    symbol: ClassVar[str] = ""
    quantities: ClassVar[tuple[Quantity, ...]] = ()

    @property
    def values(self) -> tuple[float, ...]:
        """The numbers, in the order of `quantities`."""
        return tuple(getattr(self, quantity.name) for quantity in self.quantities)

    def with_values(self, values: Sequence[float]) -> Self:
        """Return the same part with other numbers."""
        names = (quantity.name for quantity in self.quantities)
        return replace(self, **dict(zip(names, map(float, values), strict=True)))

    def corners(self, dt: float) -> tuple[float, ...]:
        """Frequencies in Hz near which its density or response changes quickly, for integrals."""
        del dt
        return ()

    def _check_positive(self) -> None:
        """Refuse numbers out of their bounds; for use in ``__post_init__``."""
        for quantity in self.quantities:
            value = getattr(self, quantity.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(
                    f"{type(self).__name__}.{quantity.name} must be a finite number >= 0,"
                    f" got {value!r}"
                )
            if quantity.role == "shape" and not quantity.lower <= value <= quantity.upper:
                raise ValueError(
                    f"{type(self).__name__}.{quantity.name} must lie between {quantity.lower:g}"
                    f" and {quantity.upper:g}, got {value:g}"
                )
