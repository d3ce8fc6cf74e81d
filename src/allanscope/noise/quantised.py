"""Records that the step of the numbers limits, not the sensor.

Stock firmware truncates accelerations to 1 mg, and a gyro at 2000 dps has steps of 70 mdps, more
than its noise. Such a record shows a few codes or a constant, and its Allan curve can be anything
from 25 times the truth to zero, depending on where the mean lies between two codes. While the noise
before rounding is at least half a step, rounding only adds step^2 / 12 to the variance; below, the
error itself depends on the noise (Widrow and Kollar, Quantization Noise, 2008, chapter 4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["LIMIT", "Lattice", "advice", "find_step", "lattice_of", "on_lattice"]

Array = NDArray[np.float64]

LIMIT = 0.5
"""Noise before rounding, in steps, from which rounding only adds step^2 / 12."""
_OFF = 0.01
"""Distance from a lattice, in steps, that numbers printed with few digits may have."""
_LOOKED_AT = 1 << 16


@dataclass(frozen=True, slots=True)
class Lattice:
    """How coarse a record is.

    Attributes
    ----------
    step : float
        Distance of neighbouring codes in the unit of the values; 0 where all are the same.
    sigma : float
        Standard deviation before rounding, from the differences of neighbours, in the same unit.
    codes : int
        Codes that occur.
    limited : bool
        True when sigma is below half a step: what is measured is the step and not the sensor.
    advice : str
        One sentence for the user; empty when not limited.
    """

    step: float
    sigma: float
    codes: int
    limited: bool
    advice: str

    @property
    def ratio(self) -> float:
        """Sigma in steps."""
        return self.sigma / self.step if self.step else 0.0


def lattice_of(
    values: ArrayLike, step: float | None = None, *, truncated: bool = False, unit: str = "dps"
) -> Lattice:
    """Judge how coarse a record is.

    Parameters
    ----------
    values : array_like, shape (n,)
        Samples, not means of several.
    step : float, optional
        Step of the values; found from them when not given.
    truncated : bool
        The sender rounds towards zero, which makes the code 0 twice as wide.
    unit : {'dps', 'g'}
        Of the values, for the advice.

    Raises
    ------
    ValueError
        If there are fewer than 3 values, or values that are not finite.

    Examples
    --------
    >>> toggling = 0.07 * np.tile([3, 3, 4, 3], 50)
    >>> lattice = lattice_of(toggling)
    >>> round(lattice.step, 6), lattice.codes, lattice.limited
    (0.07, 2, True)
    """
    samples = np.asarray(values, np.float64).ravel()
    if len(samples) < 3 or not np.all(np.isfinite(samples)):
        raise ValueError("need at least 3 finite values")
    step = find_step(samples) if step is None else step
    if step == 0.0 or np.ptp(samples) == 0.0:
        return Lattice(step or 0.0, 0.0, 1, True, advice(unit, truncated=truncated, constant=True))
    codes = len(np.unique(np.round(samples / step)))
    variance = float(np.mean(np.diff(samples) ** 2)) / 2
    sigma = float(np.sqrt(max(variance - step**2 / 12, 0.0)))
    limited = sigma < LIMIT * step
    words = advice(unit, truncated=truncated) if limited else ""
    return Lattice(step, sigma, codes, limited, words)


def on_lattice(values: ArrayLike, step: float) -> bool:
    """Return whether all values are multiples of a step (or sums of such).

    >>> on_lattice([0.07, 0.14, -0.21], 0.07), on_lattice([0.07, 0.15], 0.07)
    (True, False)
    """
    if not step > 0:
        return False
    samples = _some(np.asarray(values, np.float64).ravel())
    in_steps = samples / step
    tolerance = np.maximum(_OFF, 1e-9 * np.abs(in_steps))
    return bool(np.all(np.abs(in_steps - np.round(in_steps)) <= tolerance))


def find_step(values: ArrayLike) -> float:
    """Return the step of a lattice that the values lie on; 0 where there is none, or one value.

    The smallest distance of two distinct values is the step, or a multiple of it, if all distances
    are multiples of a common one.

    >>> round(find_step([0.0, 0.14, 0.21, -0.07]), 9)
    0.07
    """
    distinct = np.unique(_some(np.asarray(values, np.float64).ravel()))
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * float(np.max(np.abs(distinct), initial=0.0))]
    if len(gaps) == 0:
        return 0.0
    smallest = float(gaps.min())
    for divisor in (1, 2, 3):
        step = smallest / divisor
        if on_lattice(distinct - distinct[0], step):
            multiples = np.round((distinct - distinct[0]) / step)
            exact = float(np.dot(multiples, distinct - distinct[0]) / np.dot(multiples, multiples))
            # Values without a lattice have gaps far smaller than their scatter.
            return exact if np.ptp(multiples) < 1e6 else 0.0
    return 0.0


def _some(values: Array) -> Array:
    """Return evenly chosen blocks of a long record."""
    if len(values) <= _LOOKED_AT:
        return values
    blocks = np.array_split(values, 16)
    return np.concatenate([block[: _LOOKED_AT // 16] for block in blocks])


def advice(unit: str, *, truncated: bool = False, constant: bool = False) -> str:
    """Return what to do about a step that is too coarse, in one sentence."""
    what = "the axis is constant" if constant else "the noise is below half a step of the numbers"
    if truncated:
        return f"{what}: use a firmware that sends raw counts instead of rounded values"
    smaller = "2 g" if unit == "g" else "125 or 250 dps"
    return f"{what}: choose a smaller full scale, such as {smaller}, to see the sensor's own noise"
