"""Drop effects that later ones have made superfluous, or that have no size beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import ResidualError, SearchStep
from allanscope.explain.gates import growth, is_measured
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["drop", "refuse"]

_BEYOND_DOUBT = 1000.0
"""Gain in nats that no error of a curve outweighs."""
_MOST_REFUSED, _SUSPECTS = 2, 3
"""Most effects that are refused after all, and how many are tried each time: each is a fit."""
_MENDS = 0.5
"""Part of the growth of the error that may be left for the next."""


def drop(view: View, path: SearchPath) -> View:
    """Return the view without effects that, given the others, gain less than their penalty.

    The one that was accepted last has just been judged; what has no interval is dropped anyway.
    """
    last = view.accepted[-1:]
    for candidate in view.accepted:
        if candidate.effect.stage != 2:
            continue
        superfluous = candidate.gain < candidate.penalty and all(candidate is not c for c in last)
        if superfluous or not is_measured(candidate):
            view = view.without(candidate)
            path.drop(candidate)
    return view


def refuse(
    view: View,
    before: ResidualError,
    after: ResidualError,
    error: Callable[[View], ResidualError],
) -> View:
    """Return the view without effects that make the error larger than it was before the search.

    The view as it was where no one or two of those that gain least mend it: then the error has
    grown because the sampling error of the better model is smaller, and all are what they are.

    Parameters
    ----------
    before, after : ResidualError
        Of the textbook model, and of the final model of this view.
    error : callable
        Returns that of another view.
    """
    left = view
    worst, why = growth(before, after)
    for _ in range(_MOST_REFUSED):
        if not why:
            break
        suspects = [
            c
            for c in left.accepted
            if c.changes_model and not c.effect.is_coefficient and c.gain < _BEYOND_DOUBT
        ]
        suspects = sorted(suspects, key=lambda c: c.gain)[:_SUSPECTS]
        trials = [(growth(before, error(_without(left, c))), c) for c in suspects]
        if not trials:
            break
        (still, words), refused = min(trials, key=lambda one: one[0][0])
        if still > _MENDS * worst:
            break
        step = SearchStep("drop", refused.kind, refused.words, refused.gain, refused.penalty, why)
        left = replace(_without(left, refused), path=(*left.path, step))
        worst, why = still, words
    return view if why else left


def _without(view: View, candidate: Candidate) -> View:
    """Return the view without an effect; what has no name leaves the model alone, and is told."""
    bare = view.without(candidate)
    if candidate.effect.is_named:
        return bare
    return bare.accept(replace(candidate, parts=(), excluded=(), signal=None, profile=None))
