"""Replace slow effects that are pieces of a drift without a name."""

from __future__ import annotations

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.unexplained import (
    DEGREE,
    RELAXATIONS,
    drift_left_over,
    relaxation_left_over,
)
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["replace_drift"]

_CLEARLY = 5.0
"""Nats by which a drift without a name must be better, and a named one to take its place again."""
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
    """Replace a warm-up by `unexplained` where several exponentials do clearly better than one."""
    known = ((c, c.effect.relaxation_s) for c in view.accepted)
    warm, tau = next(((c, tau) for c, tau in known if tau is not None), (None, 0.0))
    if warm is None:
        return view
    bare = view.without(warm)
    free = relaxation_left_over(bare, tau)
    named = view.spectrum.loglik - bare.spectrum.loglik
    better = free.gain - len(RELAXATIONS) > named + _CLEARLY
    return _without_pieces(bare.accept(free), free, tau) if better else view


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
