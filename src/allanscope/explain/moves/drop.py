"""Drop effects that later ones have made superfluous, or that have no size beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from allanscope.explain.effect import ResidualError, SearchStep
from allanscope.explain.gates import growth, is_measured
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["drop", "refuse"]


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

    One after the other, the one first whose removal mends most.

    Parameters
    ----------
    before, after : ResidualError
        Of the textbook model, and of the final model of this view.
    error : callable
        Returns that of another view.
    """
    worst, why = growth(before, after)
    while why:
        trials = [
            (growth(before, error(trial)), candidate, trial)
            for candidate in view.accepted
            if not candidate.effect.is_coefficient and candidate.changes_model
            for trial in (view.without(candidate),)
        ]
        if not trials:
            break
        (left, still), refused, rest = min(trials, key=lambda one: one[0][0])
        if left >= worst:
            break
        step = SearchStep("drop", refused.kind, refused.words, refused.gain, refused.penalty, why)
        view, worst, why = replace(rest, path=(*view.path, step)), left, still
    return view
