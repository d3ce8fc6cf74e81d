r"""Noise in a band: a resonance that is shaken by noise, or a line that wanders.

The correlation is that of a damped oscillation,

.. math:: \gamma(t) = \sigma^2 e^{-\pi w |t|} \cos 2 \pi f_0 t

with the full width at half maximum w. Spotted as a run of ordinates above the model that is wider
than a line; f_0, w and sigma are found by Whittle likelihood on the ordinates around it. It enters
the model as a term of the spectrum.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import gammaincc

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Parameter
from allanscope.explain.effects.base import ALPHA, EffectKind, estimate
from allanscope.explain.heldout import halves
from allanscope.explain.spectral import Term, binned_power, fit_spectrum
from allanscope.explain.tones import envelope_kurtosis
from allanscope.explain.view import View

Array = NDArray[np.float64]

_WIDEST = 0.5
"""Widest run of ordinates looked at, as a share of its frequency."""
_SUB_BINS = 600


def resonance(frequency: Array, rate: float, nonlinear: tuple[float, ...]) -> Array:
    """Variance of an ordinate of a resonance with unit variance; nonlinear = (f0, width)."""
    f0, width = nonlinear
    p = np.exp((-np.pi * width + 2j * np.pi * f0) / rate)
    return np.asarray(((1 - p * p) / (1 - 2 * p * np.cos(2 * np.pi * frequency / rate) + p * p)).real)


class Narrowband(EffectKind):
    """Noise in a band."""

    kind = "narrowband"
    meaning = "noise in a band: a resonance, or a line that wanders"
    confused_with = {
        "sinusoid": "a line stays one bin wide",
        "gauss_markov": "its excess goes down to zero frequency",
        "unexplained": "the envelope of a chirp is constant, that of a resonance is not",
    }

    def propose(self, view: View) -> Iterable[Candidate]:
        """Take the most improbable run of ordinates of every width."""
        best: Candidate | None = None
        for start, width in _runs(view):
            candidate = _fit(view, start, width)
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
        return halves(view, view.terms + candidate.terms)


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
            runs.append((max(bits, excess**2 / (4 * width) if tail < 1e-290 else 0), int(first[k]), width))
        width *= 2
    runs.sort(reverse=True)
    return [(start, width) for _, start, width in runs[:2]]


def _fit(view: View, start: int, width: int) -> Candidate | None:
    grid = view.grid
    unit = grid.rate_hz / (2 * grid.n)
    f0, w = (start + width / 2) * unit, max(width * unit * 0.5, 3 * unit)
    reach = max(10 * width, 400)
    low, high = max(0, start - reach), min(grid.n - 1, start + width + reach)
    size = max(1, (high - low) // _SUB_BINS)
    stop = low + (high - low) // size * size
    f = grid.frequency[low:stop].reshape(-1, size).mean(axis=1)
    power = view.squares[low:stop].reshape(-1, size).mean(axis=1)
    background = view.spectrum.at(f)
    count = float(size)

    def loss(p: Array) -> float:
        c, v, frequency, wide = p[0], p[1], p[2], p[3]
        if not (f[0] < frequency < f[-1]):
            return 1e12
        variance = background * np.exp(c) + np.exp(v) * resonance(
            f, grid.rate_hz, (frequency, float(np.exp(wide)))
        )
        return float(0.5 * count * np.sum(np.log(variance) + power / variance))

    excess = float(np.sum(view.squares[start : start + width] - view.spectrum.ordinates[start : start + width]))
    sigma2 = max(excess / grid.n, 1e-30)
    first = np.array([0.0, np.log(sigma2), f0, np.log(w)])
    simplex = np.vstack([first] + [first + d for d in np.diag([0.1, 0.7, 0.3 * w, 0.7])])
    best = minimize(loss, first, method="Nelder-Mead",
                    options={"initial_simplex": simplex, "xatol": 1e-4 * w, "fatol": 1e-3, "maxiter": 600})  # fmt: skip
    f0, w = float(best.x[2]), float(np.exp(best.x[3]))
    if w < 1.5 * unit or f0 <= 0 or w > 2 * f0:
        return None
    error = _errors(loss, best.x)
    term = Term("narrowband", "adds", (f0, w), resonance, narrow=True)
    terms = (*view.terms, term)
    fit = fit_spectrum(grid, binned_power(grid, view.squares, terms), base=view.base, terms=terms, floor=view.fitted_floor)
    coarse = fit.loglik - view.spectrum.loglik
    flat = minimize(lambda c: float(0.5 * count * np.sum(np.log(background * np.exp(c[0])) + power / background / np.exp(c[0]))), [0.0], method="Nelder-Mead")
    local = float(flat.fun - best.fun)
    gain = max(coarse, local) if w < 0.1 * f0 else coarse
    sigma = float(np.exp(best.x[1] / 2))
    kurtosis, kurtosis_error = envelope_kurtosis(view.data, grid.rate_hz, f0, w)
    return Candidate(
        kind="narrowband",
        parameters={
            "frequency": estimate(f0, error[2], "Hz"),
            "bandwidth": Parameter(w, w * np.exp(-1.96 * error[3]), w * np.exp(1.96 * error[3]), "Hz"),
            "sigma": Parameter(sigma, sigma * np.exp(-0.98 * error[1]), sigma * np.exp(0.98 * error[1]), view.unit),
        },
        gain=gain,
        price=float(np.log(4 * grid.n / ALPHA) * 0.5 + 7.0),
        terms=(term,),
        shape=(f0, w),
        words=f"noise in a band of {w:.3g} Hz around {f0:.4g} Hz",
        evidence={"envelope_kurtosis": kurtosis, "envelope_kurtosis_error": kurtosis_error},
    )  # fmt: skip


def _errors(loss, at: Array) -> Array:  # type: ignore[no-untyped-def]
    """Standard errors from the curvature of the log-likelihood."""
    p = len(at)
    step = np.array([0.02, 0.05, 0.05 * np.exp(at[3]), 0.05])
    hessian = np.empty((p, p))
    for i in range(p):
        for j in range(p):
            a, b = np.zeros(p), np.zeros(p)
            a[i], b[j] = step[i], step[j]
            hessian[i, j] = (
                loss(at + a + b) - loss(at + a - b) - loss(at - a + b) + loss(at - a - b)
            ) / (4 * step[i] * step[j])
    covariance = np.linalg.pinv(hessian, hermitian=True)
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0)))
