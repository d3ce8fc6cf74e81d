"""The whitening domain: the noise of one axis fitted to its ordinates, and evaluated at each."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.noise import NoiseModel
from allanscope.noise.components import Component
from allanscope.noise.evidence import Ordinates
from allanscope.noise.filters import combined_response
from allanscope.noise.grid import Grid, Ranges
from allanscope.noise.likelihood import Fit, Likelihood
from allanscope.noise.once import once

__all__ = ["Spectrum", "fit_spectrum"]

Array = NDArray[np.float64]

Evaluation = Callable[[Component], Array]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A fitted noise spectrum.

    Attributes
    ----------
    fit : Fit
        Maximum of the likelihood of the bins.
    excluded : tuple of (low, high)
        Left out of it.
    """

    grid: Grid
    fit: Fit
    excluded: Ranges = ()

    @property
    def model(self) -> NoiseModel:
        """The fitted model."""
        return self.fit.model

    @property
    def loglik(self) -> float:
        """Whittle log-likelihood at the maximum."""
        return self.fit.loglik

    @property
    def powers(self) -> Array:
        """Squared amplitudes, from which another fit may start."""
        return np.array([c.power for c in self.model if c.has_amplitude])

    def first(self, m: int) -> Array:
        """Variances of the first m ordinates."""
        frequency = self.grid.frequency[:m]
        return self._sum(self.model, lambda c: self.grid.first(c, m), frequency)

    def at(self, frequency: Array) -> Array:
        """Variance of a DCT ordinate at given frequencies (two-sided density times the rate)."""
        return self.of(self.model, frequency)

    def of(self, components: Iterable[Component], frequency: Array) -> Array:
        """Return what some of the components contribute to that, behind the filters."""
        return self._sum(components, lambda c: self.grid.at(c, frequency), frequency)

    def _sum(self, components: Iterable[Component], of: Evaluation, frequency: Array) -> Array:
        total = np.zeros_like(frequency)
        for component in components:
            part = of(component)
            if filters := self.model.filters_on(component):
                part = part * combined_response(
                    filters, self.grid.dt, lambda f: f.response(frequency, self.grid.dt)
                )
            total += part
        return total

    @once
    def ordinates(self) -> Array:
        """Variance of every ordinate, shape (n - 1,).

        The first ones are exact, smooth ones further up interpolated.
        """
        grid = self.grid
        unit = grid.rate_hz / (2 * grid.n)
        smooth = [c for c in self.model if not c.is_narrow]
        nodes = grid.nodes * unit
        total = grid.interpolate(self._sum(smooth, lambda c: grid.at(c, nodes), nodes))
        total[: grid.low] = self._sum(
            smooth, lambda c: grid.first(c, grid.low), grid.frequency[: grid.low]
        )
        for component in self.model:
            if component.is_narrow:
                total += component.spectrum(grid.frequency, grid.dt, grid.stride)
        return total

    @once
    def kept(self) -> NDArray[np.bool_]:
        """Ordinates that take part in the fit."""
        return self.grid.kept(self.excluded)

    def loglik_of(self, power: Array) -> float:
        """Log-likelihood of other binned power (mean square ordinates) under this spectrum."""
        dof, expected = self.fit.likelihood.dof, self.fit.expected
        return float(-0.5 * np.sum(dof * (np.log(expected) + power / expected)))


def fit_spectrum(
    grid: Grid,
    power: Array,
    model: NoiseModel,
    *,
    excluded: Ranges = (),
    start: Array | None = None,
) -> Spectrum:
    """Fit the amplitudes of a model to binned power by maximum likelihood, shapes held.

    Parameters
    ----------
    power : ndarray, shape (bins,)
        Mean square of the ordinates in every bin (see `Grid.binned`).
    model : NoiseModel
        Of the samples behind the rows.
    start : ndarray, optional
        Squared amplitudes to start from.
    """
    likelihood = Likelihood([Ordinates(grid, power, grid.counts(excluded))])
    return Spectrum(grid, likelihood.amplitudes(model, start), excluded)
