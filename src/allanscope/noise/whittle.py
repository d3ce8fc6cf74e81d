"""The likelihood of a noise model, and its maximum.

Powers p_b with nu_b degrees of freedom and expectation lambda_b(theta) have the log-likelihood

    log L = -1/2 sum_b nu_b (ln lambda_b + p_b / lambda_b)                                (Whittle)

up to what does not depend on the model. The Fisher information about theta is
1/2 sum nu_b (d ln lambda_b / d theta)^2, from which the Cramer-Rao bound follows, and Fisher
scoring (`scoring`) is a weighted least-squares step. Debiasing after Sykulski et al. (Biometrika
2019): lambda is the expectation of what was computed from the finite record, not the density.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components import Component
from allanscope.noise.ordinates import Evidence
from allanscope.noise.scoring import Free, Search, WhittleFit

__all__ = ["Free", "Likelihood", "WhittleFit", "fit", "loglik"]

Array = NDArray[np.float64]


def loglik(evidence: Sequence[Evidence], model: Iterable[Component]) -> float:
    """Return the log-likelihood of a model (a `NoiseModel`, or any components)."""
    return Likelihood(evidence).of(model)


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
    """
    return Likelihood(evidence).maximise(components, held=held)


class Likelihood:
    """The likelihood of one body of evidence, which remembers the shapes it has seen.

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
        # Floor of an expected power, so that a likelihood is finite for every model.
        self._tiny = max(1e-12 * float(np.median(self.power)), 1e-300)
        self._columns: dict[Component, Array] = {}

    def expected(self, model: Iterable[Component]) -> Array:
        """Return the expected powers under a model."""
        total = np.zeros(len(self.power))
        for component in model:
            unit, power = _unit(component)
            total += power * self.column(unit)
        return np.maximum(total, self._tiny)

    def of(self, model: Iterable[Component]) -> float:
        """Return the log-likelihood of a model."""
        return self.value(self.expected(model))

    def value(self, expected: Array) -> float:
        """Return the log-likelihood of expected powers."""
        return float(-0.5 * np.sum(self.dof * (np.log(expected) + self.power / expected)))

    def maximise(
        self, components: Iterable[Component], *, held: Collection[Free] = ()
    ) -> WhittleFit:
        """Return the maximum over all numbers that are not held; see `fit`."""
        return Search(self, tuple(components), frozenset(held)).run()

    def column(self, unit: Component) -> Array:
        """Return the expected powers of a component, computed once for each shape."""
        if unit not in self._columns:
            if len(self._columns) > 64:
                self._columns.clear()
            self._columns[unit] = np.concatenate([part.expected(unit) for part in self.evidence])
        return self._columns[unit]

    def derivatives(
        self, components: Sequence[Component], free: Sequence[Free]
    ) -> tuple[Array, Array]:
        """Return the expected powers and their derivatives.

        Returns
        -------
        expected : ndarray, shape (b,)
        jacobian : ndarray, shape (b, p)
            By the squares of amplitudes and the logarithms of shapes.
        """
        expected = np.zeros(len(self.power))
        jacobian = np.empty((len(self.power), len(free)))
        for i, component in enumerate(components):
            unit, power = _unit(component)
            column = self.column(unit)
            expected += power * column
            for j, number in enumerate(free):
                if number.component != i:
                    continue
                if component.quantities[number.quantity].role == "shape":
                    jacobian[:, j] = power * self._slope(unit, number.quantity)
                else:
                    jacobian[:, j] = column
        return np.maximum(expected, self._tiny), jacobian

    def _slope(self, unit: Component, quantity: int) -> Array:
        """Return the derivative of the column by the logarithm of a shape."""
        bound = unit.quantities[quantity]
        value, h = unit.values[quantity], 1e-3
        ends = min(value * np.exp(h), bound.upper), max(value * np.exp(-h), bound.lower)
        up, down = (self.column(_moved(unit, quantity, end)) for end in ends)
        return np.asarray((up - down) / np.log(ends[0] / ends[1]))


def _unit(component: Component) -> tuple[Component, float]:
    """Split a component into one of unit amplitude and its power."""
    for j, quantity in enumerate(component.quantities):
        if quantity.role == "amplitude":
            return _moved(component, j, 1.0), component.values[j] ** 2
    return component, 1.0


def _moved(component: Component, quantity: int, value: float) -> Component:
    values = list(component.values)
    values[quantity] = value
    return component.with_values(values)
