r"""Noise in a band: a resonance that is shaken by noise, or a line that wanders.

The correlation is that of a damped oscillation,

.. math:: \gamma(t) = \sigma^2 e^{-\pi w |t|} \left(\cos \omega_d t +
          \frac{\pi w}{\omega_d} \sin \omega_d |t|\right)

(or without the sine: a line whose amplitude and phase wander; or a flat top, for noise behind a
band-pass; the likeliest of them) with the full width at half maximum w. Spotted as a run of
ordinates above the model that is wider than a line; f_0, w and sigma are found by Whittle
likelihood on the ordinates around it. It enters the model as a term of the spectrum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import gammaincc

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effects.base import (
    ALPHA,
    EffectKind,
    errors_of,
    estimate,
    is_near,
    log_interval,
)
from allanscope.explain.heldout import halves
from allanscope.explain.spectrum import fit_spectrum
from allanscope.explain.unevenness import crowding
from allanscope.explain.view import View
from allanscope.noise.components import BandPassed, Component, PeakFiltered, WanderingLine
from allanscope.noise.components import Narrowband as Resonance
from allanscope.noise.grid import Grid

Array = NDArray[np.float64]
Shape = Callable[[float, float], Component]
Beside = Callable[[Array], Array]
"""Variance of the ordinates without the band, at frequencies in Hz."""

_WIDEST = 0.5
"""Widest run of ordinates looked at, as a share of its frequency."""
_SUB_BINS = 400
_FINEST_HZ = 1e-8
_ROUNDS = 3
_RESOLVED = 0.05
_FORBIDDEN = 1e15
"""Loss beyond the ends of the window."""
_SHAPELY, _BROAD = 100.0, 500.0
"""Nats and independent powers from which the form of a band can be told, and that it holds noise:
any tone that moves has a flat top too."""
_BROADEST = 0.7
"""Beyond, as a share of the frequency, no one would call the band narrow."""


def _resonance(f0: float, width: float) -> Component:
    return Resonance(1.0, f0, width)


def _wandering(f0: float, width: float) -> Component:
    return WanderingLine(1.0, f0, width)


def _peaked(f0: float, width: float) -> Component:
    return PeakFiltered(1.0, f0, width)


def _passed(f0: float, width: float) -> Component:
    return BandPassed(1.0, f0, width, order=2)


def _passed_steeply(f0: float, width: float) -> Component:
    return BandPassed(1.0, f0, width, order=4)


class Narrowband(EffectKind):
    """Noise in a band."""

    kind = "narrowband"
    meaning = "noise in a band: a resonance, or a line that wanders"
    located_by = "frequency"
    is_process = True
    is_shared = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "sinusoid": "a line stays one bin wide",
        "gauss_markov": "its excess goes down to zero frequency",
        "unexplained": "a chirp goes through its band once, in one direction",
    }

    def is_same(self, first: Candidate, second: Candidate, grid: Grid) -> bool:
        """Tell whether two candidates are one hypothesis."""
        del grid
        return is_near(first, second, min(first.shape[-1], second.shape[-1]) / 2)

    def propose(self, view: View) -> Iterable[Candidate]:
        """Take the most improbable run of ordinates of every width."""
        best: Candidate | None = None
        same = crowding(view.data)
        for start, width in _runs(view):
            candidate = _fit(view, start, width)
            if candidate is not None and not _kept(view, candidate.shape[0]):
                continue  # what is beside a range that was cut out belongs to it
            if candidate is not None:
                candidate = replace(candidate, gain=candidate.gain / same)
            if candidate is not None and (best is None or candidate.gain > best.gain):
                best = candidate
        return [best] if best is not None else []

    def refine(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate the band again."""
        f0, width = candidate.shape[:2]
        k = 2 * view.grid.n / view.grid.rate_hz
        again = _fit(view, int(max(0, (f0 - width / 2) * k)), max(2, int(width * k)))
        return again if again is not None else candidate

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge by the two halves."""
        return halves(view, candidate)


def _kept(view: View, frequency: float) -> bool:
    at = int(frequency * 2 * view.grid.n / view.grid.rate_hz) - 1
    return bool(view.spectrum.kept[min(max(at, 0), view.grid.n - 2)])


def _runs(view: View) -> list[tuple[int, int]]:
    """First ordinate and width of the most improbable runs, best first."""
    u = view.squares / view.spectrum.ordinates
    u[~view.spectrum.kept] = 1.0
    capped = np.minimum(u, 25.0)
    total = np.concatenate([[0.0], np.cumsum(capped)])
    runs = []
    width = 4
    while width < len(u) // 3:
        hop = max(1, width // 4)
        first = np.arange(max(1, int(width / _WIDEST / 1.5)), len(u) - width, hop)
        if len(first) == 0:
            break
        sums = total[first + width] - total[first]
        k = int(np.argmax(sums))
        tail = gammaincc(width / 2, sums[k] / 2)
        bits = -np.log(max(float(tail), 1e-300))
        if bits > np.log(len(u)):
            excess = float(sums[k] - width)
            beyond = excess**2 / (4 * width) if tail < 1e-290 else 0.0
            runs.append((max(bits, beyond), int(first[k]), width))
        width *= 2
    runs.sort(reverse=True)
    return [(start, width) for _, start, width in runs[:2]]


@dataclass(frozen=True)
class _Window:
    """The ordinates around a band, averaged into at most some hundred bins."""

    frequency: Array
    power: Array
    background: Array
    size: int
    grid: Grid
    shape: Shape

    def loss(self, p: Array) -> float:
        """Negative log-likelihood of (log background factor, log variance, f0, log width)."""
        f0, width = float(p[2]), float(np.exp(p[3]))
        if not (self.frequency[0] < f0 < self.frequency[-1]) or not _FINEST_HZ < width < 1.5 * f0:
            return _FORBIDDEN
        band = self.shape(f0, width).spectrum(self.frequency, self.grid.dt, self.grid.stride)
        variance = self.background * np.exp(p[0]) + np.exp(p[1]) * band
        return float(0.5 * self.size * np.sum(np.log(variance) + self.power / variance))

    def flat(self) -> float:
        """Return the least loss without a band."""
        ratio = float(np.mean(self.power / self.background))
        variance = self.background * ratio
        return float(0.5 * self.size * np.sum(np.log(variance) + self.power / variance))


def _window(view: View, beside: Beside, f0: float, width: float, shape: Shape) -> _Window:
    grid = view.grid
    unit = grid.rate_hz / (2 * grid.n)
    reach = max(12 * width, 400 * unit)
    low = int(max(0.2 * f0, f0 - reach) / unit)  # below, noise changes within a bin
    high = int(min(grid.n - 1, (f0 + reach) / unit))
    size = max(1, (high - low) // _SUB_BINS)
    stop = low + (high - low) // size * size
    f = grid.frequency[low:stop].reshape(-1, size).mean(axis=1)
    power = view.squares[low:stop].reshape(-1, size).mean(axis=1)
    return _Window(f, power, beside(f), size, grid, shape)


def _fit(view: View, start: int, width: int) -> Candidate | None:
    """Return the likeliest shape; flat tops are looked for only where one could be seen."""
    fits = [_fit_shape(view, start, width, shape) for shape in (_resonance, _wandering)]
    best = max((f for f in fits if f is not None), key=lambda f: f.gain, default=None)
    if best is None or best.gain < _SHAPELY or best.shape[1] * view.series.duration_s < _BROAD:
        return best
    fits += [_fit_shape(view, start, width, shape) for shape in (_peaked, _passed, _passed_steeply)]
    return max((f for f in fits if f is not None), key=lambda f: f.gain, default=None)


def _fit_shape(view: View, start: int, width: int, shape: Shape) -> Candidate | None:
    grid = view.grid
    unit = grid.rate_hz / (2 * grid.n)
    f0, w = (start + width / 2) * unit, max(width * unit * 0.5, 3 * unit)
    excess = view.squares[start : start + width] - view.spectrum.ordinates[start : start + width]
    point = np.array([0.0, np.log(max(float(excess.sum()) / grid.n, 1e-30)), f0, np.log(w)])
    beside: Beside = view.spectrum.at
    for _ in range(_ROUNDS):
        # What is beside the band is known only once the band is in the model.
        window = _window(view, beside, float(point[2]), float(np.exp(point[3])), shape)
        spread = np.diag([0.05, 0.3, 0.3 * np.exp(point[3]), 0.3])
        found = minimize(
            window.loss, point, method="Nelder-Mead",
            options={"initial_simplex": np.vstack([point, point + spread]), "maxiter": 500,
                     "xatol": 1e-3 * np.exp(point[3]), "fatol": 1e-3},
        )  # fmt: skip
        point = np.asarray(found.x)
        f0, w = float(point[2]), float(np.exp(point[3]))
        if w < 1.5 * unit or w > _BROADEST * f0:
            return None
        band = shape(f0, w)
        whole = fit_spectrum(grid, view.power, view.model.plus(band), excluded=view.excluded)
        beside = partial(whole.of, whole.model.components[:-1])
    gain = whole.loglik - view.spectrum.loglik
    if w < _RESOLVED * f0:  # a bin is as wide: the ordinates in the window know more
        gain = max(gain, window.flat() - float(found.fun))
    error = _errors(window.loss, point)
    sigma = float(np.exp(point[1] / 2))
    return Candidate(
        kind="narrowband",
        parameters={
            "frequency": estimate(f0, error[2], "Hz"),
            "bandwidth": log_interval(w, error[3], "Hz"),
            "sigma": log_interval(sigma, error[1] / 2, view.unit),
        },
        gain=gain,
        price=float(np.log(4 * grid.n / ALPHA) * 0.5 + 7.0),
        parts=(band,),
        shape=(f0, w),
        words=f"noise in a band of {w:.3g} Hz around {f0:.4g} Hz",
    )


def _errors(loss: Callable[[Array], float], at: Array) -> Array:
    """Return standard errors from the curvature of the log-likelihood.

    NaN at an end of what is allowed: a band whose centre wants to lie beyond is not measured.
    """
    p = len(at)
    step = np.array([0.02, 0.05, 0.05 * np.exp(at[3]), 0.05])
    sides = (loss(at + sign * 2 * row) for row in np.diag(step) for sign in (-1, 1))
    if max(sides) >= _FORBIDDEN:
        return np.full(p, np.nan)
    hessian = np.empty((p, p))
    for i in range(p):
        for j in range(p):
            a, b = np.zeros(p), np.zeros(p)
            a[i], b[j] = step[i], step[j]
            hessian[i, j] = (
                loss(at + a + b) - loss(at + a - b) - loss(at - a + b) + loss(at - a - b)
            ) / (4 * step[i] * step[j])
    return errors_of(hessian)
