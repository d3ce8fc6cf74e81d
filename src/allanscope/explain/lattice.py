"""The values that occur: their step, and how a Gaussian falls onto them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import ndtr

from allanscope.noise import find_step

__all__ = ["noise_on_lattice", "step_of"]

Array = NDArray[np.float64]

_WINDOWS = 48
_OFF = 5e-3
"""Distance from a whole count, in counts, that single precision may leave."""


def step_of(samples: Array, lsb: float) -> float:
    """Return the greatest step of which all differences are multiples, 0 where there is none.

    A sender that rounds to whole mg after scaling leaves a coarser step than the sensor's. Samples
    that are no multiples of the LSB (physical units come with an LSB of 1 for want of a better)
    are asked for a step of their own: numbers printed in dps still lie on the sensor's lattice.

    Examples
    --------
    >>> step_of(np.array([1.0, 1.5, 3.0, 0.5]), lsb=0.25)
    0.5
    """
    if lsb <= 0 or len(samples) < 2:
        return 0.0
    counts = (samples - samples[0]) / lsb
    whole = np.round(counts)
    if np.max(np.abs(counts - whole)) > _OFF or (not whole.any() and counts.any()):
        return find_step(samples)
    codes = np.unique(whole).astype(np.int64)
    common = int(np.gcd.reduce(codes))
    if common > 1 or len(codes) < 2:
        return float(max(common, 1) * lsb)
    return _uneven_step(codes) * lsb


def _uneven_step(codes: NDArray[np.int64]) -> float:
    """Return the step in counts where a coarser rounding came before the converter's own.

    The codes that occur are then the multiples of some step that is no whole number of counts, each
    rounded: neighbours are alternately, say, 11 and 12 counts apart.
    """
    apart = np.diff(codes)
    smallest = int(apart.min())
    if smallest < 2:
        return 1.0
    index = np.concatenate([[0], np.cumsum(np.round(apart / (smallest + 0.5)))])
    slope, start = np.polyfit(index, codes.astype(np.float64), 1)
    even = np.max(np.abs(start + slope * index - codes)) <= 1.0
    return float(slope) if even else 1.0


def noise_on_lattice(samples: Array, step: float) -> float:
    """Return the median standard deviation, in steps, of the noise before it was rounded.

    In each of many short windows mean and deviation are found by maximum likelihood from how often
    each value occurs; a window that holds one value only counts as 0.1.
    """
    length = max(64, min(2000, len(samples) // _WINDOWS))
    starts = np.linspace(0, len(samples) - length, min(_WINDOWS, len(samples) // length)).astype(
        int
    )
    found = []
    for start in starts:
        codes = np.round((samples[start : start + length] - samples[start]) / step)
        values, seen = np.unique(codes, return_counts=True)
        counts = seen.astype(np.float64)
        if len(values) == 1:
            found.append(0.1)
            continue
        if codes.std() > 1.5:
            found.append(float(np.sqrt(max(codes.var() - 1 / 12, 0.01))))
            continue

        def loss(p: Array, values: Array = values, counts: Array = counts) -> float:
            sigma = np.exp(p[1])
            chance = ndtr((values + 0.5 - p[0]) / sigma) - ndtr((values - 0.5 - p[0]) / sigma)
            return float(-np.sum(counts * np.log(np.maximum(chance, 1e-12))))

        first = [codes.mean(), np.log(max(np.sqrt(max(codes.var() - 1 / 12, 0.0)), 0.15))]
        found.append(float(np.exp(minimize(loss, first, method="Nelder-Mead").x[1])))
    return float(np.median(found))
