"""Moves that fold several effects into the one that they are: sidebands, opposite steps."""

from __future__ import annotations

from itertools import combinations

from allanscope.explain.effects.excursion import Excursion
from allanscope.explain.effects.sinusoid import Sinusoid, sidebands
from allanscope.explain.effects.step import Jump
from allanscope.explain.effects.unexplained import tones_left_over, united
from allanscope.explain.gates import judge
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["fold_sidebands", "fold_steps"]


def fold_sidebands(view: View, path: SearchPath) -> View:
    """Return the view with the tone in the place of the family of lines, if there is one."""
    lines = [(c, c.effect) for c in view.accepted if isinstance(c.effect, Sinusoid)]
    family = sidebands([line for _, line in lines])
    if not family:
        return view
    members = [(c, line.frequency.value) for c, line in lines if line in family]
    bare = view.without(*(c for c, _ in members))
    whole = tones_left_over(bare, members)
    if whole is None:
        return view
    bare, tone = united(bare, whole)
    path.note("fold sidebands", tone, "accepted")
    return bare.accept(tone)


def fold_steps(view: View, path: SearchPath) -> View:
    """Return the view with an excursion in the place of two opposite steps, if it does as well.

    The edges of a long box are found as steps, the first one of a short box as a jump that creeps
    back. The box has a number less and pays once.
    """
    steps = [(c, c.effect) for c in view.accepted if isinstance(c.effect, Jump)]
    for (one, first), (other, second) in combinations(steps, 2):
        if first.size.value * second.size.value > 0:
            continue
        bare = view.without(one, other)
        path.evaluations += 1
        box = Excursion.between(bare, first.time.value, second.time.value)
        if box is None:
            continue
        whole = bare.accept(box).spectrum.loglik - box.penalty
        if whole < view.spectrum.loglik - one.penalty - other.penalty:
            continue
        found, why = judge(bare, box)
        path.note("fold steps", found or box, why)
        if found is not None:
            return bare.accept(found)
    return view
