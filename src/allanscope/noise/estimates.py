"""From the maximum of a likelihood to coefficients: value, interval, detected, time to wait.

The value is that of the maximum without its first-order bias. With a coefficient known to 30 %, as
K is after an hour, the maximum of the likelihood is biased by -8 % and lies at exactly zero in one
run out of twenty-five. Firth (Biometrika 80, 1993) adds half the logarithm of the determinant of
the information about the amplitudes (Jeffreys' prior), which takes the first-order bias away and,
vanishing where an amplitude does, keeps the estimate off the boundary. On records that determine a
coefficient to a few per cent it changes nothing.

The interval is that of the profile of the likelihood. It holds every value at which the likelihood,
with everything else fitted again, is at most half the 95 % quantile of chi-square below its
maximum. It needs no symmetry and holds at zero, where an interval of estimate +- 2 standard errors
does not: there its lower end is 0 and its upper end is the limit. A coefficient that few ordinates
determine makes the ratio a little larger than chi-square; a scaled chi-square variance with nu
degrees of freedom does by 1 + 1 / (3 nu) (Bartlett), nu = 1 / (2 relative_sd^2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.coefficients import Coefficient
from allanscope.noise.crlb import wait_until
from allanscope.noise.drift import Drift
from allanscope.noise.filters import Remainder
from allanscope.noise.likelihood import Fit
from allanscope.noise.model import Free, NoiseModel
from allanscope.noise.selection import quantization_score
from allanscope.quantities import CHI_SQUARE_95, TWO_SIDED_95

__all__ = ["Estimates", "bias_reduced", "profile_interval", "ramp_coefficient"]

Array = NDArray[np.float64]

_DETECTED = 9.55
"""Twice the nats against zero: 1 in 1000 of half a chi-square with one degree of freedom."""
_NORMAL = 0.03
"""Relative standard deviation below which the profile is as good as normal."""
_KNOWN = 0.2
"""Relative standard deviation at which a coefficient counts as known."""
_STEPS = 40
"""Most steps of Newton's method."""
_DIFFERENCE = 1e-3
"""Of the logarithm of an amplitude, over which a derivative is taken."""
_LONGEST = 0.7
"""Longest step of a logarithm: a factor of two."""
_GAIN = 1e-6
"""Nats below which a step has gained nothing."""
_RIDGE = 1e-12
"""Added to a correlation matrix, so that two coefficients that cannot be told apart have one."""
_LOOKS = 12
"""Most evaluations for one end of an interval."""
_CLOSE = 0.02
"""Distance of the root of the loss from its target that counts as reached."""


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
            factor = np.exp(TWO_SIDED_95 * spread)
            lower, upper = value / factor, value * factor
            detected = True
        else:
            interval = profile_interval(self.fit, index)
            lower, upper = min(interval.lower, value), max(interval.upper, value)
            detected = interval.against_zero > _DETECTED
            if not detected:
                lower = 0.0
        if name == "N":
            lower, upper = _widened(self.fit, value, lower, upper)
        # Half the interval over that of a coefficient that is just known.
        excess = (upper - lower) / (2 * TWO_SIDED_95 * _KNOWN * value) if value else np.inf
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
        where the limit is still far off. A run that should have been long enough is required as
        much more as the interval is too wide, at most for as long again.
        """
        free = self.fit.free[index]
        expected = value if detected else float(np.sqrt(value * upper))
        model = self.reduced.with_numbers([free], [expected])
        wait = wait_until(model, self.dt, self.duration, self.fit.names[index], _KNOWN)
        return self.duration * min(excess**2 - 1, 1.0) if wait == 0.0 else wait


def _widened(fit: Fit, value: float, lower: float, upper: float) -> tuple[float, float]:
    """Return the interval of N with the error of the level at which a remainder is zero."""
    remainder = fit.model.get(Remainder.symbol)
    if not isinstance(remainder, Remainder) or value <= 0:
        return lower, upper
    error = TWO_SIDED_95 * remainder.level_error / 2  # of N, half of that of its square
    low = value * np.exp(-np.hypot(np.log(value / lower), error)) if lower > 0 else 0.0
    return float(low), float(value * np.exp(np.hypot(np.log(upper / value), error)))


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
    relative = drift.half_width / TWO_SIDED_95 / value if value else np.inf
    # The slope is limited by the random walk: its error falls as 1 / sqrt(time).
    wait = duration * ((relative / _KNOWN) ** 2 - 1) if detected and relative > _KNOWN else None
    return Coefficient(value, lower if detected else 0.0, upper, f"{unit}/s", detected, wait)


def bias_reduced(fit: Fit) -> NoiseModel:
    """Return the model with bias-reduced amplitudes; shapes stay where the fit put them."""
    free = tuple(
        f
        for f, relative in zip(fit.free, fit.jacobian.T, strict=True)
        if fit.model.quantity(f).role == "amplitude" and _is_seen(fit, f, relative)
    )
    if not free:
        return fit.model
    problem = _Penalised(fit, free)
    point = np.log(problem.start())
    value = problem.objective(point)
    for _ in range(_STEPS):
        gradient, information = problem.slopes(point)
        scale = np.sqrt(np.diag(information)) + 1e-12
        block = information / np.outer(scale, scale) + 0.1 * np.eye(len(point))
        step = np.clip(np.linalg.solve(block, gradient / scale) / scale, -_LONGEST, _LONGEST)
        fraction, gained = 1.0, -np.inf
        while gained < 0 and fraction > 1e-3:
            trial = point + fraction * step
            gained = problem.objective(trial) - value
            fraction /= 3
        if gained < 0:
            break
        point, value = trial, value + gained
        if gained < _GAIN:
            break
    return problem.at(point)


def _is_seen(fit: Fit, free: Free, relative: Array) -> bool:
    """Return whether the evidence says anything about an amplitude: one at zero has no slope."""
    if not relative.any():
        unit = fit.model.components[free.part].with_power(1.0)
        relative = fit.likelihood.column(fit.model, unit)
    return bool(np.any(relative[fit.likelihood.dof > 0] > 0))


class _Penalised:
    """Log-likelihood plus half the log-determinant of the information about the amplitudes."""

    def __init__(self, fit: Fit, free: tuple[Free, ...]) -> None:
        self.fit, self.likelihood, self.free = fit, fit.likelihood, free
        self.amplitudes = np.array([fit.model.number(f) for f in free])
        components = fit.model.components
        units = [components[f.part].with_power(1.0) for f in free]
        self.columns = np.array([self.likelihood.column(fit.model, unit) for unit in units]).T
        self.weight = np.sqrt(self.likelihood.dof / 2)
        self.rest = np.maximum(fit.expected - self.columns @ self.amplitudes**2, 0.0)

    def start(self) -> Array:
        """Return where to start: for an amplitude at zero, the smallest that could be seen."""
        amplitudes = self.amplitudes
        expected = np.maximum(self.rest + self.columns @ amplitudes**2, 1e-300)
        relative = self.columns / expected[:, np.newaxis]
        visible = (0.5 * np.sum(self.likelihood.dof[:, np.newaxis] * relative**2, axis=0)) ** -0.25
        return np.where(amplitudes > 0.3 * visible, amplitudes, visible)

    def objective(self, point: Array) -> float:
        expected, information = self._information(point)
        # About the amplitudes themselves: the determinant in logarithms over their squares.
        penalty = 0.5 * float(_log_determinant(information)) - float(point.sum())
        return self.likelihood.value(expected) + penalty

    def slopes(self, point: Array) -> tuple[Array, Array]:
        """Return the gradient of the objective and the information, by logarithms."""
        expected, information = self._information(point)
        relative = 2 * self.columns * np.exp(2 * point) / expected[:, np.newaxis]
        data = self.likelihood
        score = 0.5 * relative.T @ (data.dof * (data.power / expected - 1))
        moved = _DIFFERENCE * np.eye(len(point))
        beside = self._information(point + np.concatenate([moved, -moved]))[1]
        up, down = _log_determinant(beside).reshape(2, -1)
        penalty = 0.5 * (up - down) / (2 * _DIFFERENCE) - 1
        return score + penalty, information

    def at(self, point: Array) -> NoiseModel:
        """Return the model with these logarithms of amplitudes."""
        return self.fit.model.with_numbers(self.free, np.exp(point))

    def _information(self, points: Array) -> tuple[Array, Array]:
        """Return expected powers, shape (..., b), and the information, at points (..., p)."""
        powers = np.exp(2 * points)
        expected = np.maximum(self.rest + powers @ self.columns.T, 1e-300)
        relative = self.columns.T * (2 * powers)[..., np.newaxis]
        relative *= (self.weight / expected)[..., np.newaxis, :]
        return expected, relative @ np.swapaxes(relative, -1, -2)


def _log_determinant(information: Array) -> Array:
    """Return ln det of information matrices, shape (..., p, p), also where columns are alike."""
    scale = np.sqrt(np.diagonal(information, axis1=-2, axis2=-1)) + 1e-150
    outer = scale[..., :, np.newaxis] * scale[..., np.newaxis, :]
    correlation = information / outer + _RIDGE * np.eye(scale.shape[-1])
    return np.asarray(np.linalg.slogdet(correlation)[1] + 2 * np.sum(np.log(scale), axis=-1))


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
    lost = _loss_of(fit, free)
    best, spread = float(fit.values[index]), float(fit.relative_sd()[index])
    known = np.isfinite(spread) and best > 0
    spread = min(spread, 1.0) if known else 1.0
    target = CHI_SQUARE_95 * (1 + 2 / 3 * spread**2)
    against_zero = np.inf if is_shape else max(0.0, lost(0.0))
    scale = best if known else _visible(fit, index)
    upper = _crossing(lost, best, best + 2 * spread * scale, target)
    if against_zero <= target:
        return Interval(0.0, upper, against_zero)
    lower = _crossing(lost, best, best / (1 + 2 * spread), target, floor=0.0)
    return Interval(lower, upper, against_zero)


def _loss_of(fit: Fit, free: Free) -> Callable[[float], float]:
    """Return what tells twice the nats that are lost with a number held at a value."""
    quantity, held = fit.model.quantity(free), fit.held | {free}
    likelihood, bounds = fit.likelihood, (quantity.lower, quantity.upper)

    def lost(value: float) -> float:
        model = fit.model.with_numbers([free], [float(np.clip(value, *bounds))])
        return 2 * (fit.loglik - likelihood.maximise(model, held=held).loglik)

    if quantity.role == "shape" or not fit.model.shapes <= held:
        return lost
    # What is linear in its square needs nothing else computed again.
    basis = likelihood.basis(fit.model.with_numbers([free], [0.0]), held)
    unit = likelihood.column(fit.model, fit.model.components[free.part].with_power(1.0))

    def lost_by_square(value: float) -> float:
        fixed = basis.fixed + np.clip(value, *bounds) ** 2 * unit
        return 2 * (fit.loglik - likelihood.largest(replace(basis, fixed=fixed)))

    return lost_by_square


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
