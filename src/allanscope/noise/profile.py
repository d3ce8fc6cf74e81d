"""Intervals from the profile of the likelihood.

The 95 % interval of a coefficient holds every value at which the likelihood, with everything else
fitted again, is at most half the 95 % quantile of chi-square below its maximum. It needs no
symmetry and holds at zero, where an interval of estimate +- 2 standard errors does not: there its
lower end is 0 and its upper end is the limit. A coefficient that few ordinates determine makes the
ratio a little larger than chi-square; a scaled chi-square variance with nu degrees of freedom does
by 1 + 1 / (3 nu) (Bartlett), nu = 1 / (2 relative_sd^2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from allanscope.noise.likelihood import Fit

__all__ = ["Interval", "profile_interval"]

_QUANTILE = 3.841458820694124
"""95 % quantile of chi-square with one degree of freedom."""
_LOOKS = 12
_CLOSE = 0.02


@dataclass(frozen=True, slots=True)
class Interval:
    """A 95 % interval, and how strongly zero is ruled out.

    Attributes
    ----------
    lower, upper : float
        Limits; `lower` is 0 where zero lies inside.
    against_zero : float
        Twice the nats lost at zero. Without the component it is 0 in half of all runs and
        chi-square with one degree of freedom in the other half.
    """

    lower: float
    upper: float
    against_zero: float


def profile_interval(fit: Fit, index: int) -> Interval:
    """Return the interval of one of `fit.free`."""
    free = fit.free[index]
    quantity = fit.model.quantity(free)
    is_shape = quantity.role == "shape"

    def lost(value: float) -> float:
        """Twice the nats lost with the number held at a value."""
        value = float(np.clip(value, quantity.lower, quantity.upper))
        model = fit.model.with_numbers([free], [value])
        held = fit.likelihood.maximise(model, held=fit.held | {free})
        return 2 * (fit.loglik - held.loglik)

    best, spread = float(fit.values[index]), float(fit.relative_sd()[index])
    known = np.isfinite(spread) and best > 0
    spread = min(spread, 1.0) if known else 1.0
    target = _QUANTILE * (1 + 2 / 3 * spread**2)
    against_zero = np.inf if is_shape else max(0.0, lost(0.0))
    scale = best if known else _visible(fit, index)
    upper = _crossing(lost, best, best + 2 * spread * scale, target)
    if against_zero <= target:
        return Interval(0.0, upper, against_zero)
    lower = _crossing(lost, best, best / (1 + 2 * spread), target, floor=0.0)
    return Interval(lower, upper, against_zero)


def _visible(fit: Fit, index: int) -> float:
    """Return the amplitude at which a component that was put to zero begins to be seen."""
    unit = fit.model.components[fit.free[index].part].with_power(1.0)
    relative = fit.likelihood.column(fit.model, unit) / fit.expected
    information = 0.5 * float(np.sum(fit.likelihood.dof * relative**2))
    return float(max(information, 1e-300) ** -0.25)


def _crossing(
    lost: Callable[[float], float], best: float, first: float, target: float, floor: float = -1.0
) -> float:
    """Find where the loss crosses the target on the side of `first`, by regula falsi.

    The square root of the loss is nearly linear in the value.
    """
    inside, at_inside = best, 0.0
    outside, at_outside = first, np.inf
    guess = first
    for _ in range(_LOOKS):
        value = float(np.sqrt(max(lost(guess), 0.0)))
        root = float(np.sqrt(target))
        if abs(value - root) < _CLOSE:
            return guess
        if value < root:
            inside, at_inside = guess, value
        else:
            outside, at_outside = guess, value
        if np.isinf(at_outside):
            reach = (guess - best) * min(4.0, root / max(value, 0.25 * root) + 0.1)
            guess = max(best + reach, floor) if reach < 0 else best + reach
            if guess <= floor:
                return max(floor, 0.0)
        else:
            share = (root - at_inside) / (at_outside - at_inside)
            guess = inside + float(np.clip(share, 0.05, 0.95)) * (outside - inside)
    return guess
