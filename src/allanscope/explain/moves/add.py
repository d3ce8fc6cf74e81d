"""Moves that add: the best candidate that passes the gates, or several that pass only together.

`add_pair`: a warm-up and the temperature, each fitted alone, take along what belongs to the other,
and a slope that was found beside half a warm-up is refuted by the quarter in which the warm-up was.

`add_beside`: a low-pass that is fitted alone takes along the resonance that nobody sees before it
is there, and is refused for it.

`add_bundle`: while one of several slow effects is left out it keeps K high, and a high K hides the
others: a warm-up and three bumps of the level look like a random walk until all four are taken out.
What is looked at is paid for by every member, and each must be worth its penalty given the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from allanscope.explain.candidate import SIMILAR, Candidate
from allanscope.explain.effects import KINDS, EffectKind
from allanscope.explain.effects.unexplained import united
from allanscope.explain.gates import judge, judge_members, penalties, penalty_passed, refused
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves.refit import refit
from allanscope.explain.regression import refit_jointly
from allanscope.explain.view import View

__all__ = [
    "add",
    "add_beside",
    "add_bundle",
    "add_pair",
    "lines_that_hold",
    "proposals",
    "with_rivals",
]

_GOOD_PART = 0.3
"""Share of a band's gain that a line may have which is all there is to the band."""


def proposals(view: View, kinds: Iterable[type[EffectKind]], path: SearchPath) -> list[Candidate]:
    """Ask kinds for candidates, but for those that were taken before and dropped."""
    found = []
    for kind in kinds:
        path.evaluations += 1
        found += [c for c in kind.proposed(view) if not path.was_dropped(c, view.grid)]
    return found


def add(
    view: View, candidates: list[Candidate], path: SearchPath, *, unite: bool = False
) -> View | None:
    """Return the view with the best candidate that passes every gate; None if there is none.

    With `unite` a range without a name takes in those that it touches.
    """
    accepted = next(_judged(view, candidates, path, "add"), None)
    if accepted is None:
        return None
    path.accept("add", accepted)
    if unite:
        view, accepted = united(view, accepted)
    return view.accept(accepted)


def _judged(
    view: View, candidates: list[Candidate], path: SearchPath, move: str
) -> Iterator[Candidate]:
    """Generate the candidates that pass every gate, best first, and note why others do not."""
    for candidate in map(Candidate.finished, _ranked(candidates)):
        if not penalty_passed(view, candidate, path.spent):
            path.note(move, candidate, "penalty: the log-likelihood gain is below the penalty")
            return
        accepted, why = judge(view, candidate)
        if accepted is None:
            path.note(move, candidate, why)
        else:
            yield accepted


def _ranked(candidates: list[Candidate]) -> list[Candidate]:
    """Order candidates by what they gain beyond their penalty.

    Waves that hold a good part of the power of a band go before the band: a few lines side by side
    are lines, and so are those of a modulated tone.
    """
    ranked = sorted(candidates, key=lambda c: -c.excess)
    for band in tuple(ranked):
        if band.excess > 0:
            for line in lines_that_hold(band, ranked):
                ranked.remove(line)
                ranked.insert(ranked.index(band), line)
    return ranked


def lines_that_hold(band: Candidate, candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the waves that hold a good part of the power of a band, in their order."""
    least = _GOOD_PART * band.excess
    return [c for c in candidates if band.effect.holds(c.effect) and c.excess > least]


def with_rivals(view: View, former: list[Candidate], now: list[Candidate]) -> View:
    """Note kinds that would have done as well as the effect accepted last, and now gain nothing."""
    if not view.accepted or not former:
        return view
    last = view.accepted[-1]
    rivals = dict(last.rivals)
    for rival in former:
        is_other = rival.kind != last.kind and rival.effect.is_rival
        if not is_other or rival.gain < last.gain - SIMILAR:
            continue
        left = max((c.gain for c in now if c.kind == rival.kind), default=0.0)
        if left < 0.5 * rival.gain:
            rivals[rival.kind] = max(rival.gain, rivals.get(rival.kind, 0.0))
    if rivals == last.rivals:
        return view
    return view.relisted((*view.accepted[:-1], replace(last, rivals=rivals)))


def add_pair(
    view: View, kinds: list[type[EffectKind]], candidates: list[Candidate], path: SearchPath
) -> View | None:
    """Return the view with both, or None."""
    pair = {kind.kind for kind in KINDS.values() if kind.is_thermal}
    missing = [kind for kind in kinds if kind.is_thermal and not view.has(kind.kind)]
    promising = [c for c in candidates if c.kind in pair and c.excess > path.spent]
    known = pair - {kind.kind for kind in missing}
    if not missing or not promising or not all(view.has(kind) for kind in known):
        return None
    first = len(view.accepted)
    trial = view.accept(max(promising, key=lambda c: c.excess))
    rest = [kind for kind in missing if not trial.has(kind.kind)]
    for candidate in proposals(trial, rest, path):
        trial = trial.accept(candidate)
    if not all(trial.has(kind) for kind in pair):
        return None
    trial = refit_jointly(trial)
    members = tuple(c for c in trial.accepted if c.kind in pair)
    excess = trial.spectrum.loglik - view.spectrum.loglik - path.spent - penalties(trial, first)
    others = max((c.excess for c in candidates if c.kind not in pair), default=0.0)
    if excess <= max(0.0, others - path.spent) or any(c.excess <= path.spent for c in members):
        return None
    judged = judge_members(trial, members)
    if judged is not None:
        path.accept("add pair", *judged.accepted[first:])
    return judged


_REFUSED = 2
"""So many of the best that were refused are tried beside what is found once they are there."""


def add_beside(
    view: View, kinds: list[type[EffectKind]], candidates: list[Candidate], path: SearchPath
) -> View | None:
    """Return the view with a process that was refused and what had hidden what it is, or None."""
    fast = [kind for kind in kinds if not kind.is_slow]
    refused = [
        c
        for c in _ranked(candidates)
        if c.effect.is_process and type(c.effect) in fast and penalty_passed(view, c, path.spent)
    ]
    move = "add beside"
    for process in refused[:_REFUSED]:
        with_it = view.accept(process)
        for hidden in _judged(with_it, proposals(with_it, fast, path), path, move):
            beside = view.accept(hidden)
            again = proposals(beside, [type(process.effect)], path)
            for accepted in _judged(beside, again, path, move):
                path.accept(move, hidden, accepted)
                return beside.accept(accepted)
    return None


_MOST = 6
"""Most effects of a bundle."""
_HOPELESS, _NEARLY = 9.0, 8.0
"""Nats that may be missing for a bundle to be continued, and to be fitted in earnest. Of 44 that
passed none missed more than 7.1 on its way; in noise alone each member adds another 8."""
_ALONE = 6.5
"""Nats that the first member may miss: of another 44 none missed more than 4.7; two of margin."""
_PROMISING = 5.0
"""Gain in nats below which nothing is worth looking behind."""


def add_bundle(
    view: View, kinds: list[type[EffectKind]], candidates: list[Candidate], path: SearchPath
) -> View | None:
    """Return the view with a bundle, or None."""
    member = _best_slow(view, candidates, path.spent - _ALONE)
    beside = sum(c.effect.stage == 2 for c in view.accepted)
    if member is None or path.was_refused(member, beside, view.grid):
        return None
    bundle = _bundle(view, member, [kind for kind in kinds if kind.is_slow], path)
    if bundle is None:
        path.refuse(member, beside)
    return bundle


def _best_slow(view: View, candidates: list[Candidate], least: float = -np.inf) -> Candidate | None:
    """Return the slow one that gains most of those that are worth looking behind."""
    own = (c for c in candidates if c.effect.is_slow and c.gain > _PROMISING and c.excess > least)
    ranked = (c.finished() for c in sorted(own, key=lambda c: -c.excess))
    return next((c for c in ranked if not refused(view, c)), None)


def _bundle(
    view: View, member: Candidate | None, slow: list[type[EffectKind]], path: SearchPath
) -> View | None:
    """Return the view with a bundle that begins with one member, or None."""
    first, trial = len(view.accepted), view
    for _ in range(_MOST):
        if trial is not view:
            member = _best_slow(trial, proposals(trial, slow, path))
        if member is None:
            return None
        trial = trial.accept(member)
        gain = trial.spectrum.loglik - view.spectrum.loglik
        missing = path.spent + penalties(trial, first) - gain
        if missing > _HOPELESS:
            return None
        if len(trial.accepted) - first > 1 and missing < _NEARLY:
            trial = refit_jointly(refit(trial, path))
            gain = trial.spectrum.loglik - view.spectrum.loglik
            members = trial.accepted[first:]
            uneven = [c.effect.local_power(trial) for c in members]
            each = all(c.gain / u > c.penalty for c, u in zip(members, uneven, strict=True))
            if each and gain / max(uneven) > path.spent + penalties(trial, first):
                path.accept("add bundle", *members)
                return judge_members(trial, members)
    return None
