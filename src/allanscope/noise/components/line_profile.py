r"""A line that drifts: power in a band, distributed over it as it was measured.

A tone whose amplitude, phase or frequency changes in time has no line shape that could be written
down: a chirp has a flat one, a tone that is switched on and off a comb. But the variance that it
brings into a mean over m samples depends on its spectrum alone,

.. math:: \sigma_m^2 = \sigma^2 \sum_i w_i \langle R_m(f) \rangle_i ,

with the share :math:`w_i` of the power in each sub-band and the mean of the estimator's response
there. So the shares are taken from the record, and so is the
size: a fit would make it larger or smaller to please the noise around the line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.part import Array, Component
from allanscope.noise.transfer import Kind, response

__all__ = ["LineProfile"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Of Gauss and Legendre, exact to the fifteenth degree."""
_AVERAGED = 1.0
"""Periods of a response within a sub-band from which its mean is used."""


@dataclass(frozen=True)
class LineProfile(Component):
    """Power between two frequencies, with the share of it in each of some equal sub-bands.

    Parameters
    ----------
    sigma : float
        Standard deviation (for a tone: rms amplitude) in the unit of the axis.
    low, high : float
        Ends of the band in Hz.
    shares : tuple of float
        Share of the power in each sub-band; they add up to 1.

    Examples
    --------
    >>> line = LineProfile(2.0, 4.0, 5.0, (0.25, 0.75))
    >>> line.density([3.9, 4.2, 4.7], dt=0.01).tolist()
    [0.0, 2.0, 6.0]
    """

    sigma: float
    low: float
    high: float
    shares: tuple[float, ...]

    symbol: ClassVar[str] = "drifting_line"
    is_line = True

    def __post_init__(self) -> None:
        has_shares = bool(self.shares) and min(self.shares) >= 0
        if not (self.sigma >= 0 and 0 <= self.low < self.high and has_shares):
            raise ValueError(
                "a line profile needs a size, a band of positive width and shares, none negative, "
                f"got {self.low:g} to {self.high:g} Hz with {len(self.shares)} shares"
            )

    @property
    def edges(self) -> Array:
        """Ends of the sub-bands in Hz."""
        return np.linspace(self.low, self.high, len(self.shares) + 1)

    @property
    def band(self) -> tuple[float, float]:
        """Centre and width."""
        return (self.low + self.high) / 2, self.high - self.low

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the ends of the sub-bands."""
        del dt
        return tuple(self.edges.tolist())

    def with_more(self, density: Array) -> LineProfile:
        """Return the line with more density in each sub-band, or less, but never below none."""
        width = (self.high - self.low) / len(self.shares)
        power = np.maximum(self.sigma**2 * np.array(self.shares) + density * width, 0.0)
        total = float(power.sum())
        if total == 0.0:
            return self
        return replace(self, sigma=math.sqrt(total), shares=tuple((power / total).tolist()))

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return the one-sided density, which is constant in each sub-band."""
        del dt
        frequency = np.asarray(f, np.float64)
        width = (self.high - self.low) / len(self.shares)
        index = np.clip((frequency - self.low) / width, 0, len(self.shares) - 1).astype(int)
        inside = (frequency >= self.low) & (frequency < self.high)
        share = np.where(inside, np.array(self.shares)[index], 0.0)
        return np.asarray(share * self.sigma**2 / width)

    def band_density(self, f: ArrayLike, width: ArrayLike, dt: float) -> Array:
        """Return the mean over each band, of which it may fill a part."""
        del dt
        centre, wide = np.asarray(f, np.float64), np.asarray(width, np.float64)
        total = np.concatenate([[0.0], np.cumsum(self.shares)])
        upper, lower = (np.interp(centre + side * wide / 2, self.edges, total) for side in (1, -1))
        return np.asarray(self.sigma**2 * (upper - lower) / wide)

    def _variance(self, kind: Kind, m: ArrayLike, dt: float) -> Array:
        factors = np.atleast_1d(np.asarray(m, np.float64))
        edges = 2 * np.pi * dt * self.edges
        middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
        phase = np.maximum(middle[:, np.newaxis] + half[:, np.newaxis] * _NODES, 1e-12)
        values = []
        for factor in factors:
            is_fast = factor * float(half[0]) > _AVERAGED * np.pi
            passed = response(kind, phase, float(factor), mean=is_fast) @ _WEIGHTS / 2
            values.append(self.sigma**2 * float(np.dot(self.shares, passed)))
        return np.array(values).reshape(np.shape(m))
