r"""The scale factor drifts: the whole signal grows or fades slowly over the record.

An amplifier that warms up, a reference that ages, a mount that works loose: :math:`y = s(t) x` with

.. math:: s(t) = 1 + c \, (t / T - 1/2),

so white and coloured noise grow together, by the same factor at every frequency. The curve and the
spectrum see the mean square alone; what they are then asked to explain is a process that comes and
goes. The data are whitened and cut into bands of frequency and blocks of time, whose mean squares
are chi-square around :math:`s^2`: c is found by maximum likelihood, the level of each band being
free. It must be the same in all bands (a tone that grows is in one), and a straight line must be
nearly all there is to it (a loud stretch has borders, and gains more by them). The rows are divided
by s, so that all that comes later is looked for in noise of one level.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.special import chdtrc

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.variance_change import (
    VarianceChange,
    best_interval,
    log_alternatives,
)
from allanscope.explain.series import block_means, in_time
from allanscope.explain.view import View
from allanscope.optimise import minimise_between

Array = NDArray[np.float64]

_BANDS, _BLOCKS, _FEWEST = 4, 48, 4.0
"""Bands, blocks, and least ordinates of a band in a block."""
_LOWEST = 1e-3
"""First ordinate that is looked at, as a share of all: below, the level drifts."""
_CAP = 20.0
"""Squares over their mean are cut here, so that a few samples cannot make a slope."""
_STEEPEST = 1.9
"""Largest change of the scale over its mean: with 2 it would begin or end at nothing."""
_STEP = 0.02
"""Of c, over which the likelihood is a parabola."""
_DISAGREE = 1e-3
"""Chance below which bands or blocks differ too much to follow one straight line."""
_BENT = 0.1
"""Share of the gain that a line which is not straight may leave."""


@dataclass(frozen=True)
class ScaleDrift(EffectKind):
    """A scale factor that changes along a straight line."""

    relative: Estimate

    kind = "scale_drift"
    meaning = "the whole signal grows or fades slowly"
    phrase = "noise level changing by {relative} over the recording"
    sized_by = "relative"
    stage = 1
    is_single = True
    excluded_by = frozenset({"quantization", "saturation"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "variance_change": "begins and ends abruptly",
        "gauss_markov": "its power comes and goes at low frequencies only",
        "unexplained": "a tone that grows is in one band",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return f"the scale changes by {100 * self.relative.value:+.3g} % over the record"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Fit one slope to the power of all bands."""
        power, freedom = _power(view)
        if len(power) < 2:
            return []
        slope, gain = _fit(power, freedom)
        own = sum(_fit(power[j : j + 1], freedom[j : j + 1])[1] for j in range(len(power)))
        agree = chdtrc(len(power) - 1, max(2 * (own - gain), 0.0)) >= _DISAGREE
        abrupt, bent = _abrupt(power, freedom), _is_bent(power, freedom, slope, gain)
        if not agree or bent or abrupt - log_alternatives(_BLOCKS) > gain:
            return []
        found = _candidate(view, power, freedom, slope, gain)
        return [replace(found, rivals={VarianceChange.kind: abrupt})]

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Fit the slope again: it is one of the whole record."""
        return next(iter(self.propose(view)), replace(candidate, signal=None))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Fit every second block, and judge by the blocks between."""
        del candidate
        power, freedom = _power(view)
        nats, squares = 0.0, 0.0
        for fold in (0, 1):
            train = np.arange(_BLOCKS) % 2 == fold
            slope, _ = _fit(power, freedom, train)
            gained = _gains(power, freedom, slope, train)[~train]
            nats += float(gained.sum())
            squares += len(gained) * float(gained.var())
        return HeldOut(nats, float(np.sqrt(squares)), f"interleaved blocks, {_BLOCKS} in all")


def _power(view: View) -> tuple[Array, Array]:
    """Return mean squares of bands and blocks, shape (bands, blocks), and their freedom."""
    kept, white = view.spectrum.kept, view.whitened
    n = len(white)
    edges = np.geomspace(max(1.0, _LOWEST * n), n, _BANDS + 1).astype(int)
    bands = [
        (low, high, most)
        for low, high in pairwise(edges)
        if (most := np.count_nonzero(kept[low:high]) / _BLOCKS) >= _FEWEST
    ]
    powers, freedoms = [], []
    for low, high, most in bands:
        # No more rows than tell the squares of this band, which reach twice its frequency.
        ordinates = np.zeros(min(next_fast_len(2 * high, real=True) - 1, n))
        ordinates[low:high] = white[low:high]
        squares = in_time(ordinates) ** 2
        squares = np.minimum(squares, _CAP * squares.mean())
        power = block_means(squares, _BLOCKS)
        # What neighbours differ by more than chance makes them tells less of the level.
        scatter = float(np.mean(np.diff(power / power.mean()) ** 2)) / 2
        powers.append(power)
        freedoms.append(min(2 / max(scatter, 1e-12), most))
    return np.array(powers), np.array(freedoms)


def _scale(slope: float, size: int) -> Array:
    """Return the scale at so many instants; its mean square over the record is 1."""
    u = (np.arange(size) + 0.5) / size - 0.5
    return np.asarray((1 + slope * u) / np.sqrt(1 + slope**2 / 12))


def _gains(power: Array, freedom: Array, slope: float, known: NDArray[np.bool_]) -> Array:
    """Return what every block gains by a slope; the level of a band is that of the known blocks."""
    square = _scale(slope, power.shape[1]) ** 2
    level = np.mean(power[:, known], axis=1, keepdims=True)
    scaled = np.mean(power[:, known] / square[known], axis=1, keepdims=True) * square
    nats = np.log(level) + power / level - np.log(scaled) - power / scaled
    return np.asarray(freedom @ nats / 2)


def _fit(
    power: Array, freedom: Array, known: NDArray[np.bool_] | None = None
) -> tuple[float, float]:
    """Return the likeliest slope, and what it gains over none."""
    known = np.ones(power.shape[1], np.bool_) if known is None else known
    power = power[:, known]
    level, weight = np.log(power.mean(axis=1)), freedom * power.shape[1] / 2

    def loss(slope: float) -> float:
        """Return minus the sum of `_gains`: all levels at their best, each power over its is 1."""
        square = _scale(slope, len(known))[known] ** 2
        scaled = np.log((power / square).mean(axis=1))
        return float(weight @ (scaled - level) + freedom.sum() * np.log(square).sum() / 2)

    slope, least = minimise_between(loss, -_STEEPEST, _STEEPEST, within=1e-4)
    return slope, -least


def _pooled(power: Array, freedom: Array) -> Array:
    """Return the power of the blocks over their mean, all bands together."""
    return np.asarray(freedom @ (power / power.mean(axis=1, keepdims=True)) / freedom.sum())


def _abrupt(power: Array, freedom: Array) -> float:
    """Return what the most telling stretch of another level gains."""
    return best_interval(_pooled(power, freedom), float(freedom.sum()))[0]


def _is_bent(power: Array, freedom: Array, slope: float, gain: float) -> bool:
    """Return whether the blocks, all bands together, are far from a straight line."""
    rest = _pooled(power / _scale(slope, power.shape[1]) ** 2, freedom)
    deviance = float(freedom.sum() * np.sum(rest - 1 - np.log(rest)))
    left = deviance - 2 * _BENT * gain
    return bool(chdtrc(power.shape[1] - 2, max(left, 0.0)) < _DISAGREE)


def _candidate(view: View, power: Array, freedom: Array, slope: float, gain: float) -> Candidate:
    every = np.ones(power.shape[1], np.bool_)

    def at(c: float) -> float:
        return float(_gains(power, freedom, c, every).sum())

    curvature = (2 * at(slope) - at(slope + _STEP) - at(slope - _STEP)) / _STEP**2
    error = 1 / np.sqrt(max(curvature, 1e-6))
    relative = (1 + slope / 2) / (1 - slope / 2) - 1
    effect = ScaleDrift(Estimate.of(relative, error / (1 - slope / 2) ** 2))
    data = view.data - view.data.mean()
    signal = data * (1 - 1 / _scale(slope, len(data)))
    return Candidate(effect, gain, signal=signal)
