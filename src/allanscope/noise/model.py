"""A noise model: components that add up, behind the filters that act on them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.noise.components import Component
from allanscope.noise.filters import Filter, combined_response
from allanscope.noise.part import Part, Quantity
from allanscope.noise.transfer import Kind, estimator_variance

__all__ = ["Free", "NoiseModel"]

Array = NDArray[np.float64]

_FAMILY: Mapping[str, Kind] = {
    **dict.fromkeys(("avar", "adev", "oadev", "totdev", "theobr", "theoh"), "avar"),
    **dict.fromkeys(("mvar", "mdev", "tdev", "mtotdev", "ttotdev"), "mvar"),
    **dict.fromkeys(("hvar", "hdev", "ohdev", "htotdev"), "hvar"),
}
"""What each estimator is an estimate of."""


class Free(NamedTuple):
    """A number that a fit may vary: which part of the model, which of its quantities."""

    part: int
    quantity: int


@dataclass(frozen=True)
class NoiseModel:
    """Independent components that add up, each times the filters that act on it.

    Parameters
    ----------
    components : tuple of Component
        The noise.
    dt : float
        Time between samples in s.
    filters : tuple of Filter
        What stands between the noise and the samples.

    Examples
    --------
    >>> from allanscope.noise.components import Flicker, RandomWalk, White
    >>> model = NoiseModel((White(4e-3), Flicker(1.2e-3), RandomWalk(1e-4)), dt=1 / 104)
    >>> model.deviation("oadev", [104, 10400]).round(6)
    array([0.004079, 0.001062])
    >>> [component.symbol for component in model]
    ['N', 'B', 'K']
    """

    components: tuple[Component, ...]
    dt: float
    filters: tuple[Filter, ...] = ()

    def __post_init__(self) -> None:
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise ValueError(f"the time between samples must be positive, got {self.dt!r}")

    def __iter__(self) -> Iterator[Component]:
        return iter(self.components)

    def filters_on(self, component: Component) -> tuple[Filter, ...]:
        """Return the filters that a component passes through."""
        return tuple(f for f in self.filters if f.acts_on(component))

    def density(self, f: ArrayLike) -> Array:
        """Return the one-sided density at frequencies in Hz, without pure lines."""
        frequency = np.asarray(f, np.float64)
        total, passed = np.zeros(frequency.shape), self.passing(frequency)
        for component in self.components:
            total = total + passed(component, component.density(frequency, self.dt))
        return total

    def _density(self, component: Component, frequency: Array) -> Array:
        return self.passing(frequency)(component, component.density(frequency, self.dt))

    def passing(self, frequency: Array) -> Callable[[Component, Array], Array]:
        """Return how to get what the filters leave of a component's power at frequencies in Hz."""
        return self.passing_with(lambda one: one.response(frequency, self.dt))

    def passing_with(self, at: Callable[[Filter], Array]) -> Callable[[Component, Array], Array]:
        """Return the same from what gives the response of one filter.

        Most components pass the same filters: each response is computed once.
        """
        response = cache(at)

        @cache
        def combined(filters: tuple[Filter, ...]) -> Array | np.float64:
            return combined_response(filters, self.dt, response)

        def passed(component: Component, power: Array) -> Array:
            filters = self.filters_on(component)
            return np.asarray(power * combined(filters)) if filters else power

        return passed

    def amplitude_behind(self, component: Component, frequency: float) -> float:
        """Return a component's amplitude behind the filters, by their response at a frequency."""
        power = np.array([component.power])
        return float(np.sqrt(self.passing(np.array([frequency]))(component, power)[0]))

    def variance(self, kind: str, m: ArrayLike) -> Array:
        """Return what an estimator expects at averaging factors `m`.

        Parameters
        ----------
        kind : str
            ``avar mvar hvar`` or the name of a deviation such as ``oadev``, whose square is meant.
            The time deviations are the modified ones times tau / sqrt(3).
        m : array_like
            Averaging factors in samples.
        """
        factors = np.asarray(m, np.float64)
        total = np.zeros(factors.shape)
        for variance in self.components_at(kind, factors):
            total = total + variance
        return total

    def deviation(self, kind: str, m: ArrayLike) -> Array:
        """Return the square root of `variance`."""
        return np.sqrt(self.variance(kind, m))

    def components_at(self, kind: str, m: ArrayLike) -> list[Array]:
        """Return the variance that each component contributes, in the order of `components`."""
        factors = np.asarray(m, np.float64)
        family = _family(kind)
        scale = (factors * self.dt) ** 2 / 3 if kind in ("tdev", "ttotdev") else 1.0
        return [self._variance(component, family, factors) * scale for component in self.components]

    def _variance(self, component: Component, family: Kind, m: Array) -> Array:
        """Return the closed form, or the integral of what the filters leave of the density."""
        filters = self.filters_on(component)
        if not filters or component.power == 0.0:
            return np.asarray(getattr(component, family)(m, self.dt))
        parts, unit = (component, *filters), 2 * np.pi * self.dt
        corners = tuple(unit * f for part in parts for f in part.corners(self.dt))
        kinks = tuple(unit * f for part in parts for f in part.kinks(self.dt))
        return estimator_variance(
            lambda w: self._density(component, w / unit) / (2 * self.dt),
            family,
            m,
            corners=corners,
            kinks=kinks,
        )

    @property
    def parts(self) -> tuple[Part, ...]:
        """Components, then filters."""
        return (*self.components, *self.filters)

    @property
    def numbers(self) -> tuple[Free, ...]:
        """Every number of the model."""
        return _numbers(tuple(map(type, self.parts)))

    @property
    def shapes(self) -> frozenset[Free]:
        """Those that are no amplitudes."""
        return _shapes(tuple(map(type, self.parts)))

    def quantity(self, free: Free) -> Quantity:
        """Return what a number is."""
        return self.parts[free.part].quantities[free.quantity]

    def number(self, free: Free) -> float:
        """Return the value of a number."""
        return self.parts[free.part].values[free.quantity]

    def with_numbers(self, free: Sequence[Free], values: Iterable[float]) -> NoiseModel:
        """Return the model with other values of some numbers."""
        parts = list(self.parts)
        for one, value in zip(free, values, strict=True):
            numbers = list(parts[one.part].values)
            numbers[one.quantity] = float(value)
            parts[one.part] = parts[one.part].with_values(numbers)
        return self._of(parts)

    def _of(self, parts: Sequence[Part]) -> NoiseModel:
        return replace(
            self,
            components=tuple(p for p in parts if isinstance(p, Component)),
            filters=tuple(p for p in parts if isinstance(p, Filter)),
        )

    def value(self, name: str) -> float:
        """Return the number with this name (``N``, ``cutoff``, ...), 0 where there is none."""
        for free in self.numbers:
            if self.quantity(free).name == name:
                return self.number(free)
        return 0.0

    def get(self, symbol: str) -> Part | None:
        """Return the first part with this symbol."""
        return next((part for part in self.parts if part.symbol == symbol), None)

    def plus(self, *parts: Part) -> NoiseModel:
        """Return the model with more components and filters."""
        return self._of((*self.parts, *parts))

    def without(self, *symbols: str) -> NoiseModel:
        """Return the model without the parts of these symbols."""
        return self._of([part for part in self.parts if part.symbol not in symbols])


@lru_cache(maxsize=1024)  # a search fits the same few models thousands of times
def _numbers(kinds: tuple[type[Part], ...]) -> tuple[Free, ...]:
    return tuple(Free(i, j) for i, kind in enumerate(kinds) for j in range(len(kind.quantities)))


@lru_cache(maxsize=1024)
def _shapes(kinds: tuple[type[Part], ...]) -> frozenset[Free]:
    return frozenset(
        f for f in _numbers(kinds) if kinds[f.part].quantities[f.quantity].role == "shape"
    )


def _family(kind: str) -> Kind:
    if kind not in _FAMILY:
        raise ValueError(f"no model of {kind!r}; choose one of {' '.join(_FAMILY)}")
    return _FAMILY[kind]
