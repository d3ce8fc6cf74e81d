"""When did a series change, and how: a step or a ramp, by least squares over every moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Change", "is_one_ramp", "locate"]

INTERVAL_NATS = 2.5
"""Log-likelihood below the best within which the moment of a change may be: 95 % and a little more,
because block values have memory."""
RAMP_NATS = 4.0
"""By how much a ramp must be better than a step: a step is the rule."""

MIXED_SIGMAS = 5.0
"""Standard deviations from its level from which on a value next to a step is a mixture of both."""

SHORTEST_RAMP = 8
"""Blocks: a step within a block looks like a ramp at first."""


@dataclass(frozen=True, slots=True)
class Change:
    """A change within a stretch of values.

    Attributes
    ----------
    kind : {'step', 'ramp'}
        Whether the level is another one from a moment on, or moves.
    at, lower, upper : int
        First value after it, and the interval of that.
    before : float
        Level before it.
    size : float
        Level at the end less that before.
    """

    kind: Literal["step", "ramp"]
    at: int
    lower: int
    upper: int
    before: float
    size: float


def locate(values: NDArray[np.float64], earliest: int, spread: float) -> Change:
    """Return the change that fits a stretch best.

    Parameters
    ----------
    values : ndarray of float64, shape (n,)
        The stretch, n >= 3.
    earliest : int
        First place where it may be.
    spread : float
        Least standard deviation of a value about a level.

    Examples
    --------
    >>> values = np.repeat([0.0, 1.0], [40, 6]) + 0.1 * np.sin(7.0 * np.arange(46) ** 2)
    >>> change = locate(values, earliest=20, spread=0.1)
    >>> change.kind, change.at, round(change.size, 1)
    ('step', 40, 1.0)
    """
    steps, ramps = _gains(values)
    earliest = min(max(earliest, 1), len(values) - 1)
    total = float(np.sum((values - values.mean()) ** 2))
    best = earliest + int(np.argmax(steps[earliest:]))
    best_ramp = earliest + int(np.argmax(ramps[earliest:-1])) if len(values) > earliest + 1 else 0
    left = total - max(steps[best], ramps[best_ramp] if best_ramp else 0.0)
    variance = max(left / len(values), spread**2, 1e-300)
    is_long = best_ramp > 0 and len(values) - best_ramp >= SHORTEST_RAMP
    is_ramp = is_long and (ramps[best_ramp] - steps[best]) / (2 * variance) > RAMP_NATS
    gains, at = (ramps, best_ramp) if is_ramp else (steps, best)
    inside = np.flatnonzero(gains[at] - gains < 2 * variance * INTERVAL_NATS)
    inside = inside[inside >= earliest]
    before = _level(values[:at][::-1], spread)
    if is_ramp:
        slope = _slope(values, at)
        size = slope * (len(values) - 1 - at)
    else:
        size = _level(values[at:], spread) - before
    return Change("ramp" if is_ramp else "step", at, int(inside[0]), int(inside[-1]), before, size)


def is_one_ramp(values: NDArray[np.float64], first: int, second: int) -> bool:
    """Return whether two changes of a stretch are one ramp rather than two steps."""
    _, ramps = _gains(values)
    total = float(np.sum((values - values.mean()) ** 2))
    levels = (values[:first], values[first:second], values[second:])
    two_steps = sum(float(np.sum((one - one.mean()) ** 2)) for one in levels if len(one))
    room = max(first // 2, 1)
    return total - float(ramps[room:-1].max(initial=0.0)) < two_steps


def _gains(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by how much a step and a bend at each place reduce the sum of squares."""
    n = len(values)
    v = values - values.mean()
    place = np.arange(n, dtype=np.float64)
    after = n - place
    tail = np.cumsum(v[::-1])[::-1]
    moment = np.cumsum((v * place)[::-1])[::-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.where(place > 0, tail**2 * n / (after * place), 0.0)
        # the regressor max(0, i - place)
        total = after * (after - 1) / 2
        squares = (after - 1) * after * (2 * after - 1) / 6 - total**2 / n
        product = moment - place * tail
        ramps = np.where(squares > 0.0, product**2 / squares, 0.0)
    ramps[0] = 0.0
    return steps, ramps


def _level(values: NDArray[np.float64], spread: float) -> float:
    """Return the mean; without the first value, next to a step, where it lies between two levels.

    Examples
    --------
    >>> _level(np.array([5.0, 9.0, 9.0]), spread=0.1)
    9.0
    """
    rest = values[1:]
    is_mixed = len(rest) > 0 and abs(values[0] - rest.mean()) > MIXED_SIGMAS * spread
    return float((rest if is_mixed else values).mean())


def _slope(values: NDArray[np.float64], at: int) -> float:
    bend = np.maximum(np.arange(len(values)) - at, 0.0)
    bend -= bend.mean()
    return float(bend @ values / (bend @ bend))
