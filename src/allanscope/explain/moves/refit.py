"""Estimate every effect again, given the others."""

from __future__ import annotations

from dataclasses import replace

from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["refit"]


def refit(view: View, path: SearchPath) -> View:
    """Return the view with every effect of the spectrum and the level estimated again."""
    if len([c for c in view.accepted if c.effect.stage == 2 or c.effect.is_unnamed_drift]) < 2:
        return view
    for candidate in view.accepted:
        if candidate.effect.stage != 2 or candidate.profile is not None:
            continue  # a profile was measured, not fitted
        path.evaluations += 1
        bare = view.without(candidate)
        again = candidate.effect.refine(bare) or candidate
        again = replace(again, held_out=candidate.held_out, rivals=candidate.rivals)
        grown = bare.accept(again)
        order = [again if c is candidate else c for c in view.accepted]
        view = replace(grown, accepted=tuple(order))
    return view
