"""Optimisers of scipy, loaded when the first of them is needed.

All of them cost 0.15 s and 15 MB. In a process of ours (`allanscope.lazy.defer_unused`) each is
loaded from its module, without those that are not wanted: 0.05 s and 6 MB, and next to nothing for
least squares without negative numbers, which every result needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Minimum",
    "descend",
    "least_nonnegative",
    "minimise",
    "minimise_between",
    "root_between",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Minimum:
    """Where a function is least, what it is there, and whether the search came to its end.

    With the corners of the last simplex, shape (k + 1, k), and the number of its turns.
    """

    x: Array
    value: float
    converged: bool
    corners: Array
    turns: int


def minimise(
    loss: Callable[[Array], float],
    first: Array,
    steps: Array | None = None,
    *,
    x_within: float = 1e-4,
    within: float = 1e-4,
    turns: int | None = None,
    until: Callable[[Array], bool] | None = None,
    after: Minimum | None = None,
) -> Minimum:
    """Find a minimum without derivatives (Nelder and Mead, Computer Journal 7, 1965).

    Parameters
    ----------
    loss : callable
        Of an array, shape (k,).
    first : ndarray, shape (k,)
        Where to begin.
    steps : ndarray, shape (k, k), optional
        From there to the other corners of the first simplex; a twentieth of each number by default.
    x_within, within : float
        Distance of the corners, and difference of the losses there, at which it ends.
    turns : int, optional
        Most of them; 200 k by default.
    until : callable, optional
        Of the best corner, after each turn: where it is true no one needs the minimum any more.
    after : Minimum, optional
        Of the same search to fewer digits, which is continued: its end is that of one search.

    Examples
    --------
    >>> bowl = lambda p: (p[0] - 1) ** 2 + (p[1] + 2) ** 2
    >>> found = minimise(bowl, np.zeros(2), np.eye(2))
    >>> found.x.round(3).tolist(), found.converged
    ([1.0, -2.0], True)
    >>> rough = minimise(bowl, np.zeros(2), np.eye(2), x_within=0.1, within=0.1)
    >>> bool(np.all(minimise(bowl, np.zeros(2), np.eye(2), after=rough).x == found.x))
    True
    """
    minimize = _of_scipy("minimize", "_minimize")
    if steps is None:
        steps = np.diag(np.where(first != 0, 0.05 * first, 0.00025))

    def ended(xk: Array) -> None:
        if until is not None and until(xk):
            raise StopIteration

    done = after.turns if after else 0
    with np.errstate(invalid="ignore"):  # a loss may be infinite beyond a bound
        found = minimize(
            loss, first, method="Nelder-Mead", callback=ended if until else None,
            options={
                "xatol": x_within, "fatol": within, "maxiter": (turns or 200 * len(first)) - done,
                "initial_simplex": after.corners if after else np.vstack([first, first + steps]),
            },
        )  # fmt: skip
    corners, turns = np.asarray(found.final_simplex[0]), done + int(found.nit) - 1
    return Minimum(np.asarray(found.x), float(found.fun), bool(found.success), corners, turns)


def descend(loss: Callable[[Array], float], first: Array, *, step: float, within: float) -> Array:
    """Return the minimum downhill from a point (Byrd et al., SIAM J. Sci. Comput. 16, 1995).

    Parameters
    ----------
    loss : callable
        Of an array, shape (k,).
    first : ndarray, shape (k,)
        Where to begin.
    step : float
        Over which slopes are taken.
    within : float
        Change of the loss, as a share of it, at which it ends.

    Examples
    --------
    >>> valley = lambda p: 1 + (p[0] - 1) ** 2 + 3 * (p[1] + 2) ** 2
    >>> descend(valley, np.zeros(2), step=1e-5, within=1e-9).round(3).tolist()
    [1.0, -2.0]
    """
    minimize = _of_scipy("minimize", "_minimize")
    options = {"eps": step, "ftol": within}
    return np.asarray(minimize(loss, first, method="L-BFGS-B", options=options).x)


def minimise_between(
    loss: Callable[[float], float], low: float, high: float, within: float = 1e-5
) -> tuple[float, float]:
    """Find the minimum of a function of one number between two bounds, and what it is there.

    `within` is the error of the number that is allowed.

    Examples
    --------
    >>> round(minimise_between(lambda x: (x - 0.3) ** 2, 0.0, 1.0)[0], 6)
    0.3
    """
    minimize_scalar = _of_scipy("minimize_scalar", "_minimize")
    found = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": within})
    return float(found.x), float(found.fun)


def root_between(
    function: Callable[[float], float], low: float, high: float, within: float = 2e-12
) -> float:
    """Find where a function is zero whose signs differ at two bounds, to `within`.

    Examples
    --------
    >>> round(root_between(lambda x: x * x - 2.0, 0.0, 2.0), 12)
    1.414213562373
    """
    brentq = _of_scipy("brentq", "_zeros_py")
    return float(brentq(function, low, high, xtol=within))


def least_nonnegative(design: Array, wanted: Array) -> Array:
    """Return the numbers, none of them negative, with the least sum of squared differences.

    `design` has shape (n, p), `wanted` (n,).

    Examples
    --------
    >>> design = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    >>> least_nonnegative(design, np.array([2.0, 1.0, -1.0])).round(12)
    array([1.5, 0. ])
    """
    nnls = _of_scipy("nnls", "_nnls")
    return np.asarray(nnls(design, wanted)[0])


@cache
def _of_scipy(name: str, module: str) -> Callable[..., Any]:
    """Return an optimiser from its own module."""
    found: Callable[..., Any]
    try:
        found = getattr(import_module(f"scipy.optimize.{module}"), name)
    except (ImportError, AttributeError):  # it is the package that is promised
        found = getattr(import_module("scipy.optimize"), name)
    return found
