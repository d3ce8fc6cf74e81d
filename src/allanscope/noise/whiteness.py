"""The whitened spectrum: measured power over expected power, band by band.

Where a model is right the ratio in every band is chi-square over its degrees of freedom, 1 on
average. Each is turned into a standard normal z by the cube root of Wilson and Hilferty
(PNAS 17, 1931), so that bands with few degrees of freedom can be judged beside those with many.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from allanscope.noise.evidence import Evidence

__all__ = ["Bands", "whitened"]

Array = NDArray[np.float64]

_PER_DECADE = 10
"""Bands a decade."""
_FEWEST = 6.0
"""Degrees of freedom that a band must have."""


@dataclass(frozen=True)
class Bands:
    """Measured over expected power in bands.

    Attributes
    ----------
    frequency : ndarray, shape (b,)
        Centre in Hz (mean logarithm), ascending.
    ratio : ndarray, shape (b,)
        Measured power over expected power.
    dof : ndarray, shape (b,)
        Degrees of freedom.
    z : ndarray, shape (b,)
        Standard normal where the model is right.
    """

    frequency: Array
    ratio: Array
    dof: Array
    z: Array

    @property
    def worst(self) -> float:
        """The z farthest from zero, with its sign."""
        return float(self.z[np.argmax(np.abs(self.z))])

    @property
    def chi2(self) -> float:
        """Sum of z^2."""
        return float(np.sum(self.z**2))

    def p_value(self, fitted: int = 0) -> float:
        """Probability of as large a chi2 by chance, after fitting so many numbers."""
        return float(chdtrc(max(1, len(self.z) - fitted), self.chi2))


def whitened(evidence: tuple[Evidence, ...], expected: Array) -> Bands:
    """Average measured over expected power in a tenth of a decade each, or wider.

    Parameters
    ----------
    evidence : tuple of Evidence
        What was fitted.
    expected : ndarray
        Expected powers of all of it, e.g. `Fit.expected`.
    """
    power = np.concatenate([part.power for part in evidence])
    dof = np.concatenate([part.dof for part in evidence])
    log_f = np.log10(np.concatenate([part.frequency for part in evidence]))
    order = np.argsort(log_f, kind="stable")
    ratio, dof, log_f = (power / expected)[order], dof[order], log_f[order]
    starts = _starts(log_f, dof)
    total = np.add.reduceat(dof, starts)
    mean = np.add.reduceat(dof * ratio, starts) / total
    centre = np.add.reduceat(dof * log_f, starts) / total
    spread = 2 / (9 * total)
    z = (np.cbrt(mean) - (1 - spread)) / np.sqrt(spread)
    return Bands(10**centre, mean, total, z)


def _starts(log_f: Array, dof: Array) -> NDArray[np.int64]:
    """Return where bands begin: each a tenth of a decade wide, or until it has enough."""
    starts, have, since = [0], 0.0, log_f[0]
    for i, (at, more) in enumerate(zip(log_f.tolist(), dof.tolist(), strict=True)):
        if have >= _FEWEST and at - since >= 1 / _PER_DECADE:
            starts.append(i)
            have, since = 0.0, at
        have += more
    if have < _FEWEST and len(starts) > 1:
        starts.pop()
    return np.array(starts)
