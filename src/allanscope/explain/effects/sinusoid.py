r"""A line: hum, a pump, a fan, an alias, a mechanical oscillation that never changes.

Spotted as the largest ordinate of the periodogram (zero-padded once) over the local level: with n
samples about 0.75 n frequencies are looked at, so a line needs a gain of ln(0.75 n / alpha) nats.
Below some tens of cycles per record the periodogram leaks and the level is not local: there cosine
and sine are fitted by GLS with the noise refitted. Amplitude and frequency follow by least squares,

.. math:: sd(A) = \sqrt{S_1/T}, \qquad sd(f) = \sqrt{3 S_1/T} / (\pi A T)

with the one-sided density S_1 beside the line. It enters the model as a signal that is subtracted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.ndimage import minimum_filter1d
from scipy.optimize import minimize_scalar

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effects.base import ALPHA, EffectKind, estimate, is_near, rescaled
from allanscope.explain.heldout import interleaved_signal
from allanscope.explain.regression import Regression, joint_fit
from allanscope.explain.tones import constancy, local_level
from allanscope.explain.view import View
from allanscope.noise.grid import Grid

Array = NDArray[np.float64]

_FEWEST_CYCLES = 3.0
_SLOW_CYCLES = 40.0
"""Below this many cycles per record the level around a line must come from the model."""
_PROPOSALS = 3
_MARGIN = 8
"""Ordinates beside an excluded range into which what was excluded leaks."""


class Sinusoid(EffectKind):
    """A line in the spectrum."""

    kind = "sinusoid"
    meaning = "a tone of constant amplitude and frequency"
    located_by = "frequency"
    is_shared = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "narrowband": "a line is one bin wide however long the record is",
        "unexplained": "a chirp or a modulated tone changes between parts of the record",
    }

    def is_same(self, first: Candidate, second: Candidate, grid: Grid) -> bool:
        """Tell whether two candidates are one hypothesis."""
        return is_near(first, second, grid.rate_hz / grid.n)

    def propose(self, view: View) -> Iterable[Candidate]:
        """Look at every frequency from three cycles per record to Nyquist."""
        yield from (self._at(view, f) for f in _fast_lines(view))
        yield from (self._at(view, f) for f in _slow_lines(view))

    def refine(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate frequency, amplitude and phase again."""
        return self._at(view, candidate.shape[0])

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate it again: no phase is known well enough to be good for twice the time."""
        rate = view.grid.rate_hz
        f = candidate.shape[0] % rate
        f = min(f, rate - f)  # where longer rows show it
        if f * view.series.duration_s < _FEWEST_CYCLES:
            return replace(candidate, signal=None)
        return self._at(view, f)

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge amplitude and phase by interleaved blocks."""
        return interleaved_signal(view, _pair(view, candidate.shape[0]), candidate.gain)

    def columns(self, view: View, candidate: Candidate) -> Array | None:
        """Return the ordinates of cosine and sine of a slow line."""
        frequency = candidate.shape[0]
        slow = frequency * view.series.duration_s < _SLOW_CYCLES
        return _slow_pair(view.grid, frequency) if slow else None

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the amplitude and phase that a joint regression found."""
        size, error = float(np.hypot(*amplitude)), float(np.sqrt(np.trace(covariance) / 2))
        again = rescaled(candidate, "amplitude", size, error)
        return replace(again, signal=amplitude @ _pair(view, candidate.shape[0]))

    def _at(self, view: View, frequency: float) -> Candidate:
        n, rate = view.grid.n, view.grid.rate_hz
        duration = n / rate
        frequency = _peak(view.data, rate, frequency, 0.75 / duration)
        slow = frequency * duration < _SLOW_CYCLES
        pair = _pair(view, frequency)
        if slow:
            frequency, fit = _slow_fit(view, frequency)
            pair = _pair(view, frequency)
            gain, amplitudes = fit.gain, fit.amplitude
            error = float(np.sqrt(np.trace(fit.covariance) / 2))
        else:
            normal = pair @ pair.T
            amplitudes = np.linalg.solve(normal, pair @ (view.data - view.data.mean()))
            level = max(
                local_level(view, frequency), float(view.spectrum.at(np.array([frequency]))[0])
            )
            gain = float(amplitudes @ normal @ amplitudes / (2 * level))
            error = float(np.sqrt(2 * level / n))
        amplitude = float(np.hypot(*amplitudes))
        sd_frequency = np.sqrt(3.0) * error / (np.pi * amplitude * duration)
        looked_at = 0.75 * n
        return Candidate(
            kind=self.kind,
            parameters={
                "frequency": estimate(frequency, sd_frequency, "Hz"),
                "amplitude": estimate(amplitude, error, view.unit),
            },
            gain=gain,
            price=float(np.log(looked_at / ALPHA)),
            signal=amplitudes @ pair,
            shape=(frequency,),
            words=f"a line at {frequency:.6g} Hz stands {gain:.0f} nats above the noise around it",
            evidence={"constancy_p": constancy(view.data, rate, frequency)},
        )


def _fast_lines(view: View) -> list[float]:
    n, rate = view.grid.n, view.grid.rate_hz
    size = next_fast_len(2 * n, real=True)
    power = np.abs(rfft(view.data - view.data.mean(), size)) ** 2 / n
    frequency = np.arange(len(power)) * rate / size
    lowest = int(_SLOW_CYCLES * size / n) + 1
    open_ = minimum_filter1d(view.spectrum.kept, 2 * _MARGIN + 1)
    inside = open_[np.clip((frequency * 2 * n / rate).astype(int) - 1, 0, n - 2)]
    # A resonance in the model is narrower than the blocks of the running level.
    level = np.maximum(running_level(power, lowest), view.spectrum.at(frequency[lowest:]))
    ratio = np.where(inside[lowest:], power[lowest:] / level, 0.0)
    found = []
    for _ in range(_PROPOSALS):
        best = int(np.argmax(ratio))
        gain = float(ratio[best])
        if gain < np.log(0.75 * n / ALPHA):
            break
        found.append(float(frequency[best + lowest]))
        ratio[max(0, best - 12) : best + 12] = 0.0
    return found


def running_level(power: Array, lowest: int, block: int = 512) -> Array:
    """Local mean of a periodogram from medians over blocks, which a line does not move."""
    tail = power[lowest:]
    edges = np.unique(
        np.concatenate(
            [np.arange(0, min(len(tail), 16 * 64), 64), np.arange(16 * 64, len(tail), 2 * block)]
        )
    )
    edges = (
        np.append(edges[:-1], len(tail))
        if len(tail) - edges[-1] < 64
        else np.append(edges, len(tail))
    )
    medians = np.array([np.median(tail[a:b]) for a, b in pairwise(edges)])
    centres = 0.5 * (edges[:-1] + edges[1:])
    medians = np.maximum(medians, 1e-300) / np.log(2)
    return np.asarray(np.exp(np.interp(np.arange(len(tail)), centres, np.log(medians))))


def _slow_lines(view: View) -> list[float]:
    """Frequencies of few cycles, scanned by GLS under the null's noise, then refitted."""
    n, rate = view.grid.n, view.grid.rate_hz
    duration = n / rate
    cycles = np.arange(_FEWEST_CYCLES, _SLOW_CYCLES, 0.25)
    m = view.grid.low
    weight = view.spectrum.kept[:m] / view.spectrum.first(m)
    d = view.ordinates[:m]
    scores = []
    for c in cycles:
        pair = _slow_pair(view.grid, c / duration)
        normal = (pair * weight) @ pair.T
        right = (pair * weight) @ d
        scores.append(0.5 * float(right @ np.linalg.pinv(normal, hermitian=True) @ right))
    order = np.argsort(scores)[::-1]
    price = np.log(0.75 * n / ALPHA)
    found = []
    for index in order[:2]:
        if scores[index] > 0.35 * price:
            frequency = float(cycles[index] / duration)
            fit = joint_fit(view, _slow_pair(view.grid, frequency))
            if fit.gain > 0.6 * price:
                found.append(frequency)
    return found[:1]


def _slow_fit(view: View, frequency: float) -> tuple[float, Regression]:
    duration = view.grid.n / view.grid.rate_hz
    spread, lowest = 0.5 / duration, _FEWEST_CYCLES * 0.9 / duration
    frequency = max(frequency, lowest)  # a slower drift draws it down, a little with every fit

    def loss(f: float) -> float:
        return -joint_fit(view, _slow_pair(view.grid, f), rounds=4).gain

    bounds = (max(frequency - spread, lowest), frequency + spread)
    best = minimize_scalar(
        loss, bounds=bounds, method="bounded", options={"xatol": 0.01 / duration}
    )
    return float(best.x), joint_fit(view, _slow_pair(view.grid, float(best.x)))


@lru_cache(maxsize=256)  # every scan goes through the same frequencies
def _slow_pair(grid: Grid, frequency: float) -> Array:
    """First ordinates of cosine and sine in closed form.

    The wave times the cosine of ordinate k is the sum of two geometric series, of n terms and the
    ratios exp(i (w + a)) and exp(i (w - a)), a = pi k / n; exp(i n a) is 1 or -1.
    """
    n, m = grid.n, grid.low
    k = np.arange(1, m + 1)
    half = np.pi * k / (2 * n)
    w = 2 * np.pi * frequency / grid.rate_hz
    below = np.sin(w / 2 - half)
    met = np.abs(below) < 1e-12
    poles = 1 / np.sin(w / 2 + half) + 1 / np.where(met, 1.0, below)
    end = np.exp(1j * w * n)
    total = 0.25j * np.exp(-0.5j * w) * np.where(k % 2, 1 + end, 1 - end) * poles
    total[met] = 0.5 * n * np.exp(-1j * half[met])
    total *= np.sqrt(2 / n)
    return np.vstack([total.real, total.imag])


def _pair(view: View, frequency: float) -> Array:
    phase = 2 * np.pi * frequency / view.grid.rate_hz * np.arange(view.grid.n)
    pair = np.vstack([np.cos(phase), np.sin(phase)])
    return np.asarray(pair - pair.mean(axis=1, keepdims=True))


def _peak(data: Array, rate: float, frequency: float, spread: float) -> float:
    """Maximise the periodogram near a frequency, on data reduced to a narrow band around it."""
    n = len(data)
    t = np.arange(n) / rate
    mixed = (data - data.mean()) * np.exp(-2j * np.pi * frequency * t)
    hop = max(1, n // 4096)
    whole = n // hop * hop
    slow = mixed[:whole].reshape(-1, hop).sum(axis=1)
    at = (np.arange(len(slow)) + 0.5) * hop / rate

    def loss(offset: float) -> float:
        return -float(abs(np.sum(slow * np.exp(-2j * np.pi * offset * at))))

    best = minimize_scalar(loss, bounds=(-spread, spread), method="bounded",
                           options={"xatol": 1e-4 * spread})  # fmt: skip
    return frequency + float(best.x)
