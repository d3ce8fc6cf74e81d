"""Fisher scoring between bounds: how the maximum of a likelihood is found.

A component enters through the square of its amplitude, in which the expected powers are linear, so
that zero is an ordinary boundary point and not minus infinity. Shapes (a correlation time, a
cutoff) are varied as logarithms between their bounds. Each step solves the weighted least-squares
problem of Fisher scoring among the points within the bounds, and is shortened until it gains. That
takes a handful of steps where the model is right. Where it is wrong, as for a warm-up that no term
can follow, the curvature is not the expected one and scoring creeps: after ten steps the observed
curvature is used, which is Newton's method.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components import Component

if TYPE_CHECKING:
    from allanscope.noise.whittle import Likelihood

__all__ = ["Free", "Search", "WhittleFit"]

Array = NDArray[np.float64]

_STEPS = 100
_SCORING = 10
"""Steps with the expected curvature before the observed one is used."""
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
    expected : ndarray, shape (b,)
        Expected powers of all the evidence.
    converged : bool
        Whether the last step gained less than 1e-7 nats.
    """

    components: tuple[Component, ...]
    log_likelihood: float
    free: tuple[Free, ...]
    names: tuple[str, ...]
    values: Array
    information: Array = field(repr=False)
    expected: Array = field(repr=False)
    converged: bool

    def relative_sd(self) -> Array:
        """Return the relative standard deviation of every value; infinite for zeros."""
        known = self.values > 0
        sd = np.full(len(self.values), np.inf)
        block = self.information[np.ix_(known, known)]
        sd[known] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(block, hermitian=True)), 0.0))
        return sd

    def index(self, name: str) -> int | None:
        """Return the position of the first value with this name, None where it was not varied."""
        return self.names.index(name) if name in self.names else None


class Search:
    """One search for the maximum of a likelihood.

    Parameters
    ----------
    likelihood : Likelihood
        Of the evidence.
    start : tuple of Component
        The model; its numbers are where the search begins.
    held : frozenset of Free
        What keeps its value.
    """

    def __init__(
        self, likelihood: Likelihood, start: tuple[Component, ...], held: frozenset[Free]
    ) -> None:
        self.likelihood = likelihood
        self.start = start
        self.free = tuple(
            free
            for i, component in enumerate(start)
            for free in (Free(i, j) for j in range(len(component.quantities)))
            if free not in held
        )
        quantities = [start[f.component].quantities[f.quantity] for f in self.free]
        self.names = tuple(quantity.name for quantity in quantities)
        self.shape = np.array([quantity.role == "shape" for quantity in quantities], bool)
        self.low = np.array([np.log(q.lower) if q.role == "shape" else 0.0 for q in quantities])
        self.high = np.array([np.log(q.upper) if q.role == "shape" else np.inf for q in quantities])

    def run(self) -> WhittleFit:
        """Iterate to the maximum."""
        data = self.likelihood
        values = np.array([self.start[f.component].values[f.quantity] for f in self.free])
        point = np.where(self.shape, np.log(np.where(self.shape, values, 1.0)), values**2)
        expected, jacobian = data.derivatives(self._at(point), self.free)
        value = data.value(expected)
        converged = False
        for taken in range(_STEPS):
            weight = data.dof / (2 * expected**2)
            gradient = jacobian.T @ (weight * (data.power - expected))
            moving = self._moving(point, gradient)
            curvature = _weighted(jacobian, weight)
            if taken >= _SCORING:
                observed = _weighted(jacobian, weight * (2 * data.power / expected - 1))
                free = np.ix_(moving, moving)
                curvature = observed if _is_convex(observed[free], curvature[free]) else curvature
            step = self._step(point, gradient, curvature, moving)
            fraction, gained = 1.0, -np.inf
            while gained < 0 and fraction > 1e-4:
                trial = np.clip(point + fraction * step, self.low, self.high)
                expected, jacobian = data.derivatives(self._at(trial), self.free)
                gained = data.value(expected) - value
                fraction /= 4
            if gained >= 0:
                point, value = trial, value + gained
            converged = gained < _GAIN
            if converged:
                break
        return self._result(point, value, converged)

    def _moving(self, point: Array, gradient: Array) -> NDArray[np.bool_]:
        """Return which numbers may move: those on a bound that are pushed outwards stay there."""
        outwards = ((point <= self.low) & (gradient <= 0)) | (
            (point >= self.high) & (gradient >= 0)
        )
        return np.asarray(~outwards)

    def _step(
        self, point: Array, gradient: Array, curvature: Array, moving: NDArray[np.bool_]
    ) -> Array:
        """Step among the points within the bounds: a small active-set method.

        What a step would carry across a bound is put on it, and the others are solved for again.
        """
        step = np.zeros(len(point))
        scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        active = moving.copy()
        while active.any():
            block = curvature[np.ix_(active, active)] / np.outer(scale[active], scale[active])
            block[np.diag_indices_from(block)] += 1e-9
            pinned = np.where(active, 0.0, step)
            right = (gradient - curvature @ pinned)[active] / scale[active]
            step[active] = np.linalg.solve(block, right) / scale[active]
            target = np.clip(point + step, self.low, self.high)
            across = active & (target != point + step)
            if not across.any():
                break
            step[across] = (target - point)[across]
            active &= ~across
        return np.where(self.shape, np.clip(step, -_LONGEST, _LONGEST), step)

    def _at(self, point: Array) -> tuple[Component, ...]:
        values = [list(component.values) for component in self.start]
        shapes, squares = np.where(self.shape, point, 0.0), np.where(self.shape, 0.0, point)
        numbers = np.where(self.shape, np.exp(shapes), np.sqrt(squares))
        for free, number in zip(self.free, numbers, strict=True):
            values[free.component][free.quantity] = float(number)
        return tuple(c.with_values(v) if v else c for c, v in zip(self.start, values, strict=True))

    def _result(self, point: Array, value: float, converged: bool) -> WhittleFit:
        data, components = self.likelihood, self._at(point)
        expected, jacobian = data.derivatives(components, self.free)
        values = np.array([components[f.component].values[f.quantity] for f in self.free])
        by_log = jacobian * np.where(self.shape, 1.0, 2 * values**2)
        by_log = by_log * (np.sqrt(data.dof / 2) / expected)[:, np.newaxis]
        return WhittleFit(
            components=components,
            log_likelihood=value,
            free=self.free,
            names=self.names,
            values=values,
            information=by_log.T @ by_log,
            expected=expected,
            converged=converged,
        )


def _weighted(jacobian: Array, weight: Array) -> Array:
    return np.asarray((jacobian * weight[:, np.newaxis]).T @ jacobian)


def _is_convex(observed: Array, expected: Array) -> bool:
    """Whether an observed curvature is positive in every direction, compared with the expected."""
    scale = np.sqrt(np.maximum(np.diag(expected), 1e-300))
    return len(scale) > 0 and bool(np.linalg.eigvalsh(observed / np.outer(scale, scale))[0] > 1e-6)
