"""The result of the streaming spectrum: a power spectral density with its reliability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Density"]


@dataclass(frozen=True, slots=True)
class Density:
    """One-sided power spectral density of one axis on log-spaced frequencies.

    Attributes
    ----------
    frequency : ndarray, shape (k,)
        Centre of each band in Hz, ascending.
    width : ndarray, shape (k,)
        Width of each band in Hz.
    density : ndarray, shape (k,)
        Mean one-sided density in the band, unit^2 / Hz.
    averages : ndarray, shape (k,)
        Effective number of independent periodogram ordinates in it: the density is distributed as
        its expectation times chi-square(2 averages) / (2 averages).
    """

    frequency: NDArray[np.float64]
    width: NDArray[np.float64]
    density: NDArray[np.float64]
    averages: NDArray[np.float64]
