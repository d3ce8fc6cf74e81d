"""Add a warm-up and the temperature, if the two pass in one regression.

Each, fitted alone, takes along what belongs to the other, and a slope that was found beside half a
warm-up is refuted by the quarter in which the warm-up was.
"""

from __future__ import annotations

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects import KINDS, EffectKind
from allanscope.explain.gates import judge_members, owed
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves.add import proposals
from allanscope.explain.regression import refit_jointly
from allanscope.explain.view import View

__all__ = ["add_pair"]


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
    excess = trial.spectrum.loglik - view.spectrum.loglik - path.spent - owed(trial, first)
    others = max((c.excess for c in candidates if c.kind not in pair), default=0.0)
    if excess <= max(0.0, others - path.spent) or any(c.excess <= path.spent for c in members):
        return None
    judged = judge_members(trial, members)
    if judged is not None:
        path.accept("add pair", *judged.accepted[first:])
    return judged
