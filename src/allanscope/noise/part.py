"""What the parts of a noise model are: named numbers, components that add up, and filters.

A `Component` says its density, and all that estimators make of it follows; a `Filter` says its
power response.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.noise.transfer import Kind, estimator_variance, fold

__all__ = ["Array", "Component", "Filter", "Part", "Quantity"]

Array = NDArray[np.float64]


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

    def kinks(self, dt: float) -> tuple[float, ...]:
        """Frequencies in Hz between which it is a power of the frequency, for integrals."""
        del dt
        return ()

    def _check_positive(self) -> None:
        """Refuse numbers out of their bounds; for use in ``__post_init__``."""
        for quantity in self.quantities:
            value = getattr(self, quantity.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(
                    f"{type(self).__name__}.{quantity.name} must be a finite number >= 0,"
                    f" got {value!r}"
                )
            if quantity.role == "shape" and not quantity.lower <= value <= quantity.upper:
                raise ValueError(
                    f"{type(self).__name__}.{quantity.name} must lie between {quantity.lower:g}"
                    f" and {quantity.upper:g}, got {value:g}"
                )


@dataclass(frozen=True)
class Component(Part):
    """One independent part of the noise of an axis, which adds to the others.

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
    is_filtered : bool
        Whether a low-pass of the sensor acts on it.
    is_line : bool
        Whether it is a line, which stands beside the noise.
    is_noise : bool
        Whether it has a density: a ramp has none.
    is_steep : bool
        Whether it is so steep that only HVAR has an expectation: the others are infinite.
    amplitude_name, amplitude_index : str, int
        The number whose square the density is proportional to, and its position among the numbers;
        empty where there is none.
    """

    is_filtered: ClassVar[bool] = False
    is_line: ClassVar[bool] = False
    is_noise: ClassVar[bool] = True
    is_steep: ClassVar[bool] = False
    amplitude_name: ClassVar[str] = ""
    amplitude_index: ClassVar[int] = -1

    def __init_subclass__(cls) -> None:
        for index, quantity in enumerate(cls.quantities):
            if quantity.role == "amplitude":
                cls.amplitude_name, cls.amplitude_index = quantity.name, index

    @property
    def band(self) -> tuple[float, float] | None:
        """Centre and width in Hz where the density changes within a bin of the likelihood."""
        return None

    @property
    def peaks(self) -> tuple[tuple[float, float], ...]:
        """Centres and widths in Hz of the peaks of its density."""
        return () if self.band is None else (self.band,)

    @property
    def is_narrow(self) -> bool:
        """Whether there is such a band."""
        return self.band is not None

    @property
    def power(self) -> float:
        """Square of the amplitude, to which densities are proportional; 1 without one."""
        return getattr(self, self.amplitude_name) ** 2 if self.amplitude_name else 1.0

    def with_power(self, power: float) -> Self:
        """Return the component with another squared amplitude; itself where it has none."""
        if not self.amplitude_name or power == self.power:
            return self
        # As `replace` does, which takes ten times as long: a search comes here at every fit.
        return type(self)(**(vars(self) | {self.amplitude_name: float(np.sqrt(max(power, 0.0)))}))

    @property
    def has_amplitude(self) -> bool:
        """Whether there is a power to be fitted."""
        return bool(self.amplitude_name)

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
        return self.spectrum(np.asarray(k, np.float64) / (2 * n * stride * dt), dt, stride)

    def spectrum(self, f: ArrayLike, dt: float, stride: int = 1) -> Array:
        """Return what `ordinates` tends to in a long record, at frequencies in Hz."""
        return fold(
            lambda w: self.density(w / (2 * np.pi * dt), dt) / (2 * dt),
            2 * np.pi * np.asarray(f, np.float64) * stride * dt,
            stride,
        )

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        """Frequency in Hz and mean square of everything in it that is a pure line."""
        return ()

    def _variance(self, kind: Kind, m: ArrayLike, dt: float) -> Array:
        if self.is_steep and kind != "hvar":
            return np.full(np.shape(m), np.inf)
        return estimator_variance(
            lambda w: self.density(w / (2 * np.pi * dt), dt) / (2 * dt),
            kind,
            m,
            corners=tuple(2 * np.pi * dt * f for f in self.corners(dt)),
        )


@dataclass(frozen=True)
class Filter(Part):
    """A power response by which the density of some components is multiplied.

    Class attributes
    ----------------
    has_zeros : bool
        Whether it lets nothing through at some frequencies, where what leaks in is all there is.
    has_ripples : bool
        Whether it changes within a bin of the likelihood.
    """

    has_zeros: ClassVar[bool] = False
    has_ripples: ClassVar[bool] = False

    @abstractmethod
    def response(self, f: Array, dt: float) -> Array:
        """Return the power response at frequencies in Hz, for samples `dt` apart."""

    def acts_on(self, component: Component) -> bool:
        """Return whether a component passes through it."""
        return component.is_filtered
