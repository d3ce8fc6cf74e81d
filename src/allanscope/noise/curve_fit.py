"""Coefficients from the Allan curve itself: generalised least squares on its logarithm.

With the full covariance of the points this is as efficient as the likelihood of the spectrum for
N, B and K, and it shares nothing with its machinery: the second opinion.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.deviation import Deviation
from allanscope.noise.components import Component
from allanscope.noise.gls import CurveResidual, gls_chi2
from allanscope.noise.log_curve import (
    LONGEST,
    half_octaves,
    log_bias,
    log_covariance,
    samples,
    whitener,
)
from allanscope.noise.model import NoiseModel

__all__ = ["CurveFit", "fit_curve"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CurveFit:
    """Amplitudes fitted to a curve.

    Attributes
    ----------
    components : tuple of Component
        With their fitted amplitudes.
    relative_sd : ndarray, shape (p,)
        Relative standard deviation of each amplitude, all fitted together.
    residual : CurveResidual
        Of the curve against them.
    """

    components: tuple[Component, ...]
    relative_sd: Array
    residual: CurveResidual


def fit_curve(
    deviation: Deviation, components: Iterable[Component], dt: float, *, n: int | None = None
) -> CurveFit:
    """Fit the amplitudes of components to a curve by generalised least squares on its logarithm.

    As efficient as the likelihood of the spectrum for N, B and K, and independent of its
    machinery: the second opinion.

    Parameters
    ----------
    deviation : Deviation
        One axis; ``oadev``, ``ohdev`` or ``mdev``.
    components : iterable of Component
        Each with one amplitude, first among its values; where the search starts.
    dt : float
        Time between samples in s.
    n : int, optional
        Samples in the run.
    """
    parts = tuple(components)
    n = n or samples(deviation)
    pick = half_octaves(deviation.m, n // LONGEST)
    m, measured = deviation.m[pick], deviation.deviation[pick] ** 2
    units = [_with_amplitude(part, 1.0) for part in parts]
    basis = np.column_stack([NoiseModel((unit,), dt).variance(deviation.kind, m) for unit in units])
    log_power = np.log([max(part.values[0], 1e-12) ** 2 for part in parts])
    jacobian = np.empty((0, 0))
    for _ in range(3):
        current = [
            _with_amplitude(u, float(np.exp(x / 2))) for u, x in zip(units, log_power, strict=True)
        ]
        expected = basis @ np.exp(log_power)
        model = NoiseModel(tuple(current), dt)
        correlated, edf = log_covariance(model, deviation.kind, m, n, expected)
        whiten, _ = whitener(correlated)
        target = np.log(measured) - log_bias(edf)
        log_power, jacobian = _gauss_newton(basis, whiten, target, log_power)
    amplitudes = np.exp(log_power / 2)
    fitted = tuple(_with_amplitude(u, float(a)) for u, a in zip(units, amplitudes, strict=True))
    # The Jacobian is by the logarithm of the power, twice that of the amplitude.
    spread = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian, hermitian=True))) / 2
    return CurveFit(fitted, spread, gls_chi2(deviation, NoiseModel(fitted, dt), n=n))


def _with_amplitude(component: Component, amplitude: float) -> Component:
    """Return a component with its first value replaced."""
    return component.with_values((amplitude, *component.values[1:]))


def _gauss_newton(
    basis: Array, whiten: Array, target: Array, log_power: Array
) -> tuple[Array, Array]:
    jacobian = whiten @ basis
    for _ in range(50):
        share = basis * np.exp(log_power)
        total = share.sum(axis=1)
        jacobian = whiten @ (share / total[:, np.newaxis])
        residual = whiten @ (target - np.log(total))
        normal = jacobian.T @ jacobian + 1e-9 * np.eye(len(log_power))
        step = np.clip(np.linalg.solve(normal, jacobian.T @ residual), -1.0, 1.0)
        log_power = np.maximum(log_power + step, -80.0)
        if float(np.max(np.abs(step))) < 1e-6:
            break
    return log_power, jacobian
