r"""Samples that repeat the one before: what holding does to white noise.

White noise held with probability d has :math:`(1 - d^2) / (1 - 2 d \cos 2\pi f dt + d^2)` times its
density. Where repeats come in a pattern (a reader at twice the rate of the sensor) the chance
:math:`r_j` that j rows in a row are repeats is not d^j, and the factor is
:math:`1 + 2 \sum_j r_j \cos 2\pi j f dt`.

Filters multiply. Samples that are held with probability d after a filter do not: of a process with
the spectrum S and the variance :math:`\gamma` they are

.. math:: P S + (\gamma - \gamma_P) L, \quad
          P = \frac{(1 - d)^2}{1 - 2 d \cos\omega + d^2}, \quad L = \frac{1 + d}{1 - d} P

with :math:`\gamma_P` the variance of :math:`P S`: what is held makes white noise of its own, which
no filter before it can take away. Of white noise alone that is L, the response of `HeldSamples`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components.white import White
from allanscope.noise.part import Component, Filter, Quantity

__all__ = ["HeldPattern", "HeldSamples", "combined_response", "made_white_share"]

Array = NDArray[np.float64]

_DARKEST = 1e-5
"""Least factor: samples held in pairs have no power at Nyquist but what leaks there."""
_POINTS = 2048
"""Frequencies over which a response is averaged."""


@dataclass(frozen=True)
class HeldSamples(Filter):
    """Samples that are independent of each other held with the probability `fraction`."""

    fraction: float
    symbol: ClassVar[str] = "repeated_samples"
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("fraction", "", "shape", 0.0, 0.99),)

    def response(self, f: Array, dt: float) -> Array:
        """Return (1 - d^2) / (1 - 2 d cos(2 pi f dt) + d^2)."""
        d = self.fraction
        sine = np.sin(np.pi * f * dt)
        return np.asarray((1 - d * d) / ((1 - d) ** 2 + 4 * d * sine**2))

    def acts_on(self, component: Component) -> bool:
        """Return whether it is white: what is slower hardly changes while it is held."""
        return isinstance(component, White)


@dataclass(frozen=True)
class HeldPattern(Filter):
    """Samples that are held in a pattern.

    Parameters
    ----------
    chances : tuple of float
        Chance that 1, 2, ... samples in a row are repeats.
    """

    chances: tuple[float, ...]
    symbol: ClassVar[str] = "repeated_samples"

    @property
    def fraction(self) -> float:
        """Share of the samples that are repeats."""
        return self.chances[0]

    def response(self, f: Array, dt: float) -> Array:
        """Return 1 + 2 sum_j r_j cos(2 pi j f dt)."""
        total = np.ones_like(f)
        for j, chance in enumerate(self.chances, start=1):
            total += 2 * chance * np.cos(2 * np.pi * j * dt * f)
        return np.asarray(np.maximum(total, _DARKEST))

    def acts_on(self, component: Component) -> bool:
        """Return whether it is white."""
        return isinstance(component, White)


def combined_response(
    filters: Sequence[Filter], dt: float, at: Callable[[Filter], Array]
) -> Array | np.float64:
    """Return the power response of filters to noise that is white before them.

    Parameters
    ----------
    filters : sequence of Filter
        In any order: holding comes last.
    dt : float
        Time between samples in s.
    at : callable
        Response of one filter at the frequencies in question.
    """
    passed, made = _passed_and_made_white(filters, dt, at)
    return passed + made


def made_white_share(
    filters: Sequence[Filter], dt: float, at: Callable[[Filter], Array]
) -> Array | np.float64:
    """Return the share of that response which is white noise made by holding: it comes in bursts.

    Parameters
    ----------
    filters, dt, at
        As for `combined_response`.
    """
    if not any(isinstance(one, HeldSamples) for one in filters):
        return np.float64(0.0)
    passed, made = _passed_and_made_white(filters, dt, at)
    return made / (passed + made)


def _passed_and_made_white(
    filters: Sequence[Filter], dt: float, at: Callable[[Filter], Array]
) -> tuple[Array | np.float64, Array | np.float64]:
    passed: Array | np.float64 = np.float64(1.0)
    made: Array | np.float64 = np.float64(0.0)
    for one in filters:
        if not isinstance(one, HeldSamples):
            passed = passed * at(one)
    for held in filters:
        if isinstance(held, HeldSamples):
            before = tuple(f for f in filters if f is not held)
            share = (1 - held.fraction) / (1 + held.fraction)
            passed, made = passed * share * at(held), _made_white(before, held, dt) * at(held)
    return passed, made


@lru_cache(maxsize=256)
def _made_white(before: tuple[Filter, ...], held: HeldSamples, dt: float) -> float:
    """Variance that holding takes from filtered white noise, and makes white again."""
    f = (np.arange(_POINTS, dtype=np.float64) + 0.5) / (2 * _POINTS * dt)
    share = (1 - held.fraction) / (1 + held.fraction)
    power = np.asarray(1 - share * held.response(f, dt))
    for one in before:
        power *= one.response(f, dt)
    return float(power.mean())
