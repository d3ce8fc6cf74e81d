r"""The coefficients that a result publishes: those of the model, N as engineers read it.

N of an axis is all of its noise whose density is flat at 1 Hz and below. The white term of a model
is not what people read as N. A low-pass leaves the density below its corner as it is, and there the
white term is that density. A Gauss-Markov process, or a telegraph signal, of a correlation time
well below :math:`1 / (2 \pi\,1\,\mathrm{Hz})` is flat there as well, of the two-sided density
:math:`2 \sigma^2 T_c`, and nothing that averages over more than its correlation time can tell it
from white noise. So is what a broad resonance far above 1 Hz has below itself, the response of a
spring to what is slow:

.. math:: N^2 = N_\text{white}^2 + \sum 2 \sigma^2 T_c + \sum S_\text{band}(0) + N_\text{floor}^2

What a resonance has there is known by its form, and several forms may fit it as well: N is their
mean, weighted with their likelihoods, and its interval holds their scatter.

Longer processes are no part of it. Where a reader takes each sample of the sensor several times,
the white term is that of rows, and the density at 1 Hz as many times as large.

What other axes bring where they leak in is part of N too. The fit is of the axis without them: what
was taken out is the slope times the source as measured, whose white part is put back here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from allanscope.explain import AxisExplanation
from allanscope.noise import Coefficient, CoefficientPart, NoiseFit
from allanscope.noise.components import (
    Floor,
    GaussMarkov,
    MovingLine,
    Narrowband,
    RandomTelegraph,
)
from allanscope.noise.filters import HeldPattern
from allanscope.noise.part import Component
from allanscope.noise.scoring import climb, other_forms
from allanscope.quantities import TWO_SIDED_95

if TYPE_CHECKING:
    from allanscope.noise.likelihood import Fit
    from allanscope.noise.model import Free, NoiseModel

__all__ = ["SHORT_S", "add_coupled", "published_coefficients", "total_white"]

Array = NDArray[np.float64]

SHORT_S = 0.08
"""Longest correlation time in s of a process that counts as white: half of 1 / (2 pi 1 Hz). Its
density at 1 Hz is 80 % of that at zero."""
_FLAT = 0.8
"""The same of a band: at least this ratio of its densities at 0 and 1 Hz, whichever is larger."""
_NOTED = 0.02
"""Share of N^2 below which nobody sees what bands add to it."""
_TELLING, _WITHIN = 0.005, 0.05
"""Share of N^2 that a resonance must have at 0 Hz for the forms of a band to be compared, and gain
of a step in nats at which the search for the shapes of each ends."""
_UNKNOWN = 1.0
"""Half the width of the interval of ln N from which a level below the bands is not known."""
_LIMIT = math.log(10)
"""The same, from which N is told by an upper limit: it may be nothing."""
_DIFFERENCE = 1e-3
"""Of the logarithm of a number, in derivatives."""


def published_coefficients(
    axis: str, fits: Mapping[str, NoiseFit], loop: Mapping[str, AxisExplanation]
) -> dict[str, Coefficient]:
    """Return the coefficients of one axis; none where it was not fitted.

    Parameters
    ----------
    axis : str
        Its name.
    fits : mapping
        Axis to the fit of its noise beside the effects that were found.
    loop : mapping
        Axis to what was found.
    """
    fit = fits.get(axis)
    if fit is None:
        return {}
    return {**fit.coefficients, "N": _white(axis, fits, loop, ())}


def _white(
    axis: str,
    fits: Mapping[str, NoiseFit],
    loop: Mapping[str, AxisExplanation],
    path: tuple[str, ...],
) -> Coefficient:
    own = total_white(fits[axis])
    leaks: dict[str, tuple[Coefficient, float, float]] = {}
    for source, (slope, error) in _sources(loop.get(axis)).items():
        known = _source(source, axis, fits, loop, path)
        if known is not None:
            leaks[source] = (known, slope, error)
    return add_coupled(own, leaks) if leaks else own


def _source(
    source: str,
    axis: str,
    fits: Mapping[str, NoiseFit],
    loop: Mapping[str, AxisExplanation],
    path: tuple[str, ...],
) -> Coefficient | None:
    """Return N of a source as measured.

    In a ring of couplings, each axis cleaned of the next, the fit without effects is what was
    measured.
    """
    if any(one in _sources(loop.get(source)) for one in (*path, axis)):
        return loop[source].coefficients_before.get("N")
    if source not in fits:
        return None
    return _white(source, fits, loop, (*path, axis))


def _sources(explanation: AxisExplanation | None) -> dict[str, tuple[float, float]]:
    """Return the axes that one was cleaned of, each with its slope and the standard error.

    Noise whose amplitude follows an axis is the axis's own: it was made even, not taken out.
    """
    found = {}
    for effect in explanation.effects if explanation is not None else ():
        if effect.kind != "cross_coupling" or not effect.evidence.get("removed", True):
            continue
        source, slope = effect.parameters["source"], effect.parameters["slope"]
        assert not isinstance(slope.value, str)
        low = slope.value if slope.lower is None else slope.lower
        high = slope.value if slope.upper is None else slope.upper
        found[str(source.value)] = (slope.value, (high - low) / (2 * TWO_SIDED_95))
    return found


def correlation_time(component: object) -> float | None:
    """Return the correlation time in s of a process that forgets exponentially, None for others.

    >>> correlation_time(RandomTelegraph(1.0, 0.06))
    0.03
    """
    match component:
        case GaussMarkov(correlation_time=tc):
            return tc
        case RandomTelegraph(dwell=dwell):
            return dwell / 2
        case _:
            return None


def total_white(fit: NoiseFit) -> Coefficient:
    """Return N of a fit, with the white term alone beside it where there is more to it.

    The interval follows from the joint information about all powers and correlation times: where
    white noise and process can hardly be told apart, their sum is known all the same.
    """
    white = fit.coefficients["N"]
    components, dt = fit.model.components, fit.model.dt
    held = math.prod(
        float(one.response(np.zeros(1), dt)[0])
        for one in fit.model.filters
        if isinstance(one, HeldPattern)
    )
    levels = _flat_levels(fit.model)
    noted = _NOTED * held * white.value**2
    are_bands = {i: isinstance(components[i], Narrowband) for i in levels}
    processes = {i: n for i, n in levels.items() if not are_bands[i] and n > 0}
    bands = {i: n for i, n in levels.items() if are_bands[i]}
    if sum(bands.values()) <= noted:
        bands = {}
    flat = processes | bands
    half = TWO_SIDED_95 * _half_error(fit, flat, held)
    if bands and half > _UNKNOWN:
        # What lies below the bands is not known: it is no part of what is said of N.
        flat, half = processes, TWO_SIDED_95 * _half_error(fit, processes, held)
    if not flat:
        if held == 1.0:
            return white
        alone = CoefficientPart.of(white)
        return replace(white.scaled(math.sqrt(held)), white_alone=alone)
    moved, error = _by_form(fit.fit, held) if bands else (0.0, 0.0)
    # The published white term has no first-order bias; the maximum of the likelihood has.
    value = math.sqrt(sum(flat.values()) + held * white.value**2) * math.exp(moved)
    lower, upper = _interval(value, math.hypot(half, TWO_SIDED_95 * error))
    return replace(
        white,
        value=value,
        lower=lower,
        upper=upper,
        detected=lower > 0,
        wait_s=None,
        white_alone=CoefficientPart.of(white),
    )


def _interval(value: float, half: float) -> tuple[float, float]:
    """Return the ends of an interval of N, of which that of ln N is half as wide.

    Of what is hardly known no logarithm has an interval: the lower end is 0 then, and the square
    of the upper one grows on as the error of the square does.

    >>> [float(f"{end:.3g}") for half in (0.1, 20.0) for end in _interval(1.0, half)]
    [0.905, 1.11, 0.0, 60.3]
    """
    if half <= _LIMIT:
        return value * math.exp(-half), value * math.exp(half)
    return 0.0, value * math.exp(_LIMIT) * math.sqrt(1 + 2 * (half - _LIMIT))


def _half_error(fit: NoiseFit, flat: Mapping[int, float], held: float) -> float:
    """Return the standard error of ln N where flat levels are part of it; 0 without any."""
    if not flat:
        return 0.0
    components = fit.model.components
    weights = {i: level / components[i].power for i, level in flat.items()}
    weights |= {i: held for i, c in enumerate(components) if c.symbol == "N"}
    return _relative_error(fit.fit, weights, set(flat)) / 2


def add_coupled(
    own: Coefficient, leaks: Mapping[str, tuple[Coefficient, float, float]]
) -> Coefficient:
    """Return N of an axis with what other axes bring, and without it beside that.

    Parameters
    ----------
    own : Coefficient
        N of the axis itself.
    leaks : mapping
        Source to N of that axis, the slope with which it leaks in, and its standard error. Sources
        are independent of the axis itself, so squares add up.
    """
    variances = [_variance(own)]
    power = own.value**2
    for source, slope, error in leaks.values():
        power += (slope * source.value) ** 2
        variances.append(slope**4 * _variance(source))
        variances.append((2 * slope * error * source.value**2) ** 2)
    value = math.sqrt(power)
    half = TWO_SIDED_95 * math.sqrt(sum(variances)) / (2 * power) if power > 0 else 0.0
    lower, upper = _interval(value, half)
    lower = max(lower, own.lower)
    detected = lower > 0 and any(one.detected for one in (own, *(n for n, _, _ in leaks.values())))
    return replace(
        own,
        value=value,
        lower=lower if detected else 0.0,
        upper=max(upper, own.upper),
        detected=detected,
        wait_s=None if detected else own.wait_s,
        white_alone=own.white_alone or CoefficientPart.of(own),
        decoupled=CoefficientPart.of(own),
    )


def _by_form(fit: Fit, held: float) -> tuple[float, float]:
    """Return mean and standard deviation of the change of ln N by other forms of its bands.

    A line that moves has no other form.
    """
    components, dt = fit.model.components, fit.model.dt
    least = _TELLING * _flat_power(fit.model, held)
    bands = [
        i for i, c in enumerate(components) if c.band is not None and not isinstance(c, MovingLine)
    ]
    if not bands:
        return 0.0, 0.0
    shapes = sorted(free for free in fit.model.shapes if free.part in bands)
    first = climb(fit, shapes, _WITHIN)
    mean = variance = 0.0
    for i in bands:
        band = components[i]
        assert band.band is not None
        if _level(Narrowband(1.0, *band.band).with_power(band.power), dt) < least:
            continue
        fits = [first, *other_forms(first, i, shapes, _WITHIN)]
        nats = np.array([one.loglik - first.loglik for one in fits])
        power = np.array([_flat_power(one.model, held) for one in fits])
        if power[0] == 0.0:
            continue
        # A form that leaves nothing white does not say how large N is.
        nats, power = nats[power > 0], power[power > 0]
        weight = np.exp(nats - nats.max())
        weight /= weight.sum()
        moved = np.log(power / power[0]) / 2
        mean += float(weight @ moved)
        variance += float(weight @ (moved - weight @ moved) ** 2)
    return mean, math.sqrt(variance)


def _flat_power(model: NoiseModel, held: float) -> float:
    """Return the square of N, at the maximum of the likelihood."""
    white = sum(c.power for c in model.components if c.symbol == "N")
    return held * white + sum(_flat_levels(model).values())


def _flat_levels(model: NoiseModel) -> dict[int, float]:
    """Return the levels at 0 Hz of processes that are white at 1 Hz and below, by their place."""
    return {i: _level(c, model.dt) for i, c in enumerate(model.components) if _is_flat(c, model.dt)}


def _is_flat(component: Component, dt: float) -> bool:
    """Return whether a process is white at 1 Hz and below."""
    if isinstance(component, Floor):
        return True
    tc = correlation_time(component)
    if tc is not None:
        return tc <= SHORT_S
    if not isinstance(component, Narrowband) or component.power <= 0:
        return False
    zero, one = component.density(np.array([0.0, 1.0]), dt)
    return bool(_FLAT * max(zero, one) <= min(zero, one))


def _level(component: Component, dt: float) -> float:
    """Return the two-sided density of a process at 0 Hz."""
    tc = correlation_time(component)
    if tc is not None:
        return 2 * tc * component.power
    return float(component.density(np.zeros(1), dt)[0]) / 2


def _variance(one: Coefficient) -> float:
    """Return the variance of the square of a coefficient, from its interval."""
    return ((one.upper**2 - one.lower**2) / (2 * TWO_SIDED_95)) ** 2


def _by_shape(model: NoiseModel, free: Free) -> float:
    """Return the derivative of the flat level of a component by the logarithm of a shape."""
    value = model.number(free)
    up, down = (
        model.with_numbers([free], [value * math.exp(h)]).components[free.part]
        for h in (_DIFFERENCE, -_DIFFERENCE)
    )
    return (_level(up, model.dt) - _level(down, model.dt)) / (2 * _DIFFERENCE)


def _relative_error(fit: Fit, weights: Mapping[int, float], flat: set[int]) -> float:
    """Return the relative standard error of a weighted sum of powers, shapes free.

    The powers themselves are the numbers, not their logarithms: that of one at zero is as certain
    as any other.
    """
    model, data = fit.model, fit.likelihood
    columns, gradient = [], []
    for i, component in enumerate(model.components):
        if component.amplitude_name:
            columns.append(data.column(model, component.with_power(1.0)))
            gradient.append(weights.get(i, 0.0))
    shapes = [free for free in model.numbers if free in model.shapes]
    slopes = fit.derivatives(shapes).T
    for free, slope in zip(shapes, slopes, strict=True):
        columns.append(slope)
        gradient.append(_by_shape(model, free) if free.part in flat else 0.0)
    basis, direction = np.array(columns), np.array(gradient)
    relative = basis / fit.expected * np.sqrt(data.dof / 2)
    scale = np.sqrt(np.maximum(np.sum(relative**2, axis=1), 1e-300))
    relative, direction = relative / scale[:, np.newaxis], direction / scale
    covariance = np.linalg.pinv(relative @ relative.T, hermitian=True)
    total = sum(weights[i] * model.components[i].power for i in weights)
    return float(np.sqrt(max(direction @ covariance @ direction, 0.0)) / total)
