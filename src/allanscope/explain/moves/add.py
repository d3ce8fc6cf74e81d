"""Add the candidate that gains most beyond its penalty and passes the gates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.unexplained import united
from allanscope.explain.gates import judge, penalty_passed
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["add", "proposals", "with_rivals"]

_GOOD_PART = 0.3
"""Share of a band's gain that a line may have which is all there is to the band."""
_SIMILAR = 3.0


def proposals(view: View, kinds: Iterable[type[EffectKind]], path: SearchPath) -> list[Candidate]:
    """Ask kinds for candidates, but for those that were taken before and dropped."""
    found = []
    for kind in kinds:
        path.evaluations += 1
        found += [c for c in kind.candidates(view) if not path.was_dropped(c, view.grid)]
    return found


def add(
    view: View, candidates: list[Candidate], path: SearchPath, *, unite: bool = False
) -> View | None:
    """Return the view with the best candidate that passes every gate; None if there is none.

    With `unite` a range without a name takes in those that it touches.
    """
    for candidate in _ranked(candidates):
        if not penalty_passed(view, candidate, path.spent):
            path.note("add", candidate, "penalty: gains less than its search costs")
            return None
        accepted, why = judge(view, candidate)
        if accepted is None:
            path.note("add", candidate, why)
            continue
        path.accept("add", accepted)
        if unite:
            view, accepted = united(view, accepted)
        return view.accept(accepted)
    return None


def _ranked(candidates: list[Candidate]) -> list[Candidate]:
    """Order candidates by what they gain beyond their penalty.

    A constant line that holds a good part of the power of a band goes before the band: a few lines
    side by side are lines, and so are those of a modulated tone.
    """
    ranked = sorted(candidates, key=lambda c: -c.excess)
    for band in tuple(ranked):
        lines = [
            c for c in ranked if band.effect.holds(c.effect) and c.excess > _GOOD_PART * band.excess
        ]
        if lines and band.excess > 0:
            ranked.remove(lines[0])
            ranked.insert(ranked.index(band), lines[0])
    return ranked


def with_rivals(view: View, former: list[Candidate], now: list[Candidate]) -> View:
    """Note kinds that would have done as well as the effect accepted last, and now gain nothing."""
    if not view.accepted or not former:
        return view
    last = view.accepted[-1]
    rivals = dict(last.rivals)
    for rival in former:
        is_other = rival.kind != last.kind and rival.effect.is_rival
        if not is_other or rival.gain < last.gain - _SIMILAR:
            continue
        left = max((c.gain for c in now if c.kind == rival.kind), default=0.0)
        if left < 0.5 * rival.gain:
            rivals[rival.kind] = max(rival.gain, rivals.get(rival.kind, 0.0))
    updated = replace(last, rivals=rivals)
    return view.noting((*view.accepted[:-1], updated))
