"""Replace slow effects that are pieces of a drift without a name."""

from __future__ import annotations

from functools import reduce
from math import inf

import numpy as np

from allanscope.explain.candidate import SIMILAR, Candidate
from allanscope.explain.effects.unexplained import (
    DEGREE,
    RELAXATIONS,
    drift_left_over,
    relaxation_left_over,
)
from allanscope.explain.effects.warm_up import WarmUp, two_warm_ups
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["replace_drift"]

_CLEARLY = 5.0
"""Nats by which a drift without a name must be better, and a named one to take its place again."""
_EARLY = 8
"""Part of the record, one in so many, in which what begins may be a piece of a relaxation."""
_UNFINISHED = 0.3
"""Share of the gain of the named effects that a polynomial may still find behind them."""
_FEW_WAVES = 4.0
"""A slower wave may be a piece of something else."""


def replace_drift(view: View, path: SearchPath) -> View:
    """Put `unexplained` in the place of slow effects where a free polynomial does clearly better.

    A drift of any other form is fitted piecewise by exponentials and ramps; each piece is
    significant and none is true.
    """
    view = _replace_relaxation(view)
    slow = [c for c in view.accepted if c.effect.is_drift or _is_slow_wave(view, c)]
    if not slow:
        return view
    bare = view.without(*slow, *(c for c in view.accepted if c.effect.is_unnamed_drift))
    named = view.spectrum.loglik - bare.spectrum.loglik
    free, rest = drift_left_over(bare), drift_left_over(view)
    if free is None:
        return view
    # What is slow beside a drift without a name may be what the fit of that drift has left of it.
    margin = -_CLEARLY if view.drifts else _CLEARLY
    better = free.gain - DEGREE > named + margin
    unfinished = rest is not None and rest.gain > _UNFINISHED * named
    if not better and not unfinished:
        return view
    path.note("replace drift", free, "accepted")
    return bare.accept(free)


def _replace_relaxation(view: View) -> View:
    """Replace a relaxation from the start, and what began with it, where it is not one exponential.

    By two exponentials where these do clearly better, and as well as several; else by
    `unexplained` where several do.
    """
    early = [c for c in view.accepted if _begins_early(view, c)]
    known = [one.value for c in early if (one := c.effect.relaxation) is not None]
    if not known:
        return view
    tau = float(np.exp(np.mean(np.log(known))))
    bare = view.without(*early)
    free = relaxation_left_over(bare, tau)
    named = _worth(view, bare)
    if free.gain - len(RELAXATIONS) <= named:
        return view
    pair = two_warm_ups(bare)
    two = reduce(View.accept, pair, bare)
    of_two = _worth(two, bare) if pair else -inf
    if max(free.excess, of_two) <= named + _CLEARLY:
        return view
    if of_two > free.excess - SIMILAR:
        return two
    return _without_pieces(bare.accept(free), free, tau)


def _begins_early(view: View, candidate: Candidate) -> bool:
    """Return whether an effect moves the level from the start of the record, or soon after it."""
    effect = candidate.effect
    if not effect.is_piecewise:
        return isinstance(effect, WarmUp)
    at = effect.parameters.get("time")  # of a ramp there is none
    return at is None or view.row_at(float(at.value)) < view.grid.n / _EARLY


def _worth(view: View, bare: View) -> float:
    """Return what a view gains over one with less, in nats, less the price of what it has more."""
    price = sum(c.penalty for c in view.accepted) - sum(c.penalty for c in bare.accepted)
    return view.spectrum.loglik - bare.spectrum.loglik - price


def _without_pieces(view: View, free: Candidate, tau: float) -> View:
    """Drop what stood beside the one exponential only because it was not enough.

    The relaxation is fitted again without each; what is worth its price beside that was no piece.
    """
    slow = [c for c in view.accepted if c.effect.is_piecewise or _is_slow_wave(view, c)]
    for piece in sorted(slow, key=lambda c: c.excess):
        bare = view.without(piece, free)
        again = relaxation_left_over(bare, tau)
        trial = bare.accept(again)
        if view.spectrum.loglik - trial.spectrum.loglik < piece.penalty:
            view, free = trial, again
    return view


def _is_slow_wave(view: View, candidate: Candidate) -> bool:
    return candidate.effect.waves(view) < _FEW_WAVES
