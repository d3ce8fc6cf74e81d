"""Estimate every effect again, given the others."""

from __future__ import annotations

from dataclasses import replace

from allanscope.explain.candidate import SIMILAR, Candidate
from allanscope.explain.gates import is_measured
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves.settle import settle, was_measured
from allanscope.explain.view import View

__all__ = ["estimate_again", "refit"]


def refit(view: View, path: SearchPath) -> View:
    """Return the view with every effect estimated again, where there are others beside it."""
    if len([c for c in view.accepted if c.effect.stage == 2 or c.effect.is_unnamed_drift]) < 2:
        return view
    return estimate_again(settle(view), path)


def estimate_again(view: View, path: SearchPath) -> View:
    """Return the view with every effect of the spectrum and the level estimated again, in turn."""
    for candidate in view.accepted:
        if candidate.effect.stage != 2 or was_measured(candidate):
            continue
        path.evaluations += 1
        bare = view.without(candidate)
        again = (candidate.effect.refine(bare) or candidate).finished()
        if _is_less_likely(bare, again, candidate):
            again = candidate  # it has ended beside the maximum
        if is_measured(candidate) and not is_measured(again):
            again = candidate  # without intervals it would be dropped, and found again as it was
        again = replace(again, held_out=candidate.held_out, rivals=candidate.rivals)
        grown = bare.accept(again)
        order = [again if c is candidate else c for c in view.accepted]
        view = grown.relisted(order)
    return view


def _is_less_likely(bare: View, again: Candidate, former: Candidate) -> bool:
    """Return whether a process is clearly less likely than it was before it was fitted again."""
    if again is former or former.signal is not None:
        return False
    return bare.loglik_with(*again.parts) < bare.loglik_with(*former.parts) - SIMILAR
