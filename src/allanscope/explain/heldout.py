r"""How each class of effect is judged on data that was not used to fit it.

Deterministic signals (lines, steps, regressors): whitened by the noise found with the effect, data
and signal become independent in time; the amplitude is fitted on every second block of one second
and judged on the blocks between, and the other way round. The optimism found that way is taken off
the gain of the joint fit, so that a random walk that would do as well counts against the effect.

Stationary processes: the parameters are fitted on one half of the record and judged on the other,
and the other way round.

The error is the scatter of the blocks where every block holds some of the gain. Of what is slow
or happens once, a few blocks hold it all, and their scatter would be the gain itself: there it is
what noise moves a gain by, :math:`\sqrt{2 g}`, and more where the blocks differ from the fit by
more than noise does.

A step or a warm-up happens once: the blocks vouch for its size, but nothing in one record shows
that it would happen again; ``replicated`` stays None for them unless another axis shows it too.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.special import chdtrc

from allanscope.explain.candidate import Candidate, HeldOut, error_of_sum
from allanscope.explain.regression import Regression
from allanscope.explain.series import in_time
from allanscope.explain.spectrum import Spectrum, SpectrumFitter
from allanscope.explain.view import View
from allanscope.noise.grid import Grid, grid_of

__all__ = ["halves", "interleaved", "interleaved_signal"]

Array = NDArray[np.float64]

_BLOCK_S = 1.0
"""Length of the blocks that are fitted and judged in turn."""
_ERROR_BLOCKS_S = (0.0, 0.1, 1.0)
"""Blocks in which the data are compared with a signal; the shortest are single rows."""
_LEAST_FREE = 0.2
"""Part of a block that the fit has not taken, at the least: of less, nothing can be told."""
_PARTS = 4
"""Parts of a record that must agree on an effect which has to replicate."""
_FOLDS = 2
"""Folds of the blocks: each is judged with what the other says."""


def interleaved(
    view: View,
    fit: Regression,
    columns: Array,
    *,
    recurs: bool = False,
    slow: bool = False,
    block: NDArray[np.int64] | None = None,
) -> HeldOut:
    """Judge deterministic signals by interleaved blocks.

    Parameters
    ----------
    fit : Regression
        The joint fit.
    columns : ndarray, shape (p, m)
        First ordinates of the signals.
    recurs : bool
        True when each quarter of the record holds the signal again, so that it can be replicated.
    slow : bool
        True when a few blocks hold all of it even so.
    block : ndarray of int64, optional
        Number of the block, from 0 on, of places that are evenly apart in time, m + 1 or more;
        without it, of every row in blocks of one second, or of one row where that is longer.
    """
    m = columns.shape[1]
    if block is None:
        block = _blocks(view.grid.n, _BLOCK_S, view.grid.rate_hz)
        m = view.grid.n - 1
    n = len(block)
    # What is left out of the fit is left out here: a loud tone would be taken for white noise.
    weight = fit.spectrum.kept / np.sqrt(fit.spectrum.ordinates)
    white = in_time(view.ordinates[:m] * weight[:m], n)
    signals = np.array([in_time(column * weight[: columns.shape[1]], n) for column in columns])
    # A gain is quadratic in the amplitudes: the sums over each block are all that is needed.
    normal = np.array([[np.bincount(block, a * b) for b in signals] for a in signals])
    right = np.array([np.bincount(block, a * white) for a in signals])
    gained = np.empty(right.shape[1])
    for fold in range(_FOLDS):
        test = np.arange(len(gained)) % _FOLDS == fold
        amplitude = _amplitude(normal[:, :, ~test].sum(axis=2), right[:, ~test].sum(axis=1))
        gained[test] = _gain(amplitude, normal[:, :, test], right[:, test])
    whole = normal.sum(axis=2), right.sum(axis=1)
    optimism = float(_gain(_amplitude(*whole), *whole) - gained.sum())
    if recurs and not slow:
        # Noise that was fitted without a loud signal has a part of it, and the gain over that noise
        # is less: as uncertain in proportion.
        error = error_of_sum(gained) * float(np.clip(fit.gain / max(gained.sum(), 1e-300), 0, 1))
    else:
        variance = 2 * max(fit.gain, 0.0) * _contradiction(signals, white, view.grid.rate_hz)
        error = float(np.sqrt(variance))
    return HeldOut(
        nats=fit.gain - max(optimism, 0.0),
        error=error,
        design=f"interleaved blocks of {max(_BLOCK_S, 1 / view.grid.rate_hz):.3g} s",
        replicated=_replicated(signals, white) if recurs else None,
    )


def _contradiction(signals: Array, white: Array, rate_hz: float) -> float:
    """Return the variance of what the data say about signals, over that of unit noise, at least 1.

    It is taken from what each block differs by from the fit, corrected for what the fit has taken
    of it (White 1980; MacKinnon and White's HC2), in blocks of several lengths. Where the data are
    no such signal (a piece of a shock), they differ by much more than noise does.
    """
    normal = signals @ signals.T
    amplitude = _amplitude(normal, signals @ white)
    energy = float(amplitude @ normal @ amplitude)
    if energy <= 0:
        return 1.0
    signal = amplitude @ signals
    left = signal * (white - signal)
    ratios = [1.0]
    for length_s in _ERROR_BLOCKS_S:
        block = _blocks(len(white), length_s, rate_hz)
        free = np.maximum(1 - np.bincount(block, signal**2) / energy, _LEAST_FREE)
        ratios.append(float(np.sum(np.bincount(block, left) ** 2 / free)) / energy)
    return max(ratios)


def _blocks(rows: int, length_s: float, rate_hz: float) -> NDArray[np.int64]:
    """Return the number of the block of each row, in blocks of a length or of one row at least."""
    return (np.arange(rows) / max(1.0, length_s * rate_hz)).astype(np.int64)


def _amplitude(normal: Array, right: Array) -> Array:
    return np.asarray(np.linalg.pinv(normal, hermitian=True) @ right)


def _gain(amplitude: Array, normal: Array, right: Array) -> Array:
    """Log-likelihood that signals of these amplitudes gain; the last axis, if any, is of blocks."""
    squares = np.einsum("i,ij...,j->...", amplitude, normal, amplitude)
    return np.asarray(np.einsum("i,i...->...", amplitude, right) - 0.5 * squares)


def _replicated(signals: Array, white: Array) -> bool:
    """Return whether the quarters of the record agree on the amplitudes (chi-square, 1 %)."""
    size, n = signals.shape
    weight, weighted, parts = np.zeros((size, size)), np.zeros(size), []
    edges = [part[0] for part in np.array_split(np.arange(n), _PARTS)]
    for first, last in pairwise([*edges, n]):
        design = signals[:, first:last]
        normal = design @ design.T
        amplitude = _amplitude(normal, design @ white[first:last])
        parts.append((normal, amplitude))
        weight = weight + normal
        weighted = weighted + normal @ amplitude
    common = np.linalg.lstsq(weight, weighted, rcond=None)[0]
    distance = sum(float((a - common) @ normal @ (a - common)) for normal, a in parts)
    freedom = size * (_PARTS - 1)
    return bool(chdtrc(freedom, max(distance, 0.0)) > 0.01)


def halves(view: View, candidate: Candidate) -> HeldOut:
    """Judge stationary parts: fit their amplitudes on one half, score the other."""
    half = view.grid.n // 2
    grid = grid_of(half, view.grid.rate_hz, view.grid.stride)
    parts = [view.data[:half], view.data[half : 2 * half]]
    powers = [
        grid.binned(dct(part - part.mean(), norm="ortho")[1:] ** 2, view.excluded)[0]
        for part in parts
    ]
    nats, variance = 0.0, 0.0
    for train, test in ((0, 1), (1, 0)):
        new, old = (
            SpectrumFitter.of(grid, model, view.excluded).fit(powers[train])
            for model in (view.model.plus(*candidate.parts), view.model)
        )
        nats += new.loglik_of(powers[test]) - old.loglik_of(powers[test])
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
    noise = view.fitter, view.power, view.spectrum.powers
    fit = Regression(np.empty(0), np.empty(0), gain, *noise)
    return interleaved(view, fit, columns, recurs=True)
