"""Drop effects that later ones have made superfluous or take over, or that have no size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import ResidualError, SearchStep
from allanscope.explain.effects.unexplained import relaxation_left_over
from allanscope.explain.gates import growth, is_measured
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves.refit import estimate_again, refit
from allanscope.explain.moves.settle import settle
from allanscope.explain.regression import refit_jointly
from allanscope.explain.view import View

__all__ = ["drop", "drop_taken_over", "refuse"]

_BEYOND_DOUBT = 1000.0
"""Gain in nats that no error of a curve outweighs, unless another effect gains the same."""
_MOST_REFUSED, _SUSPECTS, _CERTAIN = 2, 3, 6
"""Most effects that are refused after all, and how many of small and of large gain are tried each
time: each is a fit."""
_FAR, _LEAST = 10.0, 3.0
"""How many times what an estimate of the others has gained, or so many nats, may be missing after
it for the next: that gains less."""
_BY_CHANCE = np.log(1.25)
"""Logarithm of the growth of an error that outweighs no gain beyond doubt: the rms of few averaging
times is so large once in some thousand axes, a jump that is seen is there."""
_PLAIN = 50.0
"""Gain in nats of a relaxation that anyone sees."""
_MENDS = 0.5
"""Part of the growth of the error that may be left for the next."""
_ABSURD = np.log(100.0)
"""Logarithm of the growth of an error that no gain outweighs: a model that does it is of other data
than these, of rows that are no samples for one, and so is the likelihood that its parts gain."""


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


def drop_taken_over(view: View, path: SearchPath) -> View:
    """Return the view without processes that the others take over once they are estimated again.

    The first is fitted to the sum, and the next to what that leaves: a low-pass beside correlated
    noise that has half of its bend. Where each stays as it is both gain; what gains more than its
    penalty when the others move as well is no stopgap. A textbook coefficient stays:
    it is what named effects are compared with.
    """
    # Of each effect, in the order of the view: what is below 0 is yet to be looked at.
    loss = [-np.inf if _may_be_taken_over(c) else np.inf for c in view.accepted]
    while sum(one < np.inf for one in loss) > 1:
        trials = {
            i: _taken_over(view, view.accepted[i], path) for i, one in enumerate(loss) if one < 0
        }
        for i, bare in trials.items():
            loss[i] = _loss(view, bare, view.accepted[i])
        taken = int(np.argmin(loss))
        if path.is_spent or loss[taken] >= 0:
            break
        dropped = view.accepted[taken]
        path.drop(dropped)
        view = refit(trials[taken], path)
        # The others can do no more without it: each is missed as before, less what this one gained.
        gained = max(loss.pop(taken) + dropped.penalty, 0.0)
        loss = [one - gained for one in loss]
    return view


def _may_be_taken_over(candidate: Candidate) -> bool:
    effect = candidate.effect
    return effect.is_process and effect.stage == 2 and not effect.is_coefficient


def _taken_over(view: View, candidate: Candidate, path: SearchPath) -> View:
    """Return the view without an effect, and with the others where they can take it over."""
    bare = view.without(candidate)
    again = partial(estimate_again, path=path)
    moves: tuple[Callable[[View], View], ...] = (partial(settle, forms=False), settle, again, again)
    for move in moves:
        before, bare = bare, move(bare)
        if bare is before:  # one alone settles by itself
            continue
        gained = bare.spectrum.loglik - before.spectrum.loglik
        missing = _missing(view, bare, candidate)
        if missing < 0 or missing > _FAR * max(gained, _LEAST):
            break
    return bare


def _loss(view: View, bare: View, candidate: Candidate) -> float:
    """Return by how much less likely a view is without an effect, over the penalty of that."""
    if not all(map(is_measured, bare.accepted)):
        return np.inf
    return _missing(view, bare, candidate)


def _missing(view: View, bare: View, candidate: Candidate) -> float:
    """Return the same whether what is left is measured or not."""
    return view.spectrum.loglik - bare.spectrum.loglik - candidate.penalty


def refuse(
    view: View,
    before: ResidualError,
    after: ResidualError,
    error: Callable[[View], ResidualError],
) -> View:
    """Return the view without effects that make the error larger than it was before the search.

    The view as it was where no one or two of those that gain least mend it: then the error has
    grown because the sampling error of the better model is smaller, and all are what they are.
    What gains beyond doubt goes only where an error has grown clearly, and is no larger without it,
    neither than before nor than with it: a line that is described twice, or a range that took the
    noise along. Of a model with an absurd error nothing is kept.

    Parameters
    ----------
    before, after : ResidualError
        Of the textbook model, and of the final model of this view.
    error : callable
        Returns that of another view.
    """
    left, now = view, after
    _, why = growth(before, after)
    for _ in range(_MOST_REFUSED):
        if not why:
            break
        trials = [(c, error(_without(left, c))) for c in _suspects(left)]
        mended = [(growth(before, e), c, e) for c, e in trials if _mends(c, before, now, e)]
        if not mended:
            break
        (_, words), refused, now = min(mended, key=lambda one: one[0][0])
        left, why = _refused(left, refused, why), words
    if why and growth(before, now)[0] > _ABSURD:
        for candidate in _acting(left):
            left = _refused(left, candidate, why)
        return left
    return view if why else left


def _refused(view: View, candidate: Candidate, why: str) -> View:
    """Return the view without an effect, and with the reason among what was tried."""
    known = candidate.kind, candidate.words, candidate.gain, candidate.penalty
    step = SearchStep("drop", *known, why)
    return replace(_without(view, candidate), path=(*view.path, step))


def _acting(view: View) -> list[Candidate]:
    """Return what was accepted and changes the model, by its gain."""
    acting = [c for c in view.accepted if c.changes_model and not c.effect.is_coefficient]
    return sorted(acting, key=lambda c: c.gain)


def _suspects(view: View) -> list[Candidate]:
    """Return what is tried: a few of small gain, and the largest, both by their gain."""
    acting = _acting(view)
    small = [c for c in acting if c.gain < _BEYOND_DOUBT]
    return small[:_SUSPECTS] + acting[len(small) :][-_CERTAIN:]


def _mends(refused: Candidate, before: ResidualError, now: ResidualError, e: ResidualError) -> bool:
    """Return whether the error that is left without an effect is little enough to refuse it."""
    grown, (left, why) = growth(before, now)[0], growth(before, e)
    if refused.gain < _BEYOND_DOUBT or grown > _ABSURD:
        return left <= _MENDS * grown
    return grown > _BY_CHANCE and not why and not growth(now, e)[1]


def _without(view: View, candidate: Candidate) -> View:
    """Return the view without an effect; what has no name leaves the model alone, and is told.

    So is a relaxation that is plain to see: only what it is has been refuted.

    The other changes of the level were fitted beside it, perhaps to make up for it: they are
    fitted again, and those that gain nothing by themselves go with it.
    """
    bare = view.without(candidate)
    if candidate.effect.columns(view) is not None:
        bare = refit_jointly(bare, fewest=1)
        slow = (c for c in bare.accepted if c.effect.columns(bare) is not None)
        bare = bare.without(*(c for c in slow if c.gain < c.penalty))
    told, tau = candidate, candidate.effect.relaxation
    if tau is not None and candidate.gain > _PLAIN:
        told = relaxation_left_over(bare, tau.value)
    elif candidate.effect.is_named:
        return bare
    return bare.accept(replace(told, parts=(), excluded=(), signal=None, profiles=()))
