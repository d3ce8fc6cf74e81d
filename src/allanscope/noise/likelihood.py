r"""The likelihood of a noise model, and its maximum.

Powers p_b with nu_b degrees of freedom and expectation lambda_b(theta) have the log-likelihood

.. math:: \ln L = -\tfrac12 \sum_b \nu_b (\ln \lambda_b + p_b / \lambda_b)        \quad (Whittle)

up to what does not depend on the model. The Fisher information about theta is
:math:`\tfrac12 \sum_b \nu_b (\partial \ln \lambda_b / \partial \theta)^2`, from which the
Cramer-Rao bound follows. Debiasing after Sykulski et al. (Biometrika 2019): lambda is the
expectation of what was computed from the finite record, not the density.

Expected powers are linear in the squares of the amplitudes, which are found by Fisher scoring for
given shapes (`amplitudes`); shapes (a correlation time, a cutoff) are varied around that as
logarithms between their bounds (variable projection).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from allanscope.lazy import once
from allanscope.noise.amplitudes import maximise
from allanscope.noise.components import Component
from allanscope.noise.evidence import Evidence
from allanscope.noise.filters import combined_response
from allanscope.noise.model import Free, NoiseModel
from allanscope.optimise import minimise

__all__ = ["Basis", "Fit", "Likelihood", "inverse"]

Array = NDArray[np.float64]

_DIFFERENCE = 1e-3
"""Of the logarithm of a shape, for derivatives."""
_SIMPLEX = 0.15
"""First step of a search, in logarithms of the shapes."""
_SINGULAR = 1e-15
"""Eigenvalues of the information below this part of the largest tell nothing."""
_NATS = 1e-4
"""Gain below which a search for shapes ends."""


def inverse(information: Array) -> Array:
    """Return the covariance of an information matrix, as `numpy.linalg.pinv` in half the time."""
    values, vectors = np.linalg.eigh(information)
    size = np.abs(values)
    kept = size > _SINGULAR * size.max(initial=0.0)
    return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T)


class Likelihood:
    """The likelihood of one body of evidence.

    Parameters
    ----------
    evidence : sequence of Evidence
        Ordinates, density bands, or both; taken as independent.
    """

    def __init__(self, evidence: Sequence[Evidence]) -> None:
        if not evidence:
            raise ValueError("there is no evidence to compute a likelihood from")
        self.evidence = tuple(evidence)
        self.power = np.concatenate([part.power for part in evidence])
        self.dof = np.concatenate([part.dof for part in evidence])

    @once
    def floor(self) -> float:
        """Floor of an expected power, so that a likelihood is finite for every model."""
        middle = len(self.power) // 2
        return max(1e-12 * float(np.partition(self.power, middle)[middle]), 1e-300)

    def column(self, model: NoiseModel, component: Component) -> Array:
        """Return the expected powers of a component behind the filters of a model."""
        filters = model.filters_on(component)
        columns = []
        for part in self.evidence:
            column = part.column(component)
            if filters:
                column = column * combined_response(filters, model.dt, part.response)
            columns.append(column)
        return columns[0] if len(columns) == 1 else np.concatenate(columns)

    def expected(self, model: NoiseModel) -> Array:
        """Return the expected powers under a model."""
        total = np.zeros(len(self.power))
        for component in model:
            total += self.column(model, component)
        return np.maximum(total, self.floor)

    def of(self, model: NoiseModel) -> float:
        """Return the log-likelihood of a model."""
        return self.value(self.expected(model))

    def value(self, expected: Array) -> float:
        """Return the log-likelihood of expected powers."""
        return float(-0.5 * np.sum(self.dof * (np.log(expected) + self.power / expected)))

    def maximise(self, model: NoiseModel, *, held: Collection[Free] = ()) -> Fit:
        """Find the numbers that maximise the likelihood.

        Parameters
        ----------
        model : NoiseModel
            Its shapes are where the search starts.
        held : collection of Free
            What keeps its value.
        """
        held = frozenset(held)
        shapes = sorted(model.shapes - held)
        if not shapes:
            return self._with_amplitudes(model, held)
        low, high = (
            np.array([getattr(model.quantity(f), side) for f in shapes])
            for side in ("lower", "upper")
        )

        def at(point: Array) -> Fit:
            values = np.clip(np.exp(np.clip(point, -700, 700)), low, high)
            return self._with_amplitudes(model.with_numbers(shapes, values), held)

        first = np.array([np.log(model.number(f)) for f in shapes])

        def loss(point: Array) -> float:
            return -at(point).loglik

        steps, turns = _SIMPLEX * np.eye(len(first)), 120 * len(first)
        found = minimise(loss, first, steps, x_within=_NATS, within=_NATS, turns=turns)
        best = at(found.x)
        return Fit(self, best.model, best.loglik, held, found.converged, best.expected)

    def amplitudes(self, model: NoiseModel) -> Fit:
        """Find the powers that maximise the likelihood, all shapes held."""
        return self._with_amplitudes(model, model.shapes)

    def _with_amplitudes(self, model: NoiseModel, held: frozenset[Free]) -> Fit:
        return self.maximum(self.basis(model, held))

    def basis(self, model: NoiseModel, held: frozenset[Free]) -> Basis:
        """Return what the amplitudes of a model multiply; it does not depend on the powers."""
        nothing = NoiseModel((), model.dt, model.filters)
        bins = len(self.power)
        empty = Basis(nothing, held, (), np.empty((0, bins)), np.zeros(bins))
        return self.extended(empty, model, held)

    def extended(self, basis: Basis, model: NoiseModel, held: frozenset[Free]) -> Basis:
        """Return the basis of a model that has more components than that of another basis."""
        first = len(basis.free)
        more = model.components[first:]
        free = tuple(
            bool(c.amplitude_name) and Free(i, c.amplitude_index) not in held
            for i, c in enumerate(more, first)
        )
        fixed, columns = basis.fixed, []
        for component, is_free in zip(more, free, strict=True):
            if is_free:
                columns.append(self.column(model, component.with_power(1.0)))
            else:
                fixed = fixed + self.column(model, component)
        rows = np.vstack([basis.columns, *columns]) if columns else basis.columns
        return Basis(model, held, basis.free + free, rows, fixed)

    def largest(self, basis: Basis) -> float:
        """Return the log-likelihood of `maximum`, without the fit that has it."""
        if not any(basis.free):
            return self.value(np.maximum(basis.fixed, self.floor))
        return maximise(basis.columns, self.power, self.dof, basis.fixed)[1]

    def maximum(self, basis: Basis, start: Array | None = None) -> Fit:
        """Find the powers that maximise the likelihood, beginning at `start` where it is given."""
        model, held = basis.model, basis.held
        if not any(basis.free):
            expected = np.maximum(basis.fixed, self.floor)
            return Fit(self, model, self.value(expected), held, True, expected)
        powers, loglik, expected = maximise(basis.columns, self.power, self.dof, basis.fixed, start)
        return Fit(self, basis.model_of(powers), loglik, held, True, expected)


@dataclass(frozen=True, eq=False)
class Basis:
    """What the amplitudes of a model multiply, for one body of evidence.

    Attributes
    ----------
    free : tuple of bool
        Components whose amplitude is fitted.
    columns : ndarray, shape (p, b)
        What each of them gives the powers at an amplitude of 1.
    fixed : ndarray, shape (b,)
        What the others give.
    """

    model: NoiseModel
    held: frozenset[Free]
    free: tuple[bool, ...]
    columns: Array
    fixed: Array

    def model_of(self, powers: Array) -> NoiseModel:
        """Return the model with the squares of the amplitudes that are fitted, shape (p,)."""
        left = iter(powers.tolist())
        components = tuple(
            c.with_power(next(left)) if f else c for c, f in zip(self.model, self.free, strict=True)
        )
        return NoiseModel(components, self.model.dt, self.model.filters)


@dataclass(frozen=True, eq=False)
class Fit:
    """The maximum of a likelihood.

    Attributes
    ----------
    model : NoiseModel
        With the fitted numbers.
    loglik : float
        At the maximum.
    held : frozenset of Free
        What was not varied.
    converged : bool
        Whether the search for the shapes came to its end.
    expected : ndarray, shape (b,)
        Expected powers of all the evidence.
    """

    likelihood: Likelihood = field(repr=False)
    model: NoiseModel
    loglik: float
    held: frozenset[Free] = field(repr=False)
    converged: bool
    expected: Array = field(repr=False)

    @once
    def free(self) -> tuple[Free, ...]:
        """What was varied."""
        return tuple(f for f in self.model.numbers if f not in self.held)

    def all_free(self) -> Fit:
        """Return the fit as if nothing had been held: with the errors that leaves."""
        return replace(self, held=frozenset())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what was varied, e.g. ``("N", "B", "K")``."""
        return tuple(self.model.quantity(f).name for f in self.free)

    @property
    def values(self) -> Array:
        """Fitted values of what was varied."""
        return np.array([self.model.number(f) for f in self.free])

    @once
    def jacobian(self) -> Array:
        """Derivatives of the logarithms of the expected powers by those of the numbers, (b, p)."""
        return self.derivatives(self.free) / self.expected[:, np.newaxis]

    @once
    def information(self) -> Array:
        """Fisher information about the logarithms of the values; zeros for a value of 0."""
        weighted = self.jacobian * np.sqrt(self.likelihood.dof / 2)[:, np.newaxis]
        return np.asarray(weighted.T @ weighted)

    def derivatives(self, free: Iterable[Free]) -> Array:
        """Return the derivatives of the expected powers by the logarithms of some numbers."""
        columns = []
        for one in free:
            if one in self.model.shapes:
                columns.append(self.by_shape(one))
            else:
                component = self.model.components[one.part]
                columns.append(2 * self.likelihood.column(self.model, component))
        return np.array(columns).T.reshape(len(self.expected), -1)

    def by_shape(self, free: Free, step: float = _DIFFERENCE, *, forward: bool = False) -> Array:
        """Return the derivative of the expected powers by the logarithm of a shape.

        Parameters
        ----------
        free : Free
            The shape; zeros where it is 0.
        step : float
            Of the logarithm, within the bounds.
        forward : bool
            Whether the step is to one side only, which takes half of the time and is not exact to
            the second order.
        """
        quantity, value = self.model.quantity(free), self.model.number(free)
        if value == 0:
            return np.zeros(len(self.expected))
        above, below = (
            float(np.clip(value * np.exp(h), quantity.lower, quantity.upper)) for h in (step, -step)
        )
        if forward and above > value:
            below = value
        up, down = (self._with_shape(free, one) for one in (above, below))
        return np.asarray((up - down) / np.log(above / below))

    def _with_shape(self, free: Free, value: float) -> Array:
        """Return the expected powers of all that a shape is part of, with another value."""
        model = self.model.with_numbers([free], [value])
        if free.part < len(model.components):  # all else stays as it is
            return self.likelihood.column(model, model.components[free.part])
        return self.expected if model == self.model else self.likelihood.expected(model)

    @once
    def covariance(self) -> Array:
        """Covariance of the logarithms of the values; infinite for values of 0."""
        known = self.values > 0
        covariance = np.full((len(known), len(known)), np.inf)
        block = self.information[np.ix_(known, known)]
        covariance[np.ix_(known, known)] = inverse(block)
        return covariance

    def relative_sd(self) -> Array:
        """Return the relative standard deviation of every value; infinite for zeros."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def index(self, name: str) -> int | None:
        """Return the position of the first value with this name, None where it was not varied."""
        return self.names.index(name) if name in self.names else None
