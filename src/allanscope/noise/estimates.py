"""From the maximum of a likelihood to coefficients: value, interval, detected, time to wait."""

from __future__ import annotations

import numpy as np

from allanscope.noise.bias import bias_reduced
from allanscope.noise.coefficients import Coefficient
from allanscope.noise.crlb import wait_until
from allanscope.noise.drift import Drift
from allanscope.noise.likelihood import Fit
from allanscope.noise.profile import profile_interval
from allanscope.noise.selection import quantization_score

__all__ = ["Estimates", "ramp_coefficient"]

_DETECTED = 9.55
"""Twice the nats against zero: 1 in 1000 of half a chi-square with one degree of freedom."""
_NORMAL = 0.03
"""Relative standard deviation below which the profile is as good as normal."""
_KNOWN = 0.2
"""Relative standard deviation at which a coefficient counts as known."""
_Z = 1.959963984540054
"""97.5 % quantile of the normal distribution."""


class Estimates:
    """The coefficients of one fit.

    Parameters
    ----------
    fit : Fit
        Maximum of the likelihood, without a ramp where one was found.
    dt, duration : float
        Time between samples and length of the run in s.
    unit : str
        Of the axis.
    """

    def __init__(self, fit: Fit, dt: float, duration: float, unit: str) -> None:
        self.fit = fit
        self.dt, self.duration, self.unit = dt, duration, unit
        self.spread = fit.all_free().relative_sd()[_positions(fit)]
        self.reduced = bias_reduced(fit)

    def coefficient(self, name: str) -> Coefficient:
        """Return a coefficient that was fitted."""
        index = self.fit.index(name)
        assert index is not None
        free = self.fit.free[index]
        quantity = self.fit.model.quantity(free)
        value = self.reduced.number(free)
        spread = float(self.spread[index])
        if spread < _NORMAL:
            lower, upper = value * np.exp(-_Z * spread), value * np.exp(_Z * spread)
            detected = True
        else:
            interval = profile_interval(self.fit, index)
            lower, upper = min(interval.lower, value), max(interval.upper, value)
            detected = interval.against_zero > _DETECTED
            if not detected:
                lower = 0.0
        # Half the interval over that of a coefficient that is just known.
        excess = (upper - lower) / (2 * _Z * _KNOWN * value) if value else np.inf
        known = detected and excess < 1
        return Coefficient(
            value=float(value),
            lower=float(lower),
            upper=float(upper),
            unit=quantity.unit.format(unit=self.unit),
            detected=detected,
            wait_s=None if known else self._wait(index, value, upper, detected, excess),
        )

    def quantization(self) -> Coefficient:
        """Return Q: fitted where it was selected, else the limit that its score sets."""
        if self.fit.index("Q") is not None:
            return self.coefficient("Q")
        score = quantization_score(self.fit)
        return Coefficient(score.value, 0.0, score.upper, f"{self.unit}*s", detected=False)

    def _wait(
        self, index: int, value: float, upper: float, detected: bool, excess: float
    ) -> float | None:
        """Return how much longer to run until a number can be expected to be known.

        What was not detected may be anything up to its limit: the geometric mean of estimate and
        limit predicts the time to a factor of two or three, by simulation, and too short a one
        where the limit is still far off. A run that should have been long enough is asked for as
        much more as the interval is too wide, at most for as long again.
        """
        free = self.fit.free[index]
        expected = value if detected else float(np.sqrt(value * upper))
        model = self.reduced.with_numbers([free], [expected])
        wait = wait_until(model, self.dt, self.duration, self.fit.names[index], _KNOWN)
        return self.duration * min(excess**2 - 1, 1.0) if wait == 0.0 else wait


def _positions(fit: Fit) -> list[int]:
    """Return where what was varied stands among all numbers of the model."""
    return [fit.model.numbers.index(free) for free in fit.free]


def ramp_coefficient(
    drift: Drift | None, detected: bool, duration: float, unit: str
) -> Coefficient:
    """Return R, a limit where it was not detected; none where it could not be looked for."""
    if drift is None:
        return Coefficient(0.0, 0.0, np.inf, f"{unit}/s", detected=False)
    value = abs(drift.slope)
    lower, upper = drift.interval
    relative = drift.half_width / _Z / value if value else np.inf
    # The slope is limited by the random walk: its error falls as 1 / sqrt(time).
    wait = duration * ((relative / _KNOWN) ** 2 - 1) if detected and relative > _KNOWN else None
    return Coefficient(value, lower if detected else 0.0, upper, f"{unit}/s", detected, wait)
