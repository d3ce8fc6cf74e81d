"""What a noise component is: named numbers, a density, and what every estimator makes of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.noise.folding import fold
from allanscope.noise.transfer import Kind, estimator_variance

__all__ = ["COMPONENTS", "Component", "Quantity"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number of a component.

    Attributes
    ----------
    name : str
        Field of the component that holds it.
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


COMPONENTS: dict[str, type[Component]] = {}
"""Every component class by its symbol; a class enters by being defined."""


@dataclass(frozen=True)
class Component(ABC):
    """One independent part of the noise of an axis.

    A subclass is a frozen dataclass whose fields are its numbers, described in the same order by
    `quantities`. It must know its `density`; everything else follows from that by exact integrals
    and is overridden where a closed form exists. Samples are `dt` apart, `m` is an averaging
    factor in samples.

    Class attributes
    ----------------
    symbol : str
        Letter of IEEE 952 (``N``), or the kind of an effect (``gauss_markov``).
    quantities : tuple of Quantity
        What the fields mean.
    """

    symbol: ClassVar[str] = ""
    quantities: ClassVar[tuple[Quantity, ...]] = ()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.symbol:
            COMPONENTS[cls.symbol] = cls

    @property
    def values(self) -> tuple[float, ...]:
        """The numbers, in the order of `quantities`."""
        return tuple(getattr(self, quantity.name) for quantity in self.quantities)

    def with_values(self, values: Sequence[float]) -> Self:
        """Return the same component with other numbers."""
        names = (quantity.name for quantity in self.quantities)
        return replace(self, **dict(zip(names, map(float, values), strict=True)))

    @abstractmethod
    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return the one-sided density of the samples (aliases included), unit^2 / Hz.

        Parameters
        ----------
        f : array_like
            Frequency in Hz, between 0 and the Nyquist frequency 1 / (2 dt).
        dt : float
            Time between samples in s.
        """

    def band_density(self, f: ArrayLike, width: ArrayLike, dt: float) -> Array:
        """Return the mean density in bands of `width` centred on `f`."""
        del width
        return self.density(f, dt)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return the Allan variance at averaging factors `m`."""
        return self._variance("avar", m, dt)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return the modified Allan variance at averaging factors `m`."""
        return self._variance("mvar", m, dt)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return the Hadamard variance (factor 1/6 of SP 1065) at averaging factors `m`."""
        return self._variance("hvar", m, dt)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return the expected square of the orthonormal DCT-II ordinates of a record of n rows.

        Parameters
        ----------
        k : array_like of int
            Ordinates, from 1 to n - 1; the frequency is k / (2 n stride dt).
        n : int
            Rows of the record.
        dt : float
            Time between *samples* in s.
        stride : int
            Samples averaged into a row.

        Notes
        -----
        Here the density over 2 dt, folded by the averaging. What the ends of the record add at the
        lowest ordinates is in the overrides of components that vary much below k = 10.
        """
        phase = np.pi * np.asarray(k, np.float64) / n
        return fold(lambda w: self.density(w / (2 * np.pi * dt), dt) / (2 * dt), phase, stride)

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        """Frequency in Hz and mean square of everything in it that is a pure line."""
        return ()

    def corners(self, dt: float) -> tuple[float, ...]:
        """Frequencies in Hz near which the density changes quickly, for the integrals."""
        del dt
        return ()

    def _variance(self, kind: Kind, m: ArrayLike, dt: float) -> Array:
        return estimator_variance(
            lambda w: self.density(w / (2 * np.pi * dt), dt) / (2 * dt),
            kind,
            m,
            corners=tuple(2 * np.pi * dt * f for f in self.corners(dt)),
        )

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
