"""The likelihood of a noise model, and its maximum.

Powers p_b with nu_b degrees of freedom and expectation lambda_b(theta) have the log-likelihood

    log L = -1/2 sum_b nu_b (ln lambda_b + p_b / lambda_b)                                (Whittle)

up to what does not depend on the model. The Fisher information about theta is
1/2 sum nu_b (d ln lambda_b / d theta)^2, from which the Cramer-Rao bound follows, and Fisher
scoring is a weighted least-squares step. A component enters through the square of its amplitude,
in which lambda is linear, so that zero is an ordinary boundary point and not minus infinity; shapes
(a correlation time, a cutoff) are varied as logarithms between their bounds. Debiasing after
Sykulski et al. (Biometrika 2019): lambda is the expectation of what was computed from the finite
record and not the density.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components import Component
from allanscope.noise.ordinates import Evidence

__all__ = ["Free", "WhittleFit", "fit", "loglik"]

Array = NDArray[np.float64]

_STEPS = 100
_GAIN = 1e-7
"""Nats below which a step is the last one."""
_LONGEST = 1.0
"""Largest change of the logarithm of a shape in one step."""


@dataclass(frozen=True, slots=True)
class Free:
    """A number that a fit varies: which component, which of its quantities."""

    component: int
    quantity: int


@dataclass(frozen=True)
class WhittleFit:
    """The maximum of the likelihood.

    Attributes
    ----------
    components : tuple of Component
        With their fitted numbers.
    log_likelihood : float
        At the maximum.
    free : tuple of Free
        What was varied.
    names : tuple of str
        Their names, e.g. ``("N", "B", "K")``.
    values : ndarray, shape (p,)
        Their fitted values.
    information : ndarray, shape (p, p)
        Fisher information about the *logarithms* of the values; a row of zeros for a value of 0.
    converged : bool
        Whether the last step gained less than 1e-7 nats.
    """

    components: tuple[Component, ...]
    log_likelihood: float
    free: tuple[Free, ...]
    names: tuple[str, ...]
    values: Array
    information: Array = field(repr=False)
    converged: bool

    def relative_sd(self) -> Array:
        """Return the relative standard deviation of every value; infinite for zeros."""
        known = self.values > 0
        sd = np.full(len(self.values), np.inf)
        block = self.information[np.ix_(known, known)]
        sd[known] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(block, hermitian=True)), 0.0))
        return sd


def loglik(evidence: Sequence[Evidence], model: Iterable[Component]) -> float:
    """Return the log-likelihood of a model (a `NoiseModel`, or any components)."""
    components = tuple(model)
    total = 0.0
    for part in evidence:
        expected = np.sum([part.expected(component) for component in components], axis=0)
        total += _loglik(part.power, part.dof, np.maximum(expected, _tiny(part.power)))
    return total


def fit(
    evidence: Sequence[Evidence],
    components: Iterable[Component],
    *,
    held: Collection[Free] = (),
) -> WhittleFit:
    """Find the numbers of the components that maximise the likelihood.

    Parameters
    ----------
    evidence : sequence of Evidence
        Ordinates, density bands, or both.
    components : iterable of Component
        The model; the numbers are where the search starts.
    held : collection of Free
        What keeps its value.

    Returns
    -------
    WhittleFit
    """
    problem = _Problem(evidence, tuple(components), frozenset(held))
    return problem.solve()


class _Problem:
    """Projected Fisher scoring in (squared amplitudes, logarithms of shapes)."""

    def __init__(
        self, evidence: Sequence[Evidence], start: tuple[Component, ...], held: frozenset[Free]
    ) -> None:
        self.evidence = evidence
        self.power = np.concatenate([part.power for part in evidence])
        self.dof = np.concatenate([part.dof for part in evidence])
        self.tiny = _tiny(self.power)
        self.components = start
        self.free = tuple(
            free
            for i, component in enumerate(start)
            for free in (Free(i, j) for j in range(len(component.quantities)))
            if free not in held
        )
        quantities = [start[f.component].quantities[f.quantity] for f in self.free]
        self.names = tuple(quantity.name for quantity in quantities)
        self.is_shape = np.array([quantity.role == "shape" for quantity in quantities], bool)
        self.low = np.array([np.log(q.lower) if q.role == "shape" else 0.0 for q in quantities])
        self.high = np.array([np.log(q.upper) if q.role == "shape" else np.inf for q in quantities])
        self.columns: dict[Component, Array] = {}

    def solve(self) -> WhittleFit:
        point = np.array([self._coordinate(f) for f in self.free])
        expected, jacobian = self._evaluate(point)
        value = _loglik(self.power, self.dof, expected)
        converged = False
        for _ in range(_STEPS):
            weight = self.dof / (2 * expected**2)
            gradient = jacobian.T @ (weight * (self.power - expected))
            curvature = (jacobian * weight[:, np.newaxis]).T @ jacobian
            step = self._step(point, gradient, curvature)
            fraction, gained = 1.0, -np.inf
            while fraction > 1e-4:
                trial = np.clip(point + fraction * step, self.low, self.high)
                new_expected, new_jacobian = self._evaluate(trial)
                gained = _loglik(self.power, self.dof, new_expected) - value
                if gained >= 0:
                    break
                fraction /= 4
            if gained < 0:
                converged = True
                break
            point, expected, jacobian, value = trial, new_expected, new_jacobian, value + gained
            if gained < _GAIN:
                converged = True
                break
        return self._result(point, expected, jacobian, value, converged)

    def _step(self, point: Array, gradient: Array, curvature: Array) -> Array:
        """Scoring step among the points within the bounds: a small active-set method.

        What sits on a bound and is pushed outwards stays there; what a step would carry across a
        bound is put on it and the others are solved for again.
        """
        step = np.zeros(len(point))
        scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        active = ~(
            ((point <= self.low) & (gradient <= 0)) | ((point >= self.high) & (gradient >= 0))
        )
        fixed = np.zeros(len(point))
        while active.any():
            block = curvature[np.ix_(active, active)] / np.outer(scale[active], scale[active])
            block[np.diag_indices_from(block)] += 1e-9
            right = (gradient - curvature @ fixed)[active] / scale[active]
            step[active] = np.linalg.solve(block, right) / scale[active]
            below = active & (point + step < self.low)
            above = active & (point + step > self.high)
            if not (below.any() or above.any()):
                break
            fixed[below] = (self.low - point)[below]
            fixed[above] = (self.high - point)[above]
            step[below | above] = fixed[below | above]
            active &= ~(below | above)
        shape = self.is_shape
        step[shape] = np.clip(step[shape], -_LONGEST, _LONGEST)
        return step

    def _coordinate(self, free: Free) -> float:
        component = self.components[free.component]
        value = component.values[free.quantity]
        shape = component.quantities[free.quantity].role == "shape"
        return float(np.log(value)) if shape else value**2

    def _at(self, point: Array) -> list[Component]:
        values = [list(component.values) for component in self.components]
        for free, coordinate, shape in zip(self.free, point, self.is_shape, strict=True):
            value = np.exp(coordinate) if shape else np.sqrt(max(coordinate, 0.0))
            values[free.component][free.quantity] = float(value)
        return [c.with_values(v) if v else c for c, v in zip(self.components, values, strict=True)]

    def _evaluate(self, point: Array) -> tuple[Array, Array]:
        """Return the expected powers and their derivatives by the coordinates."""
        expected = np.zeros(len(self.power))
        jacobian = np.empty((len(self.power), len(self.free)))
        for i, component in enumerate(self._at(point)):
            mine = [j for j, free in enumerate(self.free) if free.component == i]
            unit, power = _unit(component)
            column = self._column(unit)
            expected += power * column
            for j in mine:
                if self.is_shape[j]:
                    jacobian[:, j] = power * self._slope(unit, self.free[j].quantity)
                else:
                    jacobian[:, j] = column
        return np.maximum(expected, self.tiny), jacobian

    def _column(self, unit: Component) -> Array:
        """Return the expected powers of a component of unit amplitude, once for each shape."""
        if unit not in self.columns:
            if len(self.columns) > 64:
                self.columns.clear()
            parts = [part.expected(unit) for part in self.evidence]
            self.columns[unit] = np.concatenate(parts)
        return self.columns[unit]

    def _slope(self, unit: Component, quantity: int) -> Array:
        """Return the derivative of the column by the logarithm of a shape."""
        bound = unit.quantities[quantity]
        value, h = unit.values[quantity], 1e-3
        up, down = min(value * np.exp(h), bound.upper), max(value * np.exp(-h), bound.lower)
        columns = []
        for moved in (up, down):
            values = list(unit.values)
            values[quantity] = moved
            columns.append(self._column(unit.with_values(values)))
        return np.asarray((columns[0] - columns[1]) / np.log(up / down))

    def _result(
        self, point: Array, expected: Array, jacobian: Array, value: float, converged: bool
    ) -> WhittleFit:
        components = tuple(self._at(point))
        values = np.array([components[f.component].values[f.quantity] for f in self.free])
        by_log = jacobian * np.where(self.is_shape, 1.0, 2 * values**2)
        by_log = by_log * (np.sqrt(self.dof / 2) / expected)[:, np.newaxis]
        return WhittleFit(
            components=components,
            log_likelihood=value,
            free=self.free,
            names=self.names,
            values=values,
            information=by_log.T @ by_log,
            converged=converged,
        )


def _unit(component: Component) -> tuple[Component, float]:
    """Split a component into one of unit amplitude and its power."""
    for j, quantity in enumerate(component.quantities):
        if quantity.role == "amplitude":
            values = list(component.values)
            power, values[j] = values[j] ** 2, 1.0
            return component.with_values(values), power
    return component, 1.0


def _loglik(power: Array, dof: Array, expected: Array) -> float:
    return float(-0.5 * np.sum(dof * (np.log(expected) + power / expected)))


def _tiny(power: Array) -> float:
    """Floor of an expected power, so that a likelihood is finite for every model."""
    return max(1e-12 * float(np.median(power)), 1e-300)
