"""What a candidate must pass before it is accepted; each gate returns why not, or nothing.

1. *penalty*: the gain exceeds what the search for it costs, to which each effect that was accepted
   before adds ln 2 (alpha / 2^k is left to spend);
2. *adequacy*: it is what its name says, or `unexplained` in its place (`adequacy`);
3. *held out*: it gains on data that was not used to fit it; of a large gain of a process at least a
   quarter, else it did not recur; and where a slope must be the same in every quarter, it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from allanscope.explain.adequacy import adequate
from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effects.unexplained import covered, is_remnant
from allanscope.explain.view import View

__all__ = ["judge", "judge_members", "owed", "penalty_passed"]

_RECURRING, _SMALL = 0.25, 30.0


def penalty_passed(view: View, candidate: Candidate, spent: float) -> bool:
    """Tell whether a candidate gains more than its search and those before it cost."""
    accepted = [c for c in view.accepted if not c.effect.is_coefficient]
    return bool(candidate.excess > spent + len(accepted) * np.log(2))


def judge(view: View, candidate: Candidate) -> tuple[Candidate | None, str]:
    """Return what may be accepted in the place of a candidate, or None, and the gate that said so.

    The penalty is not asked here.
    """
    verdict = adequate(view, candidate)
    if verdict is None:
        return None, "adequacy: it is not what its name says"
    if covered(view, verdict):
        return None, "adequacy: that range is known already"
    if is_remnant(view, verdict):
        return None, "adequacy: the end of a loud tone"
    held = verdict.effect.hold_out(view, verdict)
    recurring = _RECURRING * (verdict.gain - _SMALL) if verdict.effect.is_process else 0.0
    if held is not None and held.nats <= max(0.0, recurring):
        return None, f"held out: {held.nats:.1f} nats on other data"
    if held is not None and _is_refuted(verdict, held):
        return None, "held out: quarters of the record disagree"
    return replace(verdict, held_out=held), "accepted"


def judge_members(view: View, members: tuple[Candidate, ...]) -> View | None:
    """Judge every member of a bundle on held-out data, given the others; None if one fails."""
    judged = []
    for candidate in view.accepted:
        if all(candidate is not c for c in members):
            judged.append(candidate)
            continue
        held = candidate.effect.hold_out(view.without(candidate), candidate)
        if held is not None and (held.nats <= 0 or _is_refuted(candidate, held)):
            return None
        judged.append(replace(candidate, held_out=held))
    return replace(view, accepted=tuple(judged))


def owed(view: View, first: int) -> float:
    """Return the penalty of everything accepted after the first so many effects."""
    return float(sum(c.penalty for c in view.accepted[first:]) + first * np.log(2))


def _is_refuted(candidate: Candidate, held: HeldOut) -> bool:
    return candidate.effect.must_replicate and held.replicated is False
