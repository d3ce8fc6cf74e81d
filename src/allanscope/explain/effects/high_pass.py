r"""A high-pass: the level, and whatever is slow, was taken away before the record was made.

A phone's linear acceleration is without gravity, which an exponential average followed; a logger
may couple by a capacitor, or subtract a running mean. All of it is
:math:`|H|^2 = 1 / (1 + (f_c / f)^{2p})` on the noise. No noise of a sensor's rate falls towards low
frequencies, so it shows as a deficit of the lowest ordinates against the white noise; the Allan
deviation falls faster than :math:`\tau^{-1/2}` beyond :math:`1 / 2 \pi f_c`, and what it reads at
1 s is no longer N. B and K are known as far as they stand out above the corner. A random walk
behind one has the spectrum of white noise behind a low-pass, and is flat with a shoulder beside
white noise, so at the corner the white noise must be the larger by far.

An average that begins with the first sample has the noise of this one sample, and forgets it with
its time constant: :math:`a\, e^{-2 \pi f_c t}` is left in the record, which fills the lowest
ordinates again. So both are fitted, a filter that has run for long and one that begins with the
record, the amplitude of the exponential together with the noise. What the exponential gains by
itself is no evidence of a filter, and is taken off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.narrowband import ordinate_correlation
from allanscope.explain.heldout import halves
from allanscope.explain.regression import (
    Regression,
    joint_fit,
    reach_at_95,
    relaxing_ordinates,
)
from allanscope.explain.residual import removes
from allanscope.explain.view import View
from allanscope.median import median
from allanscope.noise.components import AngleQuantization, FlickerPhase
from allanscope.noise.filters import HighPass as Filter
from allanscope.optimise import minimise, minimise_between
from allanscope.quantities import CHI_SQUARE_MEDIAN

Array = NDArray[np.float64]

_FEWEST = 8
"""Ordinates below the corner, which must lie low: what is subtracted takes along a few."""
_LOW = 0.5
"""Most of the white noise that is left of them on average."""
_HIGHEST = 0.2
"""Highest corner, as a share of the rate: beyond, it is the shape of the white noise."""
_SLOPES = (1.0, 6.0)
"""Of the filter: none is of less than the first order."""
_LARGER = 8.0
"""Times that the density of white noise is larger at the corner than what rises towards 0."""
_TRIED = 8
"""Corners tried first."""
_ONE_MORE = 1.0
"""Nats that a number more must gain: the amplitude of what a filter begins with."""
_SCALE, _TURN = 0.15, 0.7
"""Of ln corner, with which the search for the ends of its interval begins, and how far ln slope
goes along."""


@dataclass(frozen=True)
class HighPass(EffectKind):
    """A high-pass."""

    corner: Estimate
    slope: float | None = None

    kind = "high_pass"
    meaning = "a high-pass takes away the level and what is slow"
    phrase = "high-pass at {corner}"
    as_cause = "a high-pass at {corner} Hz"
    is_counted = True
    is_single = True
    is_process = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "band_limit": "takes away the top of the band",
        "gauss_markov": "adds at low frequencies",
        "Q": "the noise rises up to the Nyquist frequency, not to a corner",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return f"a high-pass with a corner of {self.corner.value:.3g} Hz takes away what is slower"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Fit corner and slope, if the lowest ordinates lack power at all."""
        if view.drifts or not _lacks(view):
            return []
        lowest = view.grid.rate_hz * _FEWEST / (2 * view.grid.n)
        highest = _HIGHEST * view.grid.rate_hz
        if highest < 2 * lowest:
            return []
        found = _likeliest(view, np.geomspace(lowest, highest, _TRIED).tolist(), lowest)
        if found is None:
            return []
        # Noise of the angle rises all the way up, and is one of the textbook's.
        phase = max(view.loglik_with(one(1.0)) for one in (FlickerPhase, AngleQuantization))
        if found.gain <= phase - view.spectrum.loglik:
            return []
        # Where a part of the record is much louder than the rest, neighbours lack power together.
        return [replace(found, gain=found.gain / ordinate_correlation(view.data))]

    def refine(self, view: View) -> Candidate | None:
        """Estimate the corner again."""
        return _likeliest(view, [self.corner.value], self.corner.value / 10)

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return it where it removes its part of the residual."""
        return candidate if removes(_settled(view, candidate), candidate) else None

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Fit it on one half of the record, without its start, and judge it on the other."""
        return halves(_settled(view, candidate), candidate)


def _lacks(view: View) -> bool:
    """Return whether the lowest ordinates hold less than the noise that is white beyond them.

    Less than the model has there, and than most others hold: lines that are not yet explained raise
    the model. What a filter begins with is nearly the same in all of them.
    """
    usual = median(view.squares) / CHI_SQUARE_MEDIAN
    level = np.minimum(view.spectrum.first(_FEWEST), usual)
    white = view.ordinates[:_FEWEST] / np.sqrt(level)
    return bool(min(np.mean(white**2), np.var(white, ddof=1)) < _LOW)


def _settled(view: View, candidate: Candidate) -> View:
    """Return the view without what the filter began with."""
    return view if candidate.signal is None else view.accept(replace(candidate, parts=()))


def _likeliest(view: View, corners: list[float], lowest: float) -> Candidate | None:
    """Return a high-pass that has run for long, or one that begins with the record."""
    running = _fitted(view, corners, lowest, begins=False)
    begun = _fitted(view, corners, lowest, begins=True)
    if running is None or (begun is not None and begun.gain > running.gain + _ONE_MORE):
        return begun
    return running


def _fitted(view: View, corners: list[float], lowest: float, *, begins: bool) -> Candidate | None:
    low, high = np.log([lowest, _HIGHEST * view.grid.rate_hz])
    length_s = view.grid.n / view.grid.rate_hz

    def at(point: Array) -> Filter:
        corner, slope = np.exp(point).tolist()
        return Filter(corner, slope, length_s)

    def column(one: Filter) -> Array:
        return relaxing_ordinates(view.grid, 0, 1 / (2 * np.pi * one.corner), view.grid.low)

    def with_start(one: Filter) -> Regression:
        return joint_fit(view, column(one), filters=(one,))

    def lost(point: Array) -> float:
        if begins:
            return -with_start(at(point)).gain - view.spectrum.loglik
        return -view.loglik_with(at(point))

    def loss(point: Array) -> float:
        if not (low <= point[0] <= high and _SLOPES[0] <= np.exp(point[1]) <= _SLOPES[1]):
            return 1e12
        return lost(point)

    first = min((np.array([np.log(one), 0.05]) for one in corners), key=loss)
    found = minimise(loss, first, 0.15 * np.eye(2), x_within=1e-3, within=1e-3, turns=80)
    if found.value >= 1e12:
        return None
    high_pass = at(found.x)
    begun = with_start(high_pass) if begins else None
    noise = (begun.spectrum if begun is not None else view.spectrum_with(high_pass)).model
    slow = noise.value("B") ** 2 / (2 * np.pi * high_pass.corner)
    slow += (noise.value("K") / (2 * np.pi * high_pass.corner)) ** 2
    if noise.value("N") ** 2 < _LARGER * slow:
        return None
    corner = _interval(lost, found.x, found.value)
    gain, signal = -found.value - view.spectrum.loglik, None
    if begun is not None:
        gain -= max(joint_fit(view, column(high_pass)).gain, 0.0)
        t = np.arange(view.grid.n) / view.grid.rate_hz
        signal = begun.amplitude[0] * np.exp(-2 * np.pi * high_pass.corner * t)
    effect = HighPass(corner, high_pass.slope)
    return Candidate(effect, gain, float(np.log(_TRIED)), signal=signal, parts=(high_pass,))


def _interval(lost: Callable[[Array], float], at: Array, least: float) -> Estimate:
    """Return the corner with where the likelihood, all else refitted, has dropped as 95 % allow.

    Towards the end of the record few ordinates are left below a corner: it is no parabola.
    """
    slopes = [float(np.log(one)) for one in _SLOPES]

    def drop(side: float, distance: float) -> float:
        x = at[0] + side * distance * _SCALE
        low, high = max(at[1] - _TURN, slopes[0]), min(at[1] + _TURN, slopes[1])
        return minimise_between(lambda y: lost(np.array([x, y])), low, high, within=0.02)[1] - least

    lower, upper = (
        float(np.exp(at[0] + side * _SCALE * reach_at_95(partial(drop, side))))
        for side in (-1.0, 1.0)
    )
    return Estimate(float(np.exp(at[0])), lower, upper, "Hz")
