"""Drop effects that later ones have made superfluous, or that have no size beside them."""

from __future__ import annotations

from allanscope.explain.gates import is_measured
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["drop"]


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
