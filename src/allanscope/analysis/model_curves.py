"""Fitted models as curves to be drawn over what was measured.

The loop takes steps, lines and warm-ups out of the data, while the measured curve still has them:
before both share a picture, their own variance is added to that of the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank, Deviation
from allanscope.analysis.result import ModelCurve
from allanscope.noise import Coefficient, NoiseModel
from allanscope.noise.components import Component, White
from allanscope.spectrum import Density

if TYPE_CHECKING:
    from allanscope.explain import Explanation

__all__ = ["DrawnModels", "draw_models"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DrawnModels:
    """The curves of one axis; None for what is not known."""

    model: ModelCurve | None = None
    before: ModelCurve | None = None
    density: ModelCurve | None = None


def draw_models(
    axis: str,
    loop: Explanation | None,
    fitted: NoiseModel | None,
    curve: Deviation | None,
    density: Density,
    rate_hz: float,
    coefficients: Mapping[str, Coefficient],
) -> DrawnModels:
    """Return the models of one axis at the times and frequencies that were measured.

    They are the sum of what was detected. The most likely value of a coefficient that was not is no
    finding, and its line would be taken for one.

    Parameters
    ----------
    axis : str
        Its name.
    loop : Explanation or None
        The closed loop; its models go before the fitted one.
    fitted : NoiseModel or None
        The fit of the textbook's terms, for as long as the loop has nothing to say.
    curve : Deviation or None
        Overlapping Allan deviation, as measured.
    density : Density
        As measured.
    rate_hz : float
        Samples per second.
    coefficients : mapping
        Those of this axis.
    """
    before = loop.models_before.get(axis) if loop else None
    after = loop.models_after.get(axis) if loop else None
    final = _detected(after if after is not None else fitted, coefficients)
    spectrum = None
    if final is not None and len(density.frequency):
        spectrum = ModelCurve(density.frequency, np.asarray(final.density(density.frequency)))
    if curve is None or not len(curve.m):
        return DrawnModels(density=spectrum)
    signals = _signal_variances(axis, loop, curve, 1.0 / rate_hz) if loop and after else {}
    textbook = before
    if loop is not None and axis in loop.axes:
        textbook = _detected(textbook, loop.axes[axis].coefficients_before)
    return DrawnModels(
        model=_curve(final, curve, signals),
        before=_curve(textbook, curve, {}),
        density=spectrum,
    )


def _detected(
    model: NoiseModel | None, coefficients: Mapping[str, Coefficient]
) -> NoiseModel | None:
    """Return a model without the coefficients that were not detected; None if nothing is left."""
    if model is None:
        return None
    left = model.without(*(name for name, known in coefficients.items() if not known.detected))
    return left if left.components else None


def _curve(
    model: NoiseModel | None, curve: Deviation, signals: Mapping[str, Array]
) -> ModelCurve | None:
    if model is None:
        return None
    parts: dict[str, Array] = {}
    for part, variance in zip(model.components, model.components_at("oadev", curve.m), strict=True):
        name = _name(model, part)
        parts[name] = parts.get(name, 0.0) + variance
    for kind, variance in signals.items():
        parts[kind] = parts.get(kind, 0.0) + variance
    total = np.sqrt(np.sum(list(parts.values()), axis=0))
    return ModelCurve(curve.tau, total, {name: np.sqrt(part) for name, part in parts.items()})


def _name(model: NoiseModel, part: Component) -> str:
    """Return what a component is drawn as: white noise behind a filter as the filter."""
    filters = model.filters_on(part) if isinstance(part, White) else ()
    return filters[0].symbol if filters else part.symbol


def _signal_variances(
    axis: str, loop: Explanation, curve: Deviation, dt: float
) -> dict[str, Array]:
    """Return the Allan variance of everything that is no noise, by kind of effect."""
    found: dict[str, Array] = {}
    for effect in loop.axes[axis].effects:
        if effect.curve is not None:
            found[effect.kind] = found.get(effect.kind, 0.0) + effect.curve.avar(curve.m, dt)
    for kind, signal in loop.signals.get(axis, {}).items():
        if kind not in found:
            found[kind] = _variance_of(signal, loop.row_s, curve.tau)
    return found


def _variance_of(signal: Array, row_s: float, tau: Array) -> Array:
    """Return the Allan variance of a signal known in rows at any time.

    Between the times that are whole rows it is interpolated. Below one row a signal that is smooth
    there falls as tau squared, which is far beneath the noise.
    """
    bank = AllanBank(1.0 / row_s, axes=1)
    bank.update(np.asarray(signal, np.float64)[:, np.newaxis])
    known = bank.deviation("oadev", noise="WFM").axis(0)  # its intervals are not asked for
    if not len(known.tau):
        return np.zeros(len(tau))
    least = np.finfo(np.float64).tiny
    logarithm = np.log(np.maximum(known.deviation**2, least))
    inside = np.interp(np.log(tau), np.log(known.tau), logarithm)
    below = 2.0 * np.minimum(np.log(tau / known.tau[0]), 0.0)
    return np.asarray(np.exp(inside + below))
