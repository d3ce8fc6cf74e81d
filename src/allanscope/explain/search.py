"""The search: moves from hypothesis to hypothesis until none gains.

::

    for each stage: faults of the data, outliers, level and spectrum, variance, what is left over
        propose ──▶ add pair │ bands │ one │ beside │ bundle ──▶ fold, split ──▶ refit ──▶ drop ─┐
           ▲                                                                                     │
           └─────────────────────────────────────────────────────────────────────────────────────┘
        replace drift
    at the end: resolve tones ──▶ what is left over, once more ──▶ join flanks

A hypothesis is a `View`: a model with its maximised likelihood. The moves are in `moves`, what a
candidate must pass is in `gates`, and what was tried is kept in a `SearchPath`.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects import KINDS
from allanscope.explain.effects.unexplained import Unexplained, with_misfits_joined
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves.add import (
    add,
    add_beside,
    add_bundle,
    add_pair,
    proposals,
    with_rivals,
)
from allanscope.explain.moves.add_bands import add_bands
from allanscope.explain.moves.drop import drop, drop_taken_over
from allanscope.explain.moves.fold import fold_sidebands, fold_steps
from allanscope.explain.moves.give_back import give_back
from allanscope.explain.moves.join_flanks import join_flanks
from allanscope.explain.moves.refit import refit
from allanscope.explain.moves.replace_drift import replace_drift
from allanscope.explain.moves.resolve_tones import resolve_tones
from allanscope.explain.moves.split_bands import split_bands
from allanscope.explain.regression import refit_jointly, with_likely_times
from allanscope.explain.view import View

__all__ = ["Budget", "close_loop"]

_LOG = logging.getLogger(__name__)

_LEVEL_AND_SPECTRUM, _LEFT_OVER = 2, 4
"""The stage in which effects hide each other, and are fitted again with each new one."""
_STAGES = ("faults of the data", "outliers", "level and spectrum", "variance", "left over")
_FEW = 0.2
"""Part of the evaluations of that stage which each of the others has."""
_FULL = "the search was stopped at the largest number of effects for one axis; there may be more"


@dataclass(frozen=True, slots=True)
class Budget:
    """How far the loop may go.

    Attributes
    ----------
    effects : int
        Most effects on one axis.
    passes : int
        Most rounds through the stages.
    kinds : frozenset of str or None
        Only these kinds are asked; None for all.
    acceptances, evaluations : int
        Most effects that are accepted, whether they stay or not, and most fits of one kind to the
        whole record in one round through the stage of the level and the spectrum; every other stage
        has a fifth of them. A search that goes round is stopped, after a time linear in the rows.
    spent_nats : float
        What earlier looks at the same data cost, added to every price.
    """

    effects: int = 14
    passes: int = 2
    acceptances: int = 20
    evaluations: int = 600
    kinds: frozenset[str] | None = None
    spent_nats: float = 0.0


def close_loop(view: View, budget: Budget | None = None) -> View:
    """Return the view with every effect that was accepted, and the path of the search."""
    budget = budget or Budget()
    path = SearchPath(budget.acceptances, budget.spent_nats)
    settled: dict[int, View] = {}
    closed: View | None = None
    for _ in range(budget.passes):
        before = len(view.accepted)
        for stage in sorted({kind.stage for kind in KINDS.values()}):
            if stage in settled and view.is_fitted_as(settled[stage], stage):
                continue  # nothing has changed since: it would find nothing again
            view = settled[stage] = _settle(view, stage, budget, path)
            if stage == _LEVEL_AND_SPECTRUM:
                replaced = replace_drift(view, path)
                view = view if replaced is view else _fitted(replaced, path)
                if closed is None or not view.is_fitted_as(closed, stage):
                    view = closed = drop_taken_over(view, path)
        if len(view.accepted) == before or path.is_full or path.stopped:
            break
    path.enter(int(_FEW * budget.evaluations))
    resolved = resolve_tones(view, path)
    if resolved is not view:
        view = _settle(_fitted(_without_misfits(resolved), path), _LEFT_OVER, budget, path)
    view = with_likely_times(join_flanks(with_misfits_joined(view), path))
    full = len(view.accepted) >= budget.effects
    for step in path.steps:
        _LOG.debug("%s %s", view.axis, step)
    return replace(view, stopped=path.remark or _FULL * full, path=tuple(path.steps))


def _without_misfits(view: View) -> View:
    """Return the view without what did not fit in bands or in the distribution.

    That is looked at again: it may be a part of what has a name by now.
    """
    left = [
        c
        for c in view.accepted
        if isinstance(c.effect, Unexplained)
        and (c.effect.is_misfit or c.effect.shows_in_distribution)
    ]
    return view.without(*left)


def _settle(view: View, stage: int, budget: Budget, path: SearchPath) -> View:
    """Add effects of one stage until no move gains."""
    kinds = [
        kind
        for kind in KINDS.values()
        if kind.stage == stage
        and kind.available(view)
        and (budget.kinds is None or kind.kind in budget.kinds)
    ]
    main = stage == _LEVEL_AND_SPECTRUM
    former: list[Candidate] = []
    path.enter(int(budget.evaluations * (1.0 if main else _FEW)))
    while len(view.accepted) < budget.effects:
        # What is left over is reported even when the search for names was stopped.
        if path.is_spent or (path.is_full and stage <= _LEVEL_AND_SPECTRUM):
            path.stop(_STAGES[stage])
            break
        if main and (folded := fold_steps(view, path)) is not view:
            view, former = folded, []
        if former and view.accepted[-1].effect.of_the_stream:  # the data are as they were
            candidates = [c for c in former if KINDS[c.kind].has_place(view)]
        else:
            candidates = proposals(view, kinds, path)
        view = with_rivals(view, former, candidates)
        if main and (pair := add_pair(view, kinds, candidates, path)) is not None:
            view, former = _fitted(pair, path), []
        elif main and (bands := add_bands(view, candidates, path)) is not None:
            view, former = _fitted(bands, path), []
        elif (added := add(view, candidates, path, unite=main)) is not None:
            folded = fold_sidebands(added, path)
            view = split_bands(folded, path)
            former = candidates if view is folded else []
            if stage >= _LEVEL_AND_SPECTRUM:
                view = _fitted_after(view, path)
        elif main and (beside := add_beside(view, kinds, candidates, path)) is not None:
            view, former = _fitted(beside, path), []
        elif main and (bundle := add_bundle(view, kinds, candidates, path)) is not None:
            view, former = bundle, []
        else:
            break
    return view


def _fitted_after(view: View, path: SearchPath) -> View:
    """Return the view fitted again after what was accepted last, if that concerns the others."""
    given = give_back(view, path)
    concerned = given is not view or view.accepted[-1].changes_model
    return _fitted(given, path) if concerned else view


def _fitted(view: View, path: SearchPath) -> View:
    """Estimate every effect given the others, and keep those whose gain exceeds the penalty."""
    return drop(refit_jointly(refit(view, path)), path)
