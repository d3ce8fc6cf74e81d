r"""Several filters, one behind the other.

Filters multiply. Samples that are held with probability d after a filter do not: of a process with
the spectrum S and the variance :math:`\gamma` they are

.. math:: P S + (\gamma - \gamma_P) L, \quad
          P = \frac{(1 - d)^2}{1 - 2 d \cos\omega + d^2}, \quad L = \frac{1 + d}{1 - d} P

with :math:`\gamma_P` the variance of :math:`P S`: what is held makes white noise of its own, which
no filter before it can take away. Of white noise alone that is L, the response of `HeldSamples`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.filters.base import Filter
from allanscope.noise.filters.held_samples import HeldSamples

__all__ = ["combined_response", "made_white_share"]

Array = NDArray[np.float64]

_POINTS = 2048
"""Frequencies over which a response is averaged."""


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
