"""Add several slow effects that pass together, though none passes alone.

While one of them is left out it keeps K high, and a high K hides the others: a warm-up and three
bumps of the level look like a random walk until all four are taken out. What is looked at is paid
for by every member, and each must be worth its penalty given the others.
"""

from __future__ import annotations

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.shock import within_shock
from allanscope.explain.effects.unexplained import is_remnant
from allanscope.explain.gates import judge_members, owed
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves.add import proposals
from allanscope.explain.moves.refit import refit
from allanscope.explain.regression import refit_jointly
from allanscope.explain.view import View

__all__ = ["add_bundle"]

_MOST = 6
_HOPELESS, _NEARLY = 30.0, 8.0
"""Nats that may be missing for a bundle to be continued, and to be fitted in earnest."""
_PROMISING = 5.0
"""Gain in nats below which nothing is worth looking behind."""


def add_bundle(
    view: View, kinds: list[type[EffectKind]], candidates: list[Candidate], path: SearchPath
) -> View | None:
    """Return the view with a bundle, or None."""
    slow = [kind for kind in kinds if kind.is_slow]
    first = len(view.accepted)
    trial = view
    for _ in range(_MOST):
        if trial is not view:
            candidates = proposals(trial, slow, path)
        own = [
            c
            for c in candidates
            if c.effect.is_slow and not is_remnant(trial, c) and not within_shock(trial, c)
        ]
        promising = [c for c in own if c.gain > _PROMISING]
        if not promising:
            return None
        trial = trial.accept(max(promising, key=lambda c: c.excess))
        gain = trial.spectrum.loglik - view.spectrum.loglik
        missing = path.spent + owed(trial, first) - gain
        if missing > _HOPELESS:
            return None
        if len(trial.accepted) - first > 1 and missing < _NEARLY:
            trial = refit_jointly(refit(trial, path))
            gain = trial.spectrum.loglik - view.spectrum.loglik
            members = trial.accepted[first:]
            if gain > path.spent + owed(trial, first) and all(c.excess > 0 for c in members):
                path.accept("add bundle", *members)
                return judge_members(trial, members)
    return None
