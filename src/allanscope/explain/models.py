"""From a fitted spectrum to the components of the noise room."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.explain.spectral import Spectrum, Term, response
from allanscope.explain.view import View
from allanscope.noise.components import (
    AngleQuantization,
    Component,
    Flicker,
    GaussMarkov,
    Ramp,
    RandomWalk,
    Rounding,
    White,
)
from allanscope.noise.model import NoiseModel

__all__ = ["Filtered", "Shaped", "model_of", "with_ramp"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shaped(Component):
    """A process of the loop whose spectrum is given by a shape: everything follows from it.

    Parameters
    ----------
    sigma : float
        Standard deviation of the process.
    terms : tuple of Term
        Their shapes are multiplied.
    name : str
        Kind of the effect, under which it is drawn.
    """

    sigma: float
    terms: tuple[Term, ...]
    name: str = ""
    symbol: ClassVar[str] = ""

    def __post_init__(self) -> None:
        # One class stands for every kind: the name of the curve is that of the effect.
        object.__setattr__(self, "symbol", self.name)

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return 2 dt sigma^2 times the shapes."""
        frequency = np.asarray(f, np.float64)
        total = np.full(frequency.shape, 2 * dt * self.sigma**2)
        for term in self.terms:
            total = total * term.shape(frequency, 1 / dt, term.nonlinear)
        return total

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the frequencies of the shapes."""
        found = []
        for term in self.terms:
            if term.nonlinear:
                corner = term.nonlinear[0]
                found.append(
                    1 / (2 * np.pi * corner) if "lorentz" in term.shape.__name__ else corner
                )
        return tuple(float(f) for f in found if 0 < f < 0.5 / dt)


@dataclass(frozen=True)
class Filtered(Component):
    """A textbook term behind the filters that the loop found.

    Parameters
    ----------
    base : Component
        What goes into them.
    terms : tuple of Term
        Their power responses are multiplied.
    name : str
        Under which it is drawn.
    """

    base: Component
    terms: tuple[Term, ...]
    name: str
    symbol: ClassVar[str] = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "symbol", self.name)
        object.__setattr__(self, "quantities", self.base.quantities)

    @property
    def values(self) -> tuple[float, ...]:
        """The numbers of what goes in."""
        return self.base.values

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return the density of what goes in times the power responses."""
        frequency = np.asarray(f, np.float64)
        factor = response(self.terms, 1 / dt, lambda t: t.shape(frequency, 1 / dt, t.nonlinear))
        return np.asarray(self.base.density(frequency, dt) * factor)

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the corners of what goes in and of the filters."""
        own = tuple(float(t.nonlinear[0]) for t in self.terms if t.kind == "band_limit")
        return self.base.corners(dt) + tuple(f for f in own if 0 < f < 0.5 / dt)


def model_of(view: View, spectrum: Spectrum | None = None) -> NoiseModel:
    """Return the fitted noise of a view as a model that every estimator can be asked of.

    Parameters
    ----------
    view : View
        As the loop left it.
    spectrum : Spectrum, optional
        In place of that of the view.
    """
    spectrum = spectrum or view.spectrum
    dt = 1 / view.grid.rate_hz
    white = float(np.sqrt(spectrum.variance_of("N")))
    factors = tuple(t for t in spectrum.terms if t.role == "shapes")
    filters = tuple(t for t in factors if t.kind == "band_limit")
    slow = (
        Flicker(float(np.sqrt(spectrum.variance_of("B")))),
        RandomWalk(float(np.sqrt(spectrum.variance_of("K")))),
    )
    parts: list[Component] = [White(white)]
    if factors:
        parts = [Filtered(White(white), factors, (filters or factors)[0].kind)]
    parts += [Filtered(part, filters, part.symbol) if filters else part for part in slow]
    if "Q" in spectrum.base:
        parts.append(AngleQuantization(float(np.sqrt(spectrum.variance_of("Q")))))
    if spectrum.floor > 0:
        parts.append(Rounding(float(np.sqrt(12 * spectrum.floor))))
    for term in spectrum.terms:
        if term.role != "adds":
            continue
        sigma = spectrum.sigma_of(term)[0]
        if term.kind == "gauss_markov":
            parts.append(GaussMarkov(sigma, term.nonlinear[0]))
        elif term.kind == "Q":
            parts.append(AngleQuantization(sigma))
        else:
            parts.append(Shaped(sigma, (term,), term.kind))
    return NoiseModel(tuple(parts), dt)


def with_ramp(model: NoiseModel, slope: float) -> NoiseModel:
    """Return the model with a ramp."""
    return model.plus(Ramp(abs(slope))) if slope else model
