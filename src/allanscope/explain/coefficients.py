"""The coefficients of IEEE 952 beside whatever effects were found.

The noise room knows how to turn the maximum of a likelihood into values without bias, intervals
that hold at zero, a decision and a time to wait. Here the bins of a view are put before it as
evidence, in which the textbook terms and the processes of the effects are columns. Shapes stay
where the loop has put them; every variance is free.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from allanscope.explain.models import Shaped
from allanscope.explain.regression import joint_fit, ramp_ordinates
from allanscope.explain.spectral import Spectrum, Term
from allanscope.explain.view import View
from allanscope.noise.coefficients import Coefficient
from allanscope.noise.components import (
    AngleQuantization,
    Component,
    Flicker,
    Quantity,
    RandomWalk,
    Rounding,
    White,
)
from allanscope.noise.estimates import Estimates
from allanscope.noise.whittle import Likelihood

__all__ = ["coefficients_of"]

Array = NDArray[np.float64]

_TEXTBOOK: Mapping[str, type[Component]] = {
    "N": White,
    "B": Flicker,
    "K": RandomWalk,
    "Q": AngleQuantization,
}


@dataclass(frozen=True)
class Process(Shaped):
    """A process that an effect adds, of which a fit varies the size."""

    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("sigma", "{unit}"),)


class Bins:
    """The binned power of a view, as evidence for the noise room.

    Parameters
    ----------
    view : View
        As the loop left it.
    """

    def __init__(self, view: View) -> None:
        grid, design = view.grid, view.spectrum.design
        self._columns = dict(zip(_names(view.spectrum), design.basis.T, strict=True))
        if "Q" not in self._columns:
            self._columns["Q"] = grid.textbook_bins["Q"]
        self.power = view.power
        self.dof = design.count
        self.frequency = grid.centre

    def expected(self, component: Component) -> Array:
        """Return what a component contributes to each bin."""
        if isinstance(component, Rounding):
            return np.full(len(self.power), component.lsb**2 / 12)
        name = component.terms[0] if isinstance(component, Process) else component.symbol
        return np.asarray(component.values[0] ** 2 * self._columns[name])

    def up_to(self, highest: float) -> Bins:
        """Return all bins: what is no use is already left out."""
        del highest
        return self


def coefficients_of(view: View) -> Mapping[str, Coefficient]:
    """Return Q, N, B, K and R with 95 % intervals.

    Q and R that did not win a place in the model are given as upper limits.
    """
    spectrum, rate_hz = view.spectrum, view.grid.rate_hz
    components = _components(spectrum)
    likelihood = Likelihood([Bins(view)])
    fit = likelihood.maximise(components)
    duration = view.grid.n / rate_hz
    estimates = Estimates(likelihood, fit, 1 / rate_hz, duration, view.unit)
    return {
        "Q": estimates.quantization(),
        **{letter: estimates.coefficient(letter) for letter in "NBK"},
        "R": _ramp(view),
    }


def _names(spectrum: Spectrum) -> list[str | Term]:
    """Name the columns of the design: letters, then the processes that effects add."""
    adding = [t for t in spectrum.terms if t.role == "adds"]
    return [*spectrum.base, *("Q" if t.kind == "Q" else t for t in adding)]


def _components(spectrum: Spectrum) -> tuple[Component, ...]:
    """Return the model with the numbers of the loop's fit, where the search starts."""
    sizes = np.sqrt(np.maximum(spectrum.variances, 0.0)).tolist()
    parts: list[Component] = [
        Process(size, (name,), name.kind) if isinstance(name, Term) else _TEXTBOOK[name](size)  # type: ignore[call-arg]
        for name, size in zip(_names(spectrum), sizes, strict=True)
    ]
    if spectrum.floor > 0:
        parts.append(Rounding(float(np.sqrt(12 * spectrum.floor))))
    return tuple(parts)


def _ramp(view: View) -> Coefficient:
    accepted = next((c for c in view.accepted if c.kind == "ramp"), None)
    unit = f"{view.unit}/s"
    if accepted is not None:
        slope = accepted.parameters["R"]
        assert isinstance(slope.value, float)
        assert slope.lower is not None
        assert slope.upper is not None
        half = (slope.upper - slope.lower) / 2
        value = abs(slope.value)
        return Coefficient(value, max(value - half, 0.0), value + half, unit, detected=True)
    fit = joint_fit(view, ramp_ordinates(view.grid, view.grid.low))
    value, error = abs(float(fit.amplitude[0])), float(np.sqrt(fit.covariance[0, 0]))
    return Coefficient(value, 0.0, value + norm.isf(0.025) * error, unit, detected=False)
