r"""Whether a process of the spectrum is there all along, as its name says.

The spectrum of a record tells how much power is at a frequency, not when: a tone that sweeps
through 0 Hz has the spectrum of Gauss-Markov noise, a chirp that of noise behind a band-pass. Only
a stationary process has it all the time. The frequencies where it counts are cut into cells and
the record into parts. For a stationary process the powers :math:`P_t` of a cell are draws from one
gamma distribution of d degrees of freedom; whether they are is Bartlett's test,

.. math:: d \left(T \ln \bar P - \sum_{t=1}^{T} \ln P_t\right),

summed over the cells, in standard deviations. A part may be loud as a whole (`variance_change`):
the noise beside the process is scaled by the power of its part at all other frequencies first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.special import digamma, polygamma

from allanscope.explain.candidate import Candidate
from allanscope.explain.view import View
from allanscope.noise.components import Component, White
from allanscope.noise.filters import made_white_share

__all__ = ["UNSTEADY", "reach_of", "unsteadiness_of"]

Array = NDArray[np.float64]

UNSTEADY = 2.2
"""Sigma; of 220 true processes of all widths and sizes one came beyond."""
_PARTS = (4, 8, 16, 32)
_FIRST, _FEWEST, _CELLS = 1, 2, 12
"""First ordinate of a part, ordinates of a cell and most cells."""
_MARGIN, _ROUNDING = 3, 0.1
_BURSTS = 0.5
_DRIFT = 0.05
"""Share of the band below which a filter does nothing."""
_COUPLED = (1.0, 2 * 4 / 9, 2 / 36)
"""Squared correlation of the ordinates of Hann's window with the next ones, on both sides."""
_ALIKE = 8.0
"""Variance of the powers of the parts, over what chance makes of one ordinate, that is nothing."""
_COUNTS = 0.25
"""Process over the noise beside it from which a frequency counts, if it comes so far."""


def reach_of(view: View, candidate: Candidate) -> tuple[float, float]:
    """Return the lowest and the highest frequency where a process counts in the spectrum.

    A filter counts everywhere but where the level drifts.
    """
    f = view.grid.centre
    if not _adding(candidate):
        return _DRIFT * view.grid.rate_hz / 2, view.grid.rate_hz / 2
    process, rest = _shares(view, candidate, f)
    ratio = process / rest
    counts = np.flatnonzero(ratio >= min(_COUNTS, 0.2 * float(ratio.max())))
    return float(f[counts[0]]), float(f[counts[-1]])


def unsteadiness_of(view: View, candidate: Candidate) -> float:
    """Return by how many sigma a process comes and goes more than a stationary one does."""
    low, high = reach_of(view, candidate)
    return max((_unsteadiness(view, candidate, low, high, parts) for parts in _PARTS), default=0.0)


def _shares(view: View, candidate: Candidate, f: Array) -> tuple[Array, Array]:
    """Return the variance of the process and of the noise beside it at some frequencies."""
    after = view.with_parts(*candidate.parts).spectrum
    added = len(_adding(candidate))
    process = after.of(after.model.components[-added:] if added else (), f)
    return process, np.maximum(after.at(f) - process, 1e-300)


def _adding(candidate: Candidate) -> list[Component]:
    return [part for part in candidate.parts if isinstance(part, Component)]


def _open(view: View, f: Array) -> NDArray[np.bool_]:
    """Tell which frequencies are not within or next to what was cut out of the fit."""
    kept = np.ones(len(f), bool)
    for low, high in view.excluded:
        kept &= (f < low) | (f > high)
    return np.asarray(minimum_filter1d(kept, 2 * _MARGIN + 1))


def _in_bursts(view: View, candidate: Candidate, f: Array) -> NDArray[np.bool_]:
    """Tell where most of the noise is what rows that are held make of it, which comes in bursts."""
    model = view.with_parts(*candidate.parts).model
    filters = model.filters_on(White(1.0))
    share = made_white_share(filters, model.dt, lambda one: one.response(f, model.dt))
    return np.broadcast_to(share > _BURSTS, f.shape)


def _unsteadiness(view: View, candidate: Candidate, low: float, high: float, parts: int) -> float:
    rate = view.grid.rate_hz
    n = len(view.data) // parts
    window = np.hanning(n)
    rows = (view.data[: n * parts] - view.data.mean()).reshape(parts, n)
    power = np.abs(np.fft.rfft(rows * window, axis=1)) ** 2 / np.sum(window**2)
    f = np.arange(power.shape[1]) * rate / n
    process, rest = (np.append(1.0, share) for share in _shares(view, candidate, f[1:]))
    # Rounding is as loud in every part, and behind a filter it may be all there is at the top.
    kept = _open(view, f) & (view.fitted_floor < _ROUNDING * (process + rest))
    kept[1:] &= ~_in_bursts(view, candidate, f[1:])
    kept[:_FIRST] = False
    inside = (f >= low) & (f <= high) & kept
    if np.count_nonzero(inside) < 2 * _FEWEST:
        return 0.0
    beside = ~inside & (f > high) if np.count_nonzero(f > high) > len(f) // 4 else ~inside
    beside &= kept
    if not _adding(candidate):
        beside = inside
    loud = np.ones(parts)
    if np.count_nonzero(beside) > 100:
        loud = np.mean(power[:, beside] / rest[beside], axis=1)
        loud /= loud.mean()
        if beside is not inside and float(np.var(loud)) * np.count_nonzero(beside) < _ALIKE:
            loud[:] = 1.0
    expected = process + loud[:, np.newaxis] * rest
    u = power[:, inside] / expected[:, inside]
    excess = variance = 0.0
    for cell in np.array_split(u, min(_CELLS, u.shape[1] // _FEWEST), axis=1):
        weight = cell.mean(axis=0)
        pairs = sum(
            share * float(weight[: len(weight) - lag] @ weight[lag:])
            for lag, share in enumerate(_COUPLED)
        )
        d = 2 * float(weight.sum()) ** 2 / pairs
        total = cell.mean(axis=1)
        bartlett = parts * np.log(total.mean()) - np.sum(np.log(total))
        usual = digamma(parts * d / 2) - digamma(d / 2) - np.log(parts)
        excess += d * float(bartlett - parts * usual)
        spread = parts * polygamma(1, d / 2) - parts**2 * polygamma(1, parts * d / 2)
        variance += d**2 * float(spread)
    return float(excess / np.sqrt(variance)) if variance > 0 else 0.0
