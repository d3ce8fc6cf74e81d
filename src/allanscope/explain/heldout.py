"""How each class of effect is judged on data that was not used to fit it.

Deterministic signals (lines, steps, regressors): whitened by the noise found with the effect, data
and signal become independent in time; the amplitude is fitted on every second block of one second
and judged on the blocks between, and the other way round. The optimism found that way is taken off
the gain of the joint fit, so that a random walk that would do as well counts against the effect.

Stationary processes: the parameters are fitted on one half of the record and judged on the other,
and the other way round.

A step or a warm-up happens once: the blocks vouch for its size, but nothing in one record shows
that it would happen again; ``replicated`` stays None for them unless another axis shows it too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.stats import chi2

from allanscope.explain.candidate import HeldOut
from allanscope.explain.regression import Regression
from allanscope.explain.spectral import Grid, Spectrum, Term, binned_power, fit_spectrum, grid_of
from allanscope.explain.view import View

__all__ = ["halves", "interleaved", "interleaved_signal"]

Array = NDArray[np.float64]

_BLOCK_S = 1.0
_PARTS = 4
_FOLDS = 2


def interleaved(view: View, fit: Regression, columns: Array, *, recurs: bool = False) -> HeldOut:
    """Judge deterministic signals by interleaved blocks.

    Parameters
    ----------
    fit : Regression
        The joint fit.
    columns : ndarray, shape (p, m)
        First ordinates of the signals.
    recurs : bool
        True when each quarter of the record holds the signal again, so that it can be replicated.
    """
    n = view.grid.n
    root = np.sqrt(fit.spectrum.ordinates)
    white = idct(np.concatenate([[0.0], view.ordinates / root]), norm="ortho")
    m = columns.shape[1]
    signals = []
    for column in columns:
        padded = np.zeros(n)
        padded[1 : m + 1] = column / root[:m]
        signals.append(idct(padded, norm="ortho"))
    design = np.column_stack(signals)
    block = (np.arange(n) / (_BLOCK_S * view.grid.rate_hz)).astype(np.int64)
    gained, optimism = np.empty(n), 0.0
    for fold in range(_FOLDS):
        test = block % _FOLDS == fold
        amplitude = _amplitude(design[~test], white[~test])
        predicted = design[test] @ amplitude
        gained[test] = white[test] * predicted - 0.5 * predicted**2
    full = design @ _amplitude(design, white)
    optimism = float(np.sum(white * full - 0.5 * full**2) - np.sum(gained))
    by_block = np.bincount(block, gained)
    error = float(np.sqrt(len(by_block)) * by_block.std())
    return HeldOut(
        nats=fit.gain - max(optimism, 0.0),
        error=error,
        design="interleaved blocks of 1 s",
        replicated=_replicated(design, white) if recurs else None,
    )


def _amplitude(design: Array, white: Array) -> Array:
    return np.asarray(np.linalg.pinv(design.T @ design, hermitian=True) @ (design.T @ white))


def _replicated(design: Array, white: Array) -> bool:
    """Tell whether the quarters of the record agree on the amplitudes (chi-square, 1 %)."""
    size = design.shape[1]
    weight, weighted, parts = np.zeros((size, size)), np.zeros(size), []
    for part in np.array_split(np.arange(len(white)), _PARTS):
        normal = design[part].T @ design[part]
        amplitude = _amplitude(design[part], white[part])
        parts.append((normal, amplitude))
        weight = weight + normal
        weighted = weighted + normal @ amplitude
    common = np.linalg.lstsq(weight, weighted, rcond=None)[0]
    distance = sum(float((a - common) @ normal @ (a - common)) for normal, a in parts)
    freedom = design.shape[1] * (_PARTS - 1)
    return bool(chi2.sf(distance, freedom) > 0.01)


def halves(view: View, terms: tuple[Term, ...]) -> HeldOut:
    """Judge stationary terms: fit their variances on one half, score the other."""
    half = view.grid.n // 2
    grid = grid_of(half, view.grid.rate_hz)
    parts = [view.data[:half], view.data[half : 2 * half]]
    powers, raws = [], []
    for part in parts:
        squares = dct(part - part.mean(), norm="ortho")[1:] ** 2
        powers.append(binned_power(grid, squares, terms))
        raws.append(binned_power(grid, squares, view.terms))
    nats, variance = 0.0, 0.0
    for train, test in ((0, 1), (1, 0)):
        new = fit_spectrum(
            grid, powers[train], base=view.base, terms=terms, floor=view.fitted_floor
        )
        old = fit_spectrum(
            grid, raws[train], base=view.base, terms=view.terms, floor=view.fitted_floor
        )
        nats += new.loglik_of(powers[test]) - old.loglik_of(raws[test])
        variance += _variance(grid, new, old)
    return HeldOut(
        nats=nats, error=float(np.sqrt(variance)), design="two halves, each by the other"
    )


def _variance(grid: Grid, new: Spectrum, old: Spectrum) -> float:
    """Variance of a log-likelihood ratio between two spectra when the new one holds."""
    ratio = new.at(grid.centre) / old.at(grid.centre)
    return float(np.sum(grid.count * (ratio - 1) ** 2 / 2))


def interleaved_signal(view: View, signals: Array, gain: float) -> HeldOut:
    """Judge signals given in time, whatever their frequency, by interleaved blocks.

    Parameters
    ----------
    signals : ndarray, shape (p, n)
        The signals.
    gain : float
        Gain of the fit from which the optimism is taken off.
    """
    columns = dct(signals - signals.mean(axis=1, keepdims=True), axis=1, norm="ortho")[:, 1:]
    fit = Regression(np.empty(0), np.empty(0), view.spectrum, gain)
    return interleaved(view, fit, columns, recurs=True)
