"""Add resonances that lie side by side: alone, the first is fitted to all of them, and is refused.

What is accepted in its place is none of them: a low-pass with its cutoff at the end of the last, or
a range without a name. So the next bands, and a low-pass, are looked for beside it, all are
estimated again until that gains nothing, and each is judged beside the others. A tone that comes
and goes does so whatever is beside it: then no more are looked for. Nor are they looked for again
for the same band before anything but a slow effect was accepted.
"""

from __future__ import annotations

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.band_limit import BandLimit
from allanscope.explain.effects.narrowband import Narrowband
from allanscope.explain.gates import judge_as_named, penalty_passed
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves.add import lines_that_hold, proposals
from allanscope.explain.moves.refit import estimate_again
from allanscope.explain.moves.settle import settle
from allanscope.explain.view import View

__all__ = ["add_bands"]

_MOST, _EVALUATIONS = 8, 60
"""Most effects that are added together, and evaluations after which no more are looked for."""
_ROUNDS, _CLOSE, _MOST_OF_IT = 6, 3.0, 0.03
"""Most turns in which they are estimated again; nats, and the part of what all turns have gained,
that another must gain."""


def add_bands(view: View, candidates: list[Candidate], path: SearchPath) -> View | None:
    """Return the view with several bands, or None where one alone is what it seems or none is."""
    bands = [c for c in candidates if isinstance(c.effect, Narrowband)]
    band = max(bands, key=_excess, default=None)
    if band is None or not penalty_passed(view, band, path.spent):
        return None
    fast = sum(not c.effect.is_slow for c in view.accepted)
    if path.was_refused(band, fast, view.grid):
        return None
    if lines_that_hold(band, candidates) or judge_as_named(view, band.finished())[0]:
        return None
    group = _group(view, band, candidates, path)
    if group is None:
        path.refuse(band, fast)
    return group


def _group(
    view: View, band: Candidate, candidates: list[Candidate], path: SearchPath
) -> View | None:
    """Return the view with a band and what has to be beside it for it to hold, or None."""
    first = len(view.accepted)
    low_passes = (c for c in candidates if isinstance(c.effect, BandLimit))
    trial = view.accept(max((*low_passes, band), key=_excess).finished())
    most = path.evaluations + _EVALUATIONS
    outcome: View | Candidate = trial.accepted[first]
    with_room = settle(trial, forms=False)  # that others make for it
    if with_room.spectrum.loglik > trial.spectrum.loglik + _CLOSE:
        trial = _settled(trial, path)
        outcome = _accepted(trial, first, path)
    while isinstance(outcome, Candidate):
        is_full = len(trial.accepted) - first >= _MOST or path.evaluations >= most
        if is_full or path.is_spent or not _may_hold(trial, first, outcome):
            return None
        kinds = [kind for kind in (Narrowband, BandLimit) if kind.has_place(trial)]
        beside = max(proposals(trial, kinds, path), key=_excess, default=None)
        if beside is None or not penalty_passed(trial, beside, path.spent):
            return None
        trial = _settled(trial.accept(beside.finished()), path)
        outcome = _accepted(trial, first, path)
    return outcome


def _excess(candidate: Candidate) -> float:
    return candidate.excess


def _settled(view: View, path: SearchPath) -> View:
    """Return the view with every effect where it is likeliest beside the others."""
    first = view.spectrum.loglik
    for _ in range(_ROUNDS):
        before = view.spectrum.loglik
        view = estimate_again(settle(view), path)
        gained = view.spectrum.loglik - before
        if gained < max(_CLOSE, _MOST_OF_IT * (view.spectrum.loglik - first)):
            break
    return view


def _may_hold(trial: View, first: int, refused: Candidate) -> bool:
    """Return whether others could make what was refused hold: they change no noise in time."""
    bands = (c.effect for c in trial.accepted[first:] if isinstance(c.effect, Narrowband))
    if not all(band.lasts(trial) for band in bands):
        return False
    effect = refused.effect
    return not isinstance(effect, Narrowband) or effect.may_hold(trial.without(refused), refused)


def _accepted(trial: View, first: int, path: SearchPath) -> View | Candidate:
    """Return the view with all effects from the first on as they pass the gates beside each other.

    Or the first that does not.
    """
    judged: list[Candidate] = []
    for member in trial.accepted[first:]:
        passed, _ = judge_as_named(trial.without(member), member)
        if passed is None:
            return member
        judged.append(passed)
    path.accept("add bands", *judged)
    return trial.relisted((*trial.accepted[:first], *judged))
