"""A noise model: the sum of its components."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.noise.components import Component

__all__ = ["NoiseModel"]

Array = NDArray[np.float64]

_VARIANCE: Mapping[str, Callable[[Component, Array, float], Array]] = {
    "a": lambda component, m, dt: component.avar(m, dt),
    "m": lambda component, m, dt: component.mvar(m, dt),
    "h": lambda component, m, dt: component.hvar(m, dt),
}
_FAMILY: Mapping[str, str] = {
    **dict.fromkeys(("adev", "oadev", "totdev", "theobr", "theoh"), "a"),
    **dict.fromkeys(("mdev", "tdev", "mtotdev", "ttotdev"), "m"),
    **dict.fromkeys(("hdev", "ohdev", "htotdev"), "h"),
}
"""What each estimator is an estimate of."""


@dataclass(frozen=True)
class NoiseModel:
    """Independent components that add up.

    Parameters
    ----------
    components : tuple of Component
        The parts. A band limit takes the place of plain white noise.
    dt : float
        Time between samples in s.

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

    def __post_init__(self) -> None:
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise ValueError(f"the time between samples must be positive, got {self.dt!r}")

    def __iter__(self) -> Iterator[Component]:
        return iter(self.components)

    def density(self, f: ArrayLike) -> Array:
        """Return the one-sided density at frequencies in Hz, without pure lines."""
        frequency = np.asarray(f, np.float64)
        total = np.zeros(frequency.shape)
        for component in self.components:
            total = total + component.density(frequency, self.dt)
        return total

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
        of = _VARIANCE[_family(kind)]
        scale = (factors * self.dt) ** 2 / 3 if kind in ("tdev", "ttotdev") else 1.0
        return [of(component, factors, self.dt) * scale for component in self.components]

    def value(self, name: str) -> float:
        """Return the number with this name (``N``, ``cutoff``, ...), 0 where there is none."""
        for component in self.components:
            for quantity, value in zip(component.quantities, component.values, strict=True):
                if quantity.name == name:
                    return value
        return 0.0

    def get(self, symbol: str) -> Component | None:
        """Return the first component with this symbol."""
        return next((c for c in self.components if c.symbol == symbol), None)

    def plus(self, *components: Component) -> NoiseModel:
        """Return the model with more components."""
        return NoiseModel((*self.components, *components), self.dt)

    def without(self, *symbols: str) -> NoiseModel:
        """Return the model without the components of these symbols."""
        kept = tuple(c for c in self.components if c.symbol not in symbols)
        return NoiseModel(kept, self.dt)


def _family(kind: str) -> str:
    if kind in ("avar", "mvar", "hvar"):
        return kind[0]
    if kind not in _FAMILY:
        raise ValueError(f"no model of {kind!r}; choose one of avar mvar hvar {' '.join(_FAMILY)}")
    return _FAMILY[kind]
