r"""A step: the level jumps once and stays.

A step leaves D^2/(pi^2 k^2) in the spectrum, exactly like a random walk with K = D / sqrt(T): the
curve and the spectrum cannot tell the two apart, the phases can. The matched filter for every
instant is scanned at once by an inverse cosine transform of the whitened ordinates; the best few
are fitted jointly with the noise, and the instant is then refined to the sample.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dst, fft, idct

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Parameter
from allanscope.explain.effects.base import ALPHA, EffectKind, estimate
from allanscope.explain.heldout import interleaved
from allanscope.explain.regression import joint_fit, step_ordinates
from allanscope.explain.spectral import Spectrum
from allanscope.explain.view import View

Array = NDArray[np.float64]

_PROPOSALS = 3
_EDGE_S = 5.0
"""Nearer to an end of the record a step is a start-up transient, or nothing one could tell."""
_INTERVAL_NATS = 3.68
"""Drop of the likelihood that covers the instant of a change with 95 % (Hansen 2000)."""


class Step(EffectKind):
    """A jump of the level."""

    kind = "step"
    meaning = "the level jumps once and stays"
    confused_with = {
        "random_telegraph": "comes back",
        "warm_up": "bends; a step does not",
        "temperature": "the temperature jumps with it",
    }

    def propose(self, view: View) -> Iterable[Candidate]:
        """Scan the whole record."""
        score, norm = _scan(view, view.spectrum, view.grid.low + 1)
        cells = len(score)
        edge = max(2, int(_EDGE_S * view.grid.rate_hz * cells / view.grid.n))
        statistic = np.zeros(cells)
        statistic[edge:-edge] = score[edge:-edge] ** 2 / norm[edge:-edge] / 2
        best: Candidate | None = None
        for _ in range(_PROPOSALS):
            cell = int(np.argmax(statistic))
            if statistic[cell] <= 1.0:
                break
            candidate = _candidate(view, int((cell + 0.5) * view.grid.n / cells))
            if best is None or candidate.gain > best.gain:
                best = candidate
            reach = max(edge, cells // 100)
            statistic[max(0, cell - reach) : cell + reach] = 0.0
        if best is None or best.excess < 0:
            return []
        return [_refined(view, best)]

    def refine(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate instant and size again."""
        return _refined(view, _candidate(view, int(candidate.shape[0])))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge the size by interleaved blocks."""
        column = step_ordinates(view.grid, int(candidate.shape[0]), view.grid.low)[np.newaxis]
        return interleaved(view, joint_fit(view, column), column)


def _scan(view: View, spectrum: Spectrum, size: int) -> tuple[Array, Array]:
    """Score and information of a unit step at the border of every cell (size cells)."""
    n = view.grid.n
    m = size - 1
    k = np.arange(1, m + 1)
    weight = spectrum.kept[:m] / spectrum.at(view.grid.frequency[:m])
    shape = 1 / (2 * np.sin(np.pi * k / (2 * n)))
    sines = np.zeros(size)
    sines[:m] = -np.sqrt(2 / n) * weight * view.ordinates[:m] * shape
    score = np.asarray(dst(sines, type=3)) / 2
    # The sum of q_k sin^2 is half of the sum of q_k less that of q_k cos of the double angle.
    squares = np.concatenate([[0.0], weight * shape**2])
    cosines = fft(squares * np.exp(-1j * np.pi * np.arange(size) / size)).real
    return score, np.maximum((squares.sum() - cosines) / n, 1e-300)


def _candidate(view: View, at: int) -> Candidate:
    column = step_ordinates(view.grid, at, view.grid.low)[np.newaxis]
    fit = joint_fit(view, column)
    size, error = float(fit.amplitude[0]), float(np.sqrt(fit.covariance[0, 0]))
    seconds = at / view.grid.rate_hz
    signal = np.zeros(view.grid.n)
    signal[at:] = size
    return Candidate(
        kind="step",
        parameters={
            "time": Parameter(seconds, seconds, seconds, "s"),
            "size": estimate(size, error, view.unit),
        },
        gain=fit.gain,
        price=float(np.log(view.grid.n) / 2 + np.log(view.grid.low) / 2 + np.log(1 / ALPHA)),
        signal=signal,
        shape=(float(at),),
        words=f"the level jumps by {size:.3g} {view.unit} at {seconds:.1f} s",
    )


def _refined(view: View, candidate: Candidate) -> Candidate:
    """Move the instant to the most likely sample, under the noise of the joint fit."""
    grid = view.grid
    column = step_ordinates(grid, int(candidate.shape[0]), grid.low)[np.newaxis]
    spectrum = joint_fit(view, column).spectrum
    weight = spectrum.kept / spectrum.ordinates
    white = np.concatenate([[0.0], view.ordinates * weight])
    weighted = idct(white, norm="ortho")
    score = -np.concatenate([[0.0], np.cumsum(weighted)[:-1]])
    at = int(candidate.shape[0])
    reach = int(max(20 * grid.rate_hz, 4 * grid.n / grid.low))
    low, high = max(2, at - reach), min(grid.n - 2, at + reach)
    norm = float(((column**2) * weight[: grid.low]).sum())
    profile = score[low:high] ** 2 / (2 * norm)
    best = int(np.argmax(profile))
    inside = np.flatnonzero(profile > profile[best] - _INTERVAL_NATS)
    refined = _candidate(view, low + best)
    time = Parameter(
        (low + best) / grid.rate_hz,
        (low + inside[0] - 0.5) / grid.rate_hz,
        (low + inside[-1] + 0.5) / grid.rate_hz,
        "s",
    )
    return Candidate(**{**refined.__dict__, "parameters": {**refined.parameters, "time": time}})
