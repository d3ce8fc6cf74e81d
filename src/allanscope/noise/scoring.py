r"""The shapes of several parts of a model at once, by Fisher scoring.

Where bands overlap, and a filter bends their skirts, each shape depends on all others: estimated in
turn they take many turns. One step for all numbers is

.. math:: (J^T W J + \mu D) \, \delta = J^T W (p / \lambda - 1), \qquad
          J = \partial \ln \lambda / \partial \theta, \quad W = \nu / 2

with D the diagonal of the first, and :math:`\mu` larger after a step that did not gain, smaller
after one that did (Marquardt, J. SIAM 11, 1963). The powers are at their maximum for every shape.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components.narrowband import FORMS
from allanscope.noise.likelihood import Fit
from allanscope.noise.model import Free, NoiseModel

__all__ = ["climb", "other_forms"]

Array = NDArray[np.float64]

_TURNS, _TRIES = 30, 6
"""Steps, and how often one that does not gain is made shorter."""
_DAMPED, _LEAST, _MORE, _LESS = 1e-2, 1e-8, 8.0, 0.2
"""Marquardt's number at first and at the least, and its factors."""
_NOTHING = 1e-300
"""Information that is none."""
_DIFFERENCE, _FARTHEST = 0.02, 0.5
"""Over which a slope is taken, and longest step, of a logarithm or a bandwidth."""


def climb(fit: Fit, shapes: Sequence[Free], within: float) -> Fit:
    """Return the likeliest shapes near those of a fit, and the likeliest powers.

    Parameters
    ----------
    fit : Fit
        Where to begin.
    shapes : sequence of Free
        What is varied.
    within : float
        Gain of a step in nats at which it ends.
    """
    damping, likelihood = _DAMPED, fit.likelihood
    for _ in range(_TURNS):
        former, model = fit, fit.model
        unit = np.array([_unit(model, one) for one in shapes])
        steps = zip(shapes, _DIFFERENCE * unit, strict=True)
        columns = [fit.by_shape(one, step, forward=True) for one, step in steps]
        columns += [likelihood.column(model, c) for c in model if c.has_amplitude and c.power > 0]
        jacobian = np.array(columns) / fit.expected
        weight = likelihood.dof / 2
        scale = np.sqrt(np.maximum((jacobian**2) @ weight, _NOTHING))
        jacobian /= scale[:, np.newaxis]
        information = (jacobian * weight) @ jacobian.T
        score = jacobian @ (weight * (likelihood.power / fit.expected - 1))
        logs = np.log([model.number(one) for one in shapes])
        for _ in range(_TRIES):
            damped = information + damping * np.eye(len(score))
            step = (np.linalg.solve(damped, score) / scale)[: len(shapes)]
            if not np.all(np.isfinite(step)):
                return fit
            step = np.clip(step, -_FARTHEST * unit, _FARTHEST * unit)
            trial = likelihood.amplitudes(
                model.with_numbers(shapes, _bounded(model, shapes, logs + step))
            )
            if trial.loglik > fit.loglik:
                fit, damping = trial, max(damping * _LESS, _LEAST)
                break
            damping *= _MORE
        if fit.loglik - former.loglik < within:
            break
    return fit


def other_forms(fit: Fit, place: int, shapes: Sequence[Free], within: float) -> Iterator[Fit]:
    """Generate the fits in which a band has each of the other forms that it may have.

    Parameters
    ----------
    fit : Fit
        Where to begin.
    place : int
        Of the band among the components.
    shapes : sequence of Free
        What is varied.
    within : float
        As for `climb`.
    """
    model, likelihood = fit.model, fit.likelihood
    band = model.components[place]
    assert band.band is not None
    for form in FORMS:
        other = form(*band.band).with_power(band.power)
        if other == band:
            continue
        components = (*model.components[:place], other, *model.components[place + 1 :])
        yield climb(likelihood.amplitudes(replace(model, components=components)), shapes, within)


def _bounded(model: NoiseModel, shapes: Sequence[Free], logs: Array) -> Array:
    low, high = np.array([(model.quantity(f).lower, model.quantity(f).upper) for f in shapes]).T
    return np.clip(np.exp(logs), low, high)


def _unit(model: NoiseModel, free: Free) -> float:
    """Return by how much a logarithm changes where the spectrum does: that of a line by little."""
    band = model.components[free.part].band if free.part < len(model.components) else None
    if band is None or model.quantity(free).name != "frequency":
        return 1.0
    return min(band[1] / band[0], 1.0)
