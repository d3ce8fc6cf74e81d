"""A model that is safe to propagate: white noise, Gauss-Markov and random walk above the curve.

A navigation filter needs a variance that is not too small at any time over which it integrates. The
second difference of the integrated signal over tau has the variance 2 tau^2 AVAR(tau), so a model
whose AVAR is above that of the sensor bounds it. Each measured AVAR is raised to what a record of
the same length may show next time, by the quantile of an F distribution with its degrees of
freedom; among all sums

    N^2 / tau  +  sigma^2 G(tau / Tc)  +  K^2 tau / 3

that lie nowhere below, the one with the least excess is found by linear programming, Tc on a grid.
A smooth model over a curve that scatters lies above most of it: the quantile that makes 95 % of
held-out variances stay below was found by simulation (`benchmarks/bound.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.special import fdtri

from allanscope.allan import Deviation

__all__ = ["Bound", "bound_model"]

Array = NDArray[np.float64]

SHORTEST_S, LONGEST_S = 1.0, 1000.0
"""Averaging times over which a bound is to hold."""
QUANTILE = 0.84
"""Of the ratio of two variances, at each averaging time by itself; see `benchmarks/bound.py`."""

_TIMES = 24
"""Correlation times tried for the Gauss-Markov part."""
_FEWEST_EDF = 5.0
"""Degrees of freedom from which a point of the curve is used."""


@dataclass(frozen=True, slots=True)
class Bound:
    """White noise, a first-order Gauss-Markov process and a random walk.

    Attributes
    ----------
    N, sigma, correlation_time_s, K : float
        In the unit of the axis, per root Hz, plain, s, and per root s. `sigma` is 0 and the time
        the shortest where no process is needed.
    shortest_s, longest_s : float
        Averaging times between which the bound was set.
    inflation : float
        Mean ratio of the bound's deviation to the measured one.
    """

    N: float
    sigma: float
    correlation_time_s: float
    K: float
    shortest_s: float
    longest_s: float
    inflation: float

    def variance(self, tau: ArrayLike) -> Array:
        """Return AVAR at averaging times in s; 2 tau^2 times it bounds the integrated signal's."""
        weights = np.array([self.N**2, self.sigma**2, self.K**2])
        return np.asarray(_columns(np.asarray(tau, np.float64), self.correlation_time_s) @ weights)


def bound_model(curve: Deviation, *, quantile: float = QUANTILE) -> Bound | None:
    """Return the least model above a curve at 1 to 1000 s.

    Parameters
    ----------
    curve : Deviation
        OADEV of one axis.
    quantile : float
        Of the variance of a further record over that of this one.

    Returns
    -------
    Bound or None
        None where fewer than three averaging times can be used.

    Examples
    --------
    >>> tau = 2.0 ** np.arange(8)
    >>> dev, edf = 0.01 / np.sqrt(tau), 1e6 / tau
    >>> curve = Deviation("oadev", tau, tau.astype(int), dev, dev, dev, edf, edf.astype(int),
    ...                   np.full(8, "WFM"), 0.95, tau > 0)
    >>> bound = bound_model(curve)
    >>> round(bound.N, 4), bound.inflation < 1.01
    (0.01, True)
    """
    use = (curve.tau >= SHORTEST_S) & (curve.tau <= LONGEST_S) & (curve.edf >= _FEWEST_EDF)
    use &= np.isfinite(curve.deviation) & (curve.deviation > 0.0)
    if use.sum() < 3:
        return None
    tau, measured, edf = curve.tau[use], curve.deviation[use] ** 2, curve.edf[use]
    floor = np.maximum(fdtri(edf, edf, quantile), 1.0)
    white = float(np.min(measured * tau))  # of that there is at least so much: no filter has none
    best: tuple[float, Array, float] | None = None
    for time in np.geomspace(tau[0] / 3, tau[-1], _TIMES):
        columns = _columns(tau, time) / measured[:, np.newaxis]
        scale = columns.max(axis=0)
        found = linprog(
            (columns / scale).mean(axis=0),
            A_ub=-columns / scale,
            b_ub=-floor,
            bounds=[(white * scale[0], None), (0.0, None), (0.0, None)],
        )
        if not found.success or found.fun is None:
            continue
        if best is None or found.fun < best[0]:
            best = found.fun, found.x / scale, float(time)
    if best is None:
        return None
    _, weights, time = best
    n, sigma, k = np.sqrt(weights).tolist()
    inflation = float(np.mean(np.sqrt(_columns(tau, time) @ weights / measured)))
    return Bound(n, sigma, time, k, float(tau[0]), float(tau[-1]), inflation)


def _columns(tau: Array, time: float) -> Array:
    """Return AVAR of unit white noise, Gauss-Markov process and random walk, shape (k, 3)."""
    u = tau / time
    # 1 - (3 - 4 exp(-u) + exp(-2 u)) / (2 u) cancels for small u: its series is u^2 / 3.
    bracket = 1.0 - (3.0 - 4.0 * np.exp(-u) + np.exp(-2.0 * u)) / (2.0 * u)
    markov = np.where(u < 1e-3, u / 3.0 * 2.0, 2.0 / u * bracket)
    return np.column_stack([1.0 / tau, markov, tau / 3.0])
