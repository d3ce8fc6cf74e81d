"""The Cramer-Rao bound: how well a model's numbers can be known from a run of a given length.

The information about logarithms of numbers in n samples is 1/2 sum_k (d ln lambda_k / d ln theta)^2
over the DCT ordinates. N is known to 1 / sqrt(2 n); B and K depend on the length of the run alone.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components import Component
from allanscope.noise.ordinates import Ordinates, bin_edges
from allanscope.noise.scoring import Free
from allanscope.noise.whittle import Likelihood

__all__ = ["relative_bounds", "wait_until"]

Array = NDArray[np.float64]

_LONGEST_FACTOR = 4096.0


def relative_bounds(model: Iterable[Component], dt: float, duration: float) -> dict[str, float]:
    """Return the least relative standard deviation of every number of a model.

    Parameters
    ----------
    model : iterable of Component
        With the true numbers.
    dt : float
        Time between samples in s.
    duration : float
        Length of the run in s.

    Returns
    -------
    dict
        Name of each number (``N``, ``B``, ...) to its bound; infinite for a number at zero.

    Examples
    --------
    >>> from allanscope.noise.components import Flicker, RandomWalk, White
    >>> model = [White(4e-3), Flicker(1.255e-3), RandomWalk(1e-4)]
    >>> bounds = relative_bounds(model, 1 / 104, 3600.0)
    >>> {name: f"{100 * bound:.2g} %" for name, bound in bounds.items()}
    {'N': '0.12 %', 'B': '8.2 %', 'K': '33 %'}
    """
    components = tuple(model)
    n = max(32, round(duration / dt))
    edges = bin_edges(n - 1)
    bare = Ordinates(
        raw=np.broadcast_to(0.0, (1, n - 1)),
        dt=dt,
        stride=1,
        first=edges[:-1],
        last=edges[1:] - 1,
        power=np.ones(len(edges) - 1),
    )
    likelihood = Likelihood([bare])
    free = [Free(i, j) for i, c in enumerate(components) for j in range(len(c.quantities))]
    expected, jacobian = likelihood.derivatives(components, free)
    quantities = [components[f.component].quantities[f.quantity] for f in free]
    values = np.array([components[f.component].values[f.quantity] for f in free])
    shape = np.array([quantity.role == "shape" for quantity in quantities])
    by_log = np.where(shape, 1.0, 2 * values**2)
    weighted = jacobian * by_log * (np.sqrt(likelihood.dof / 2) / expected)[:, np.newaxis]
    seen = np.any(weighted != 0, axis=0)
    bounds = np.full(len(free), np.inf)
    block = weighted[:, seen].T @ weighted[:, seen]
    bounds[seen] = np.sqrt(np.diag(np.linalg.pinv(block, hermitian=True)))
    return {q.name: float(b) for q, b in zip(quantities, bounds, strict=True)}


def wait_until(
    model: Iterable[Component], dt: float, duration: float, name: str, known: float = 0.2
) -> float | None:
    """Return how much longer to run until a number is known to a relative standard deviation.

    Parameters
    ----------
    duration : float
        Length of the run so far in s.
    name : str
        Of the number.
    known : float
        Relative standard deviation to reach.

    Returns
    -------
    float or None
        In s; 0 when it is known now, None when 4096 times the run would not do.
    """
    components = tuple(model)

    def bound(length: float) -> float:
        return relative_bounds(components, dt, length).get(name, np.inf)

    low, high = duration, duration
    while bound(high) > known:
        low, high = high, 2 * high
        if high > _LONGEST_FACTOR * duration:
            return None
    for _ in range(5):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if bound(middle) > known else (low, middle)
    return max(0.0, high - duration) if high > duration else 0.0
